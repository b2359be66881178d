"""Arms given by Denavit-Hartenberg tables, against the homogeneous matrices printed in textbooks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Literal

import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.rounding import EPS, ROUNDINGS
from validation.case import Case, Measured

Convention = Literal["standard", "modified"]


def standard(a: float, α: float, d: float, θ: float) -> Array:
    """Homogeneous matrix A_i^{i−1} of a link by Siciliano et al. (2009), equation (2.52)."""
    c, s, ca, sa = math.cos(θ), math.sin(θ), math.cos(α), math.sin(α)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def modified(a: float, α: float, d: float, θ: float) -> Array:
    """Homogeneous matrix {}^{i−1}T_i of a link by Craig (2005), equation (3.6), from a_{i−1} and α_{i−1}."""
    c, s, ca, sa = math.cos(θ), math.sin(θ), math.cos(α), math.sin(α)
    return np.array([[c, -s, 0, a], [s * ca, c * ca, -sa, -sa * d], [s * sa, c * sa, ca, ca * d], [0, 0, 0, 1]])


CONVENTIONS: Mapping[Convention, Callable[[float, float, float, float], Array]] = {
    "standard": standard,
    "modified": modified,
}


def run(case: Case, links: int, arms: int, length: float, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest difference of the tip's frame from the matrix product, by convention, and the verdict.

    There are `arms` arms for each number of links up to `links`; `length` is the largest |a| and |d| [m].
    """
    (scene,) = case.load_scenes()
    random = np.random.default_rng(seed)
    worst = 0.0
    for convention, matrix in CONVENTIONS.items():
        furthest = 0.0
        for count in range(1, links + 1):
            for _ in range(arms):
                table = random.uniform(-1.0, 1.0, (count, 4)) * (length, 180.0, length, 180.0)
                q = random.uniform(-math.pi, math.pi, count)
                difference = np.abs(_tip(scene, convention, table, q) - _product(matrix, table, q)).max()
                furthest = max(furthest, float(difference / (ROUNDINGS * EPS * count)))
        yield Measured("apart", furthest, varied={"form": convention, "arms": links * arms})
        worst = max(worst, furthest)
    yield Measured("claim", worst, note="holds" if worst <= 1.0 else "does not hold")


def _tip(scene: Scene, convention: Convention, table: Array, q: Array) -> Array:
    """The frame of the tip, (4, 4), from the library."""
    hub = fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))  # any body; the frames do not depend on it
    links = tuple(
        fl.Link(
            name=f"l{k}",
            hub=hub,
            dh=fl.details.DenavitHartenberg(convention=convention, a=a, alpha_deg=α, d=d, theta_deg=θ),
        )
        for k, (a, α, d, θ) in enumerate(table.tolist())
    )
    arm = replace(scene.arm, links=links)
    start = fl.InitialState(joint_deg=(0.0,) * len(links))
    placed = fl.frames(fl.lump(replace(scene, arm=arm, initial=start, drive=fl.Drive())), q)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = placed.rotations[-1], placed.points[-1]
    return frame


def _product(matrix: Callable[[float, float, float, float], Array], table: Array, q: Array) -> Array:
    """The frame of the tip from the textbook's matrices."""
    frame = np.eye(4)
    for (a, α, d, θ), angle in zip(table.tolist(), q.tolist(), strict=True):
        frame = frame @ matrix(a, math.radians(α), d, angle + math.radians(θ))
    return frame
