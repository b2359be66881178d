"""Statements of the paper about its equations, for many arms and states: freedoms, indices, springs, mass matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.dynamics import rounding
from validation.case import Case, Measured
from validation.trade.error_parts import TYPES

NEGLIGIBLE_TORQUE = 1e-9  # fraction of the springs' torques: far above rounding error, far below any relevant force


class Settings(Spec, frozen=True):
    """The statement to check on the case's scenes, and the numbers of links, segments or states to check it on.

    Random angles are within ± `bend` [deg].
    """

    check: Literal["freedoms", "indices", "springs", "definite"]
    links: int = 1
    segments: tuple[int, int] = (2, 2)
    samples: int = 1
    bend: float = 180.0
    seed: int = 0


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Yield the measured values and the verdict on the paper's statement."""
    yield from CHECKS[settings.check](case, settings)


def _freedoms(case: Case, settings: Settings) -> Iterator[Measured]:
    """Compare equation 1 with the number of joints of the chain, arm by arm."""
    apart = [
        abs(chain.n - (n * (tip * (nseg - 1) + 1) - tip * (nseg - 1))) for chain, n, tip, nseg in _arms(case, settings)
    ]
    verdict = "holds" if max(apart) == 0 else "does not hold"
    yield Measured("claim", max(apart), varied={"arms": len(apart)}, note=verdict)


def _indices(case: Case, settings: Settings) -> Iterator[Measured]:
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


def _arms(case: Case, settings: Settings) -> Iterator[tuple[fl.Chain, int, int, int]]:
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


def _springs(case: Case, settings: Settings) -> Iterator[Measured]:
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


def _definite(case: Case, settings: Settings) -> Iterator[Measured]:
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


def _postures(chain: fl.Chain, settings: Settings) -> Array:
    bend = np.radians(settings.bend)
    return np.random.default_rng(settings.seed).uniform(-bend, bend, (settings.samples, chain.n))


def _definiteness(chain: fl.Chain, q: Array) -> float:
    eigenvalues = np.linalg.eigvalsh(fl.mass_matrix(chain, q))
    return float(eigenvalues[0] / np.abs(eigenvalues).max())


CHECKS: dict[str, Callable[[Case, Settings], Iterator[Measured]]] = {
    "freedoms": _freedoms,
    "indices": _indices,
    "springs": _springs,
    "definite": _definite,
}
