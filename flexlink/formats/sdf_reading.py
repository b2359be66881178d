"""SDFormat → Chain: read files written by `to_sdf`, without rounding errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.formats.document import UPPER_TRIANGLE
from flexlink.formats.reading import (
    End,
    Hinge,
    Mass,
    chain_of,
    coordinate,
    inertia_matrix,
    link_of,
)
from flexlink.formats.sdf import DYNAMICS, NAMESPACES, STANDARD_FIELDS, to_sdf
from flexlink.formats.strict_reading import Node, read
from flexlink.kernels.layout import HINGE, SLIDES

OWN = f"{{{NAMESPACES['xmlns:flexlink']}}}"  # the namespace prefix as parsers write it


def read_sdf(text: str | bytes, *, what: str = "the SDF") -> Chain:
    """Read an SDF file written by `to_sdf` back to its chain; parameters and errors are as in `read_urdf`."""
    return read(text, what, tag="sdf", to_chain=_chain, write=to_sdf, ignored=frozenset({"visual"}))


def _chain(sdf: Node) -> Chain:
    model = sdf.one("world").one("model")
    links, bodies, joints = model.names(f"{OWN}links"), model.all("link"), model.all("joint")
    floating = bodies[: max(0, len(bodies) - len(joints))]
    if len(bodies) < len(joints) or len(floating) > 1:
        raise model.error(f"{len(joints)} joints, {len(bodies)} links: not a file written by flexlink")
    behind = {_text(joint, "child"): joint.attribute("name") for joint in joints}
    hinges = [_read_hinge(*both, links, behind) for both in zip(joints, bodies[len(floating) :], strict=True)]
    ends = [_read_end(frame, links, behind) for frame in model.all("frame")]
    mass = _read_body(floating[0].one("inertial")) if floating else None
    gravity = sdf.one("world").one("gravity").numbers(3)
    coupled = model.all(f"frame/{OWN}coupling")
    return chain_of(model, model, OWN, gravity, links, hinges, ends, mass, coupled)


def _text(element: Node, path: str) -> str:
    return element.one(path).element.text or ""


def _read_end(frame: Node, links: Sequence[str], behind: Mapping[str, str]) -> End:
    parent = behind.get(frame.attribute("attached_to"), "")
    return End(frame, link_of(frame, f"{OWN}link", links), parent, *_read_place(frame))


def _read_place(element: Node) -> tuple[Array, Array]:
    pose = element.one("pose")
    return np.array(pose.numbers(6)[:3]), pose.rotation(f"{OWN}rotation")


def _read_hinge(joint: Node, link: Node, links: Sequence[str], behind: Mapping[str, str]) -> Hinge:
    numbers = {key: joint.number(f"{OWN}{key}") for key in HINGE.names or () if key not in STANDARD_FIELDS}
    dynamics, axis = joint.one("axis").one("dynamics"), joint.one("axis").one("xyz")
    numbers |= {field: dynamics.one(key).number() for key, field in DYNAMICS.items()}
    lower, upper = joint.one("axis").all("limit/lower"), joint.one("axis").all("limit/upper")
    numbers |= {"lower": lower[0].number() if lower else -np.inf, "upper": upper[0].number() if upper else np.inf}
    rotor = joint.all(f"{{{NAMESPACES['xmlns:drake']}}}rotor_inertia")
    slides = SLIDES * (joint.attribute("type") == "prismatic")
    numbers |= {"axis": axis.unit_axis(axis.numbers(3)) + slides, "armature": rotor[0].number() if rotor else 0.0}
    place = coordinate(joint, joint.numbers(3, f"{OWN}coordinate"), links)
    parent = behind.get(_text(joint, "parent"), "")
    return Hinge(joint, parent, *_read_place(link), numbers, place, _read_body(link.one("inertial")))


def _read_body(inertial: Node) -> Mass | None:
    mass, I = (
        inertial.one("mass").number(),
        inertia_matrix([inertial.one("inertia").one(key).number() for key in UPPER_TRIANGLE]),
    )
    return (mass, np.array(inertial.one("pose").numbers(6)[:3]), I) if mass or I.any() else None
