"""The exported URDF as plain arrays, for adapters of engines that read no such file, or not all that stands in it."""

from __future__ import annotations

from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.rotation import matrix_from_rpy_deg
from flexlink.engines.read_back import OF_JOINTS, ReadBack, merged
from flexlink.formats.document import UPPER_TRIANGLE

Array = NDArray[np.float64]


class Tree(NamedTuple):
    """n hinges one after another, each with the link behind it, which may be massless; and the tip."""

    names: tuple[str, ...]  # of the hinges
    gravity: Array  # (3,), frame 0 [m/s²]
    axes: Array  # (n, 3), in the hinge's own frame
    rotations: Array  # (n, 3, 3), R: v_parent = R v at zero angle
    offsets: Array  # (n, 3), in the frame of the link before [m]
    masses: Array  # (n,) [kg]
    centers: Array  # (n, 3) [m]
    inertias: Array  # (n, 3, 3), about the centre of mass, axes of the link [kg m²]
    stiffness: Array  # (n,), and so on: k, θ₀, d, armature, c, w
    rest: Array
    damping: Array
    armature: Array
    coulomb: Array
    coulomb_width: Array
    tip: Array  # (3,), in the frame of the last link [m]

    @property
    def n(self) -> int:
        """Number of hinges."""
        return len(self.axes)

    def read_back(self) -> ReadBack:
        """The numbers in frame 0 at zero angles."""
        R, p, placed = np.eye(3), np.zeros(3), []
        for rotation, offset in zip(self.rotations, self.offsets, strict=True):
            p, R = p + R @ offset, R @ rotation
            placed.append((R, p))
        turns, points = (np.array(part) for part in zip(*placed, strict=True))
        centers = points + np.einsum("kij,kj->ki", turns, self.centers)
        inertias = turns @ self.inertias @ turns.mT
        own: dict[str, Any] = {field: getattr(self, field) for field in OF_JOINTS}
        return ReadBack(
            self.names, np.arange(self.n) - 1, np.einsum("kij,kj->ki", turns, self.axes), points,
            **merged(np.arange(self.n), self.masses, centers, inertias, points), **own,
            gravity=self.gravity, tip=p + R @ self.tip,
        )  # fmt: skip


def read_tree(text: str) -> Tree:
    """The numbers of a document that `formats.to_urdf` has written."""
    robot = ET.fromstring(text)
    hinges, tip = robot.findall("joint[@type='revolute']"), robot.findall("joint[@type='fixed']")[-1]
    links = {link.attrib["name"]: link for link in robot.findall("link")}
    behind = [links[_part(hinge, "child").attrib["link"]].find("inertial") for hinge in hinges]
    bodies = [_body(inertial) for inertial in behind]
    turns = [np.degrees(_numbers(hinge, "origin", "rpy")) for hinge in hinges]

    def of_hinges(element: str, key: str) -> Array:
        return np.array([float(_part(hinge, element).attrib[key]) for hinge in hinges])

    return Tree(
        names=tuple(hinge.attrib["name"] for hinge in hinges),
        gravity=_numbers(robot, "flexlink", "gravity"),
        axes=np.array([_numbers(hinge, "axis", "xyz") for hinge in hinges]),
        rotations=np.array([matrix_from_rpy_deg((float(r), float(p), float(y))) for r, p, y in turns]),
        offsets=np.array([_numbers(hinge, "origin", "xyz") for hinge in hinges]),
        masses=np.array([mass for mass, _, _ in bodies]),
        centers=np.array([center for _, center, _ in bodies]),
        inertias=np.array([inertia for _, _, inertia in bodies]),
        damping=of_hinges("dynamics", "damping"),
        coulomb=of_hinges("dynamics", "friction"),
        **{key: of_hinges("flexlink", key) for key in ("stiffness", "rest", "armature", "coulomb_width")},
        tip=_numbers(tip, "origin", "xyz"),
    )


def _body(inertial: ET.Element | None) -> tuple[float, Array, Array]:
    """Mass, centre and inertia; zero of a massless link."""
    inertia = np.zeros((3, 3))
    if inertial is None:
        return 0.0, np.zeros(3), inertia
    for key, (i, j) in UPPER_TRIANGLE.items():
        inertia[i, j] = inertia[j, i] = float(_part(inertial, "inertia").attrib[key])
    return float(_part(inertial, "mass").attrib["value"]), _numbers(inertial, "origin", "xyz"), inertia


def _part(element: ET.Element, name: str) -> ET.Element:
    return element.findall(name)[0]


def _numbers(element: ET.Element, name: str, key: str) -> Array:
    return np.array(_part(element, name).attrib[key].split(), float)
