"""SDFormat → Chain: reads files written by `to_sdf`, exact to the bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.formats.document import ROTATION_SPRINGS, UPPER_TRIANGLE
from flexlink.formats.reading import Hinge, Node, chain_of, coordinate, coupling_of, inertia_matrix, read
from flexlink.formats.sdf import DYNAMICS, NAMESPACES, STANDARD_FIELDS, to_sdf
from flexlink.kernels.layout import HINGE

OWN = f"{{{NAMESPACES['xmlns:flexlink']}}}"  # the prefix as parsers write it


def read_sdf(text: str | bytes, *, what: str = "the SDF") -> Chain:
    """Read an SDF file that `to_sdf` has written back to its chain; arguments and errors as in `read_urdf`."""
    return read(text, what, tag="sdf", to_chain=_chain, write=to_sdf, ignored=frozenset({"visual"}))


def _chain(sdf: Node) -> Chain:
    model = sdf.one("world").one("model")
    links, bodies, joints = model.links(f"{OWN}links"), model.all("link"), model.all("joint")
    if len(bodies) != len(joints):
        raise model.error(f"{len(joints)} joints, {len(bodies)} links: not a file that flexlink has written")
    hinges = [_read_hinge(joint, body, links) for joint, body in zip(joints, bodies, strict=True)]
    gravity, tip = sdf.one("world").one("gravity").numbers(3), _read_place(model.one("frame"))
    coupled = [coupling_of(one) for one in model.all(f"frame/{OWN}coupling")]
    return chain_of(
        model, model.attribute(f"{OWN}name"), gravity, links, hinges, tip, coupled, model, f"{OWN}{ROTATION_SPRINGS}"
    )


def _read_place(element: Node) -> tuple[Array, Array]:
    pose = element.one("pose")
    return np.array(pose.numbers(6)[:3]), pose.rotation(f"{OWN}rotation")


def _read_hinge(joint: Node, link: Node, links: Sequence[str]) -> Hinge:
    numbers = {key: joint.number(f"{OWN}{key}") for key in HINGE.names or () if key not in STANDARD_FIELDS}
    dynamics, axis = joint.one("axis").one("dynamics"), joint.one("axis").one("xyz")
    numbers |= {field: dynamics.one(key).number() for key, field in DYNAMICS.items()}
    lower, upper = joint.one("axis").all("limit/lower"), joint.one("axis").all("limit/upper")
    numbers |= {"lower": lower[0].number() if lower else -np.inf, "upper": upper[0].number() if upper else np.inf}
    rotor = joint.all(f"{{{NAMESPACES['xmlns:drake']}}}rotor_inertia")
    numbers |= {"axis": axis.unit_axis(axis.numbers(3)), "armature": rotor[0].number() if rotor else 0.0}
    place = coordinate(joint, joint.numbers(3, f"{OWN}coordinate"), links)
    return Hinge(joint, *_read_place(link), numbers, place, _read_body(link.one("inertial")))


def _read_body(inertial: Node) -> tuple[float, Array, Array] | None:
    mass, I = (
        inertial.one("mass").number(),
        inertia_matrix([inertial.one("inertia").one(key).number() for key in UPPER_TRIANGLE]),
    )
    return (mass, np.array(inertial.one("pose").numbers(6)[:3]), I) if mass or I.any() else None
