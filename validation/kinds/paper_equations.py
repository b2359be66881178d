"""Statements of the paper about its equations, frames, solver and types of links."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

import msgspec
import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import EPS, ROUNDINGS
from flexlink.pages.numbers import number
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.speed.families import timed_states
from validation.trade.error_parts import TYPES, Fine

NEGLIGIBLE_TORQUE = 1e-9  # fraction of the springs' torques: far above rounding error, far below any relevant force


class PaperEquationsSettings(Spec, frozen=True):
    """The statement to check on the case's scenes, and the numbers of links, segments or states to check it on.

    Random angles are within ± `bend` [deg].
    """

    check: Literal["freedoms", "indices", "springs", "definite"]
    links: int = 1
    segments: tuple[int, int] = (2, 2)
    samples: int = 1
    bend: float = 180.0
    seed: int = 0


@kind
def paper_equations(case: Case, settings: PaperEquationsSettings) -> Iterator[Measured]:
    """Statements of the paper about its equations, for many arms and states: freedoms, indices, springs, mass matrix.

    Yield the measured values and the verdict on the paper's statement.
    """
    yield from CHECKS[settings.check](case, settings)


def _freedoms(case: Case, settings: PaperEquationsSettings) -> Iterator[Measured]:
    """Compare equation 1 with the number of joints of the chain, arm by arm."""
    apart = [
        abs(chain.n - (n * (tip * (nseg - 1) + 1) - tip * (nseg - 1))) for chain, n, tip, nseg in _arms(case, settings)
    ]
    verdict = "holds" if max(apart) == 0 else "does not hold"
    yield Measured("claim", max(apart), varied={"arms": len(apart)}, note=verdict)


def _indices(case: Case, settings: PaperEquationsSettings) -> Iterator[Measured]:
    """Compare the order of equation 4, link by link and axis by axis, with the chain's maps in both directions."""
    wrong = []
    for chain, n, tip, nseg in _arms(case, settings):
        order = [(1, 0, 0)]
        for i in range(2, n + 1):
            order += [(i, 0, 0), *((i, j, k) for j in range(1, nseg) for k in range(4 - tip, 4))]
        there = [tuple(chain.coordinate(k)) for k in range(chain.n)]
        back = [chain.index(*coordinate) for coordinate in order]
        wrong.append(sum(a != b for a, b in zip(there, order, strict=True)) + (back != list(range(chain.n))))
    verdict = "holds" if max(wrong) == 0 else "does not hold"
    yield Measured("claim", sum(wrong), varied={"arms": len(wrong)}, note=verdict)


def _arms(case: Case, settings: PaperEquationsSettings) -> Iterator[tuple[fl.Chain, int, int, int]]:
    """Yield chains with their number of links n, their type tip = 1, 2, 3 and their segments per link."""
    (scene,) = case.load_scenes()
    first, last = settings.segments
    for n in range(1, settings.links + 1):
        for tip, flex in enumerate(TYPES.values(), start=1):
            for nseg in range(first, last + 1):
                yield fl.lump(_arm_of(scene, n, flex, nseg)), n, tip, nseg


def _arm_of(scene: Scene, n: int, flex: str, nseg: int) -> Scene:
    """An arm of n links like the scene's last one: the first rigid, the others with this type and nseg segments."""
    link = scene.arm.links[-1]
    bent = [replace(link, name=f"{k}", flex=flex, segments=nseg) for k in range(1, n)]
    links = (replace(link, name="first", flex="rigid", segments=1), *bent)
    return replace(
        scene, arm=replace(scene.arm, links=links), initial=fl.InitialState(joint_deg=(0.0,) * n), drive=fl.Drive()
    )


def _springs(case: Case, settings: PaperEquationsSettings) -> Iterator[Measured]:
    """Without gravity and rates, compare T_GC with zero, and T_IN, which includes springs, with T_FL."""
    without, apart = [], []
    for scene in case.load_scenes():
        chain = fl.lump(scene.varied({"gravity": [0.0, 0.0, 0.0]}))
        q, rest = _postures(chain, settings), np.zeros(chain.n)
        springs = chain.times("stiffness", q - chain.rest)
        bias = fl.bias_torque(chain, q, rest)
        whole = bias + fl.elastic_torque(chain, q) + fl.friction_torque(chain, rest)
        size = np.abs(springs).max()
        without.append(float(np.abs(bias).max() / size))
        apart.append(float(np.abs(whole - springs).max() / size))
        yield Measured("T_GC / T_FL", without[-1], scene.name)
        yield Measured("T_IN − k (θ − θ₀)", apart[-1], scene.name)
    yield Measured("claim", max(apart), note=_of_springs(max(without), max(apart)))


def _of_springs(without: float, apart: float) -> str:
    """Verdict on the claim, from T_GC, which omits the springs, and the error of T_IN, both relative to T_FL."""
    if apart > NEGLIGIBLE_TORQUE:
        return "does not hold"
    if without > NEGLIGIBLE_TORQUE:
        return "holds"
    return (
        "holds if the inverse dynamics includes the elastic forces, as the paper states for M and T_IN: the result is "
        "k (θ − θ₀); without springs, as in the library's T_GC, the result is zero"
    )


def _definite(case: Case, settings: PaperEquationsSettings) -> Iterator[Measured]:
    """Yield the ratio of M's extreme eigenvalues in random configurations, and with a T3 hinge bent to 90° about Y."""
    (scene,) = case.load_scenes()
    bent = [link for link in scene.arm.links if link.flex != "rigid"]
    for name, flex in TYPES.items():
        chain = fl.lump(scene.varied({f"link.{link.name}.flex": flex for link in bent}))
        postures = _postures(chain, settings)
        least = min(_definiteness(chain, q) for q in postures)
        yield Measured("least eigenvalue", least, scene.name, varied={"chain": name, "states": len(postures)})
    locked = postures[0].copy()
    locked[chain.index(len(scene.arm.links), 1, 2)] = np.pi / 2
    left = abs(_definiteness(chain, locked))
    explained = rounding.of_mass_matrix(chain, locked) / np.linalg.norm(fl.mass_matrix(chain, locked), 2)
    singular = left <= explained
    note = "holds for T1 and T2; not for T3 where a hinge is bent to 90° about Y" if singular else "holds"
    yield Measured("claim", left, scene.name, varied={"chain": name}, note=note)


def _postures(chain: fl.Chain, settings: PaperEquationsSettings) -> Array:
    bend = np.radians(settings.bend)
    return np.random.default_rng(settings.seed).uniform(-bend, bend, (settings.samples, chain.n))


def _definiteness(chain: fl.Chain, q: Array) -> float:
    eigenvalues = np.linalg.eigvalsh(fl.mass_matrix(chain, q))
    return float(eigenvalues[0] / np.abs(eigenvalues).max())


CHECKS: dict[str, Callable[[Case, PaperEquationsSettings], Iterator[Measured]]] = {
    "freedoms": _freedoms,
    "indices": _indices,
    "springs": _springs,
    "definite": _definite,
}


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


@kind
def paper_frames(case: Case, links: int, arms: int, length: float, seed: int = 0) -> Iterator[Measured]:
    """Arms given by Denavit-Hartenberg tables, against the homogeneous matrices printed in textbooks.

    Yield the largest difference of the tip's frame from the matrix product, by convention, and the verdict.

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


@kind
def paper_lu(case: Case, samples: int) -> Iterator[Measured]:
    """q̈ by LU decomposition of M (as in the paper), by the library's solver, and by the inverse that the paper avoids.

    Yield each solver's residual M q̈ + T_IN − T_EX, the difference of LU from articulated bodies, the verdict.
    """
    residuals: dict[str, list[float]] = {}
    apart = []
    for scene in case.load_scenes():
        chain = fl.lump(scene)
        found: dict[str, float] = {}
        furthest = 0.0
        for q, qd, tau, _ in zip(*timed_states(chain, samples), strict=True):
            M = fl.mass_matrix(chain, q)
            right = tau - fl.bias_torque(chain, q, qd) - fl.elastic_torque(chain, q) - fl.friction_torque(chain, qd)
            ways = {
                "LU": fl.forward_dynamics(chain, q, qd, tau, solver="lu"),
                "articulated bodies": fl.forward_dynamics(chain, q, qd, tau, solver="articulated"),
                "inverse of M": np.linalg.inv(M) @ right,
            }
            for way, qdd in ways.items():
                left = np.abs(M @ qdd - right).max() / rounding.of_residual(chain, q, qd, qdd, tau)
                found[way] = max(found.get(way, 0.0), float(left))
            both = ways["LU"], ways["articulated bodies"]
            furthest = max(furthest, float(rounding.acceleration_error(chain, q, qd, tau, solutions=both).max()))
        for way, left in found.items():
            facts: Facts = {"solver": way}
            yield Measured(
                "residual" if way != "inverse of M" else "residual of the inverse", left, scene.name, varied=facts
            )
            residuals.setdefault(way, []).append(left)
        yield Measured("apart", furthest, scene.name)
        apart.append(furthest)
    yield Measured(
        "claim", max(residuals["LU"]), note=_lu_verdict(max(residuals["LU"]), max(residuals["inverse of M"]))
    )


def _lu_verdict(lu: float, inverse: float) -> str:
    """Verdict on whether LU's residual is within the rounding bound, with the residual of the inverse."""
    if lu > 1.0:
        return f"does not hold: LU leaves {number(lu, 2)} times the rounding bound"
    return (
        f"holds: LU leaves {number(lu, 2)} of the rounding bound, the inverse {number(inverse, 2)}; by "
        "default the library takes articulated bodies, which need no M (--solver lu is the paper's way)"
    )


LEAST_GAIN = 2.0  # smallest factor of error reduction that counts as a higher level of precision


class Motion(Spec, frozen=True):
    """Changes of a scene, and settings that are converged for flexible and for rigid links."""

    fine: Fine
    rigid: Fine
    change: dict[str, Any] = msgspec.field(default_factory=dict)


@kind
def paper_types(case: Case, scene: dict[str, Motion]) -> Iterator[Measured]:
    """Is the precision of T1, T2 and T3 low, medium and high? Only the type causes errors, since runs are converged.

    Yield each type's distance from the tip by T3, and whether each type is more precise than the one before.

    The links of the scenes bend and twist.
    """
    found: dict[str, float] = {}
    for name, motion in scene.items():
        base = case.varied_scene(name, motion.change)
        limits = {
            t: (motion.rigid if t == "rigid" else motion.fine).limit(base, flex)
            for t, flex in {"rigid": "rigid", **TYPES}.items()
        }
        errors = {t: largest_distance(path.tip, limits["T3"].tip) for t, path in limits.items() if t != "T3"}
        for t, error in errors.items():
            facts: Facts = {"type": t}
            yield Measured("error of the type", error, name, varied=facts)
            yield Measured("own error / error", (limits[t].own + limits["T3"].own) / error, name, varied=facts)
        gains = {"T1": errors["rigid"] / errors["T1"], "T2": errors["T1"] / errors["T2"]}
        for t, gain in gains.items():
            yield Measured("gain", gain, name, varied={"type": t})
        found |= {f"{t} on {name}": gain for t, gain in gains.items()}
    yield Measured("claim", min(found.values()), note=_types_verdict(found))


def _types_verdict(gains: Mapping[str, float]) -> str:
    """Verdict from the gain of each type over the previous one, by type and scene; errors are known to a tenth."""
    known = 0.1  # largest error estimate of the references that the case accepts, as a fraction of an error
    worse = _named({name: gain for name, gain in gains.items() if gain < 1.0 - known})
    if worse:
        return f"does not hold: less precise than the previous type: {worse}"
    idle = _named({name: gain for name, gain in gains.items() if gain < LEAST_GAIN})
    if idle:
        return (
            "holds as the paper limits it, by manipulator and task: the error of the previous type is less than "
            f"{number(LEAST_GAIN)} times larger in {idle}"
        )
    return "holds"


def _named(gains: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number(gain)}" for name, gain in gains.items())
