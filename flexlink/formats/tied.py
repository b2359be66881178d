"""Ties of a scene in MJCF: equalities and tendons between sites.

    point, hinge, weld    `connect` of one pair of sites, of two pairs on the hinge's axis; `weld`
    joint                 `joint`
    distance              `tendon`: its length is l₀ at zero angles, and l − l₀ is constant
    springs, stops        tendons between sites, or of one joint, which are slack in the range `springlength`

MuJoCo's equalities are soft. With a the value of J q̈ without a row g, ġ = J q̇, the file makes

    J q̈ = (1 − d) a − 2 ġ / τ − g / τ²        d = 0.9999,  τ = 2 h

which is the stiffest that MuJoCo allows for a time step h. As J̇ q̇ is missing, g is of the order h² after a few steps.
"""

from __future__ import annotations

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
from flexlink.dynamics.ties import Rows, gaps, number_of_rows, tie_rows
from flexlink.formats.document import decimals, tips, valid, xml_joint_names, xml_link_names
from flexlink.kernels.inputs.drive_torque import follow

STIFFEST = 0.9999
"""Largest impedance d that MuJoCo allows."""
FAR = 1e9
"""Length [m] or angle [rad] in place of an infinite end of a range."""


def spring_gains(scene: Scene, q: Array) -> Gains:
    """Stiffness Σ k Jᵀ J and damping Σ d Jᵀ J (n, n) of all ties with a spring at angles q (n,), as if they pressed."""
    bare = lump(open_chain(scene))
    ties = tie_rows(scene, bare)
    if ties is None:
        return Gains(*np.zeros((2, bare.n)))
    J, k = gaps(ties, bare, q)[1], np.where(np.isinf(ties[0]["stiffness"]), 0.0, ties[0]["stiffness"])
    return Gains((J.T * k) @ J, (J.T * ties[0]["damping"]) @ J)


def add_ties(root: ET.Element, chain: Chain, scene: Scene, *, timestep: float) -> None:
    """Add the ties of a scene to the MJCF of its open chain, for a time step [s].

    Raises
    ------
    SceneError
        MJCF has no element for a tie.
    ArgumentError
        A tie is on a segment without mass, which is not in the file.
    """
    bare = lump(open_chain(scene))
    ties = tie_rows(scene, bare)
    if ties is None:
        return
    solid = {"solref": decimals([2 * timestep, 1.0]), "solimp": decimals([STIFFEST, STIFFEST])}
    ET.SubElement(ET.SubElement(root, "default"), "equality", solid)
    for flag in root.iterfind("option/flag"):
        del flag.attrib["constraint"], flag.attrib["equality"]
    moved, first, file = np.zeros((3, len(ties[0]))), 0, _File(root, chain, bare)
    follow(ties[1], scene.initial.time, *moved)
    length = ties[0]["length"] + moved[0]
    g = gaps(ties, bare, np.zeros(bare.n), scene.initial.time)[0]  # l₀ − l; nan if l₀ = 0
    off = np.where(np.isnan(g), length, -g)
    for tie in scene.tie:
        file.add(tie, ties[0][first : first + number_of_rows(tie)], length[first], off[first])
        first += number_of_rows(tie)


class _File:
    """The MJCF `root` of a chain, to which ties are added; rows are of the `bare` chain, without small masses."""

    def __init__(self, root: ET.Element, chain: Chain, bare: Chain) -> None:
        self.root, self.joints, links = root, xml_joint_names(chain), xml_link_names(chain)
        self.bodies = {body.get("name"): body for body in root.iter("body")}
        ends = dict(zip(bare.tips.values(), tips(chain), strict=True))
        self.links = [ends[k].name if k in ends else links[b["stop"]] for k, b in enumerate(bare.bodies)]

    def add(self, tie: Tie, rows: Rows, length: float, off: float) -> None:
        """Add a tie with the length l, and l − l₀ [m]."""
        held = tie.stiffness is None
        if tie.kind == "slider" or (tie.kind == "point" and tie.to.axis is not None):
            refuse_ties([tie], "MJCF holds no point on a line or in one direction only")
        if tie.kind == "point" and tie.damping:
            refuse_ties([tie], f"MJCF has no damper in all directions, damping = {tie.damping!r}")
        if tie.on_joint and held:
            self._new("equality", "joint", tie.name, joint1=self.joints[rows["a"][0]], polycoef="0 0 0 0 0")
        elif tie.on_joint:
            tendon = self._spring("fixed", tie, rows["low"][0], rows["high"][0])
            ET.SubElement(tendon, "joint", joint=self.joints[rows["a"][0]], coef="1")
        elif held and tie.kind != "distance":
            kind = "weld" if tie.kind == "weld" else "connect"
            for row in rows[:1] if kind == "weld" else rows[::3]:
                self._new("equality", kind, tie.name, **self._sites(tie, row, rows[::3]))
        else:
            l = 0.0 if tie.kind == "point" else length
            tendon = self._spring("spatial", tie, max(0.0, l + rows["low"][0]), l + rows["high"][0])
            for site in self._sites(tie, rows[0]).values():
                ET.SubElement(tendon, "site", site=site)
            if held:
                own = {"tendon1": tendon.get("name", ""), "polycoef": decimals([off, 0, 0, 0, 0])}
                self._new("equality", "tendon", tie.name, **own)

    def _spring(self, kind: str, tie: Tie, low: float, high: float) -> ET.Element:
        """Add a tendon without its path, with the spring of a tie, slack from `low` to `high` [m, rad]."""
        if tie.stiffness is None:
            return self._new("tendon", kind, tie.name)
        own = {"stiffness": decimals([tie.stiffness]), "damping": decimals([tie.damping])}
        return self._new("tendon", kind, tie.name, **own, springlength=decimals(np.clip([low, high], -FAR, FAR)))

    def _new(self, group: str, kind: str, name: str, **attributes: str) -> ET.Element:
        parent = self.root.find(group)
        parent = ET.SubElement(self.root, group) if parent is None else parent
        *_, name = unique([*(other.get("name", "") for other in parent), valid(name)])
        return ET.SubElement(parent, kind, {"name": name} | attributes)

    def _sites(self, tie: Tie, row: np.void, points: Rows | None = None) -> dict[str, str]:
        """Add sites at the points of a row, and return their names; the axes of a weld are towards its `points`."""
        names = {}
        for number, end in enumerate("ab", 1):
            body = self.root.find("worldbody") if row[end] < 0 else self.bodies.get(self.links[row[end]])
            if body is None:
                text = f"tie {tie.name!r}: holds a segment without mass, which MuJoCo refuses; add mass"
                raise ArgumentError(text, id="joint-without-inertia")
            axes = dict[str, str]()
            if tie.kind == "weld" and points is not None:
                towards = (points[f"point_{end}"][1:] - row[f"point_{end}"]).ravel()
                axes = {"xyaxes": decimals(towards)}
            taken = [site.get("name", "") for site in self.root.iter("site")]
            *_, name = unique([*taken, valid(f"{tie.name}.{end}")])
            ET.SubElement(body, "site", {"name": name, "pos": decimals(row[f"point_{end}"])} | axes)
            names[f"site{number}"] = name
        return names
