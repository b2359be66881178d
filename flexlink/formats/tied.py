"""Ties of a scene in MJCF: equalities and tendons between sites.

    point, hinge, weld    `connect` of one pair of sites, of two pairs on the hinge's axis; `weld`
    joint                 `joint`
    distance              `tendon`: its length is l₀ at zero angles, and l − l₀ is constant
    springs, stops        tendons between sites, or of one joint, which are slack in the range `springlength`

MuJoCo's equalities are soft. With a the value of J q̈ without a row g, ġ = J q̇, the file makes

    J q̈ = (1 − d) a − 2 ġ / τ − g / τ²        d = 0.9999,  τ = 2 h

which is the stiffest that MuJoCo allows for a time step h. As J̇ q̇ is missing, g is of the order h² after a few steps.
"""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import unique
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.tie import Tie, refuse_ties
from flexlink.dynamics.forces import Gains
from flexlink.dynamics.ties import Rows, gaps, rows_by_tie, tie_rows
from flexlink.formats.document import body_names, decimals, valid, xml_joint_names
from flexlink.kernels.inputs.drive_torque import follow


def spring_gains(scene: Scene, q: Array) -> Gains:
    """Stiffness Σ k Jᵀ J and damping Σ d Jᵀ J (n, n) of all ties with a spring at angles q (n,), as if they pressed."""
    bare = lump(open_chain(scene))
    ties = tie_rows(scene, bare)
    if ties is None:
        return Gains(*np.zeros((2, bare.n)))
    J, k = gaps(ties, bare, q)[1], np.where(np.isinf(ties[0]["stiffness"]), 0.0, ties[0]["stiffness"])
    return Gains((J.T * k) @ J, (J.T * ties[0]["damping"]) @ J)


def add_ties(root: ET.Element, chain: Chain, scene: Scene, *, timestep: float) -> None:
    """Add a scene's ties to the MJCF of its open chain, for a time step [s], or refuse what the file cannot hold."""
    bare = lump(open_chain(scene))
    ties = tie_rows(scene, bare)
    if ties is None:
        return
    solid = {"solref": decimals([2 * timestep, 1.0]), "solimp": "0.9999 0.9999"}  # more is not allowed
    ET.SubElement(ET.SubElement(root, "default"), "equality", solid)
    for flag in root.iterfind("option/flag"):
        del flag.attrib["constraint"], flag.attrib["equality"]
    moved = np.zeros((3, len(ties[0])))
    follow(ties[1], scene.initial.time, *moved)
    length = ties[0]["length"] + moved[0]
    g, J, _ = gaps(ties, bare, np.zeros(bare.n), scene.initial.time)  # g = l₀ − l of distances
    moves = np.abs(J).max(axis=1) > 1e-9 * bare.size
    joints, found = xml_joint_names(chain), {body.get("name", ""): body for body in root.iter("body")}
    # all bodies without small masses, −1 for frame 0; None: not in the file
    bodies = {-1: root.find("worldbody")} | {k: found.get(name) for k, name in enumerate(body_names(bare))}
    for tie, own in rows_by_tie(scene.ties):
        rows, first = ties[0][own], own.start
        if tie.kind == "distance" and tie.stiffness is None and not moves[first]:
            refuse_ties([tie], "no joint changes its length at zero angles, by which MuJoCo scales its force")
        if tie.on_joint:
            _on_joint(root, tie, rows[0], joints)
        else:
            _on_points(root, bodies, tie, rows, length[first], -g[first])


def _on_joint(root: ET.Element, tie: Tie, row: np.void, joints: Sequence[str]) -> None:
    if tie.stiffness is None:
        others = {} if row["b"] < 0 else {"joint2": joints[row["b"]]}
        coefficients = decimals([0, row["ratio"], 0, 0, 0])
        _new(root, "equality", "joint", tie.name, joint1=joints[row["a"]], **others, polycoef=coefficients)
    else:
        tendon = _new(root, "tendon", "fixed", tie.name, **_spring(tie, row["low"], row["high"]))
        for end, by in (("a", 1.0), ("b", -row["ratio"])):
            if row[end] >= 0:
                ET.SubElement(tendon, "joint", joint=joints[row[end]], coef=decimals([by]))


def _on_points(
    root: ET.Element, bodies: dict[int, ET.Element | None], tie: Tie, rows: Rows, length: float, off: float
) -> None:
    """Add a tie between points, with the length l, and l − l₀ [m]."""
    if tie.kind == "slider" or (tie.kind == "point" and tie.to.axis is not None):
        refuse_ties([tie], "MJCF holds no point on a line or in one direction only")
    if tie.kind == "cylinder":
        refuse_ties([tie], "MJCF has no oil")
    if tie.kind == "point" and tie.damping:
        refuse_ties([tie], f"MJCF has no damper in all directions, damping = {tie.damping!r}")
    pairs = [_sites(root, bodies, tie, rows[k::3]) for k in range(0, 1 if tie.kind == "weld" else len(rows), 3)]
    if tie.stiffness is None and tie.kind != "distance":
        for one, other in pairs:
            _new(root, "equality", "weld" if tie.kind == "weld" else "connect", tie.name, site1=one, site2=other)
        return
    l = 0.0 if tie.kind == "point" else length
    own = {} if tie.stiffness is None else _spring(tie, max(0.0, l + rows["low"][0]), l + rows["high"][0])
    tendon = _new(root, "tendon", "spatial", tie.name, **own)
    for site in pairs[0]:
        ET.SubElement(tendon, "site", site=site)
    if tie.stiffness is None:
        constant = {"tendon1": tendon.get("name", ""), "polycoef": decimals([off, 0, 0, 0, 0])}
        _new(root, "equality", "tendon", tie.name, **constant)


def _spring(tie: Tie, low: float, high: float) -> dict[str, str]:
    """Attributes of a tendon with the spring of a tie, which is slack from `low` to `high` [m, rad]."""
    far = 1e9  # in place of an infinite end
    ends = [max(low, -far), min(high, far)]
    numbers = {"stiffness": [tie.stiffness or 0.0], "damping": [tie.damping], "springlength": ends}
    return {key: decimals(value) for key, value in numbers.items()}


def _new(root: ET.Element, group: str, kind: str, name: str, **attributes: str) -> ET.Element:
    """Add an element with a name that is unique in its group."""
    parent = root.find(group)
    parent = ET.SubElement(root, group) if parent is None else parent
    *_, name = unique([*(other.get("name", "") for other in parent), valid(name)])
    return ET.SubElement(parent, kind, {"name": name} | attributes)


def _sites(root: ET.Element, bodies: dict[int, ET.Element | None], tie: Tie, points: Rows) -> list[str]:
    """Add sites at both ends of the first of these rows, and return their names; a weld's have axes to the others."""
    names = []
    for end in "ab":
        body, place = bodies[int(points[end][0])], points[f"point_{end}"]
        if body is None:
            text = f"tie {tie.name!r}: holds a segment without mass, which MuJoCo refuses; add mass"
            raise ArgumentError(text, id="joint-without-inertia")
        *_, name = unique([*(site.get("name", "") for site in root.iter("site")), valid(f"{tie.name}.{end}")])
        site = ET.SubElement(body, "site", name=name, pos=decimals(place[0]))
        if tie.kind == "weld":
            site.set("xyaxes", decimals((place[1:] - place[0]).flat))
        names.append(name)
    return names
