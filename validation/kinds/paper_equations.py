"""What the paper says of its equations, over many arms and states: freedoms, torques of springs, the mass matrix."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.dynamics import rounding
from validation.case import Case, Measured

Array = NDArray[np.float64]

TYPES = {"T1": "z", "T2": "yz", "T3": "xyz"}
LOCK = np.pi / 2  # of the middle angle of a group of three axes


class Settings(Spec, frozen=True):
    """What is checked, on the case's scenes: arms of up to so many links with so many segments, or so many states.

    `bend` is the range of angles [deg].
    """

    check: Literal["freedoms", "springs", "definite"]
    links: int = 1
    segments: tuple[int, int] = (2, 2)
    samples: int = 1
    bend: float = 180.0
    seed: int = 0


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """What was measured, and what becomes of the claim."""
    yield from CHECKS[settings.check](case, settings)


def _freedoms(case: Case, settings: Settings) -> Iterator[Measured]:
    """Equation 1 against the joints of the chain, arm by arm."""
    (scene,) = case.load_scenes()
    first, last = settings.segments
    apart = [
        abs(fl.lump(_arm_of(scene, n, flex, nseg)).n - (n * (tip * (nseg - 1) + 1) - tip * (nseg - 1)))
        for n in range(1, settings.links + 1)
        for tip, flex in enumerate(TYPES.values(), start=1)
        for nseg in range(first, last + 1)
    ]
    verdict = "holds" if max(apart) == 0 else "does not hold"
    yield Measured("claim", max(apart), varied={"arms": len(apart)}, note=verdict)


def _arm_of(scene: Scene, n: int, flex: str, nseg: int) -> Scene:
    """An arm of n links like the scene's last one, the first rigid, the others of this type and so many segments."""
    link = scene.arm.links[-1]
    bent = [replace(link, name=f"{k}", flex=flex, segments=nseg) for k in range(1, n)]
    links = (replace(link, name="first", flex="rigid", segments=1), *bent)
    return replace(
        scene, arm=replace(scene.arm, links=links), initial=fl.Initial(joint_deg=(0.0,) * n), drive=fl.Drive()
    )


def _springs(case: Case, settings: Settings) -> Iterator[Measured]:
    """T_GC without gravity and rates, beside T_FL."""
    parts = []
    for scene in case.load_scenes():
        chain = fl.lump(scene.varied({"gravity": [0.0, 0.0, 0.0]}))
        q = _postures(chain, settings)
        left, springs = (
            np.abs(part).max(axis=1) for part in (fl.gravity_torque(chain, q), fl.elastic_torque(chain, q))
        )
        parts.append(float((left / springs).max()))
        yield Measured("T_GC / T_FL", parts[-1], scene.name)
    yield Measured("claim", max(parts), note=_of_springs(max(parts)))


def _of_springs(part: float) -> str:
    return "does not hold: nothing is left of it; T_FL is read as k (θ − θ₀)" if part < 0.5 else "holds"


def _definite(case: Case, settings: Settings) -> Iterator[Measured]:
    """Smallest eigenvalue of M over the largest, in random postures, and where a group of three axes is bent to 90°."""
    (scene,) = case.load_scenes()
    for name, flex in TYPES.items():
        chain = fl.lump(_of_type(scene, flex))
        postures = _postures(chain, settings)
        least = min(_definiteness(chain, q) for q in postures)
        yield Measured("least eigenvalue", least, scene.name, varied={"chain": name, "states": len(postures)})
    locked = postures[0].copy()
    locked[chain.index(len(scene.arm.links), 1, 2)] = LOCK
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
    return float(eigenvalues[0] / eigenvalues[-1])


def _of_type(scene: Scene, flex: str) -> Scene:
    return scene.varied({f"link.{link.name}.flex": flex for link in scene.arm.links if link.flex != "rigid"})


CHECKS: dict[str, Callable[[Case, Settings], Iterator[Measured]]] = {
    "freedoms": _freedoms,
    "springs": _springs,
    "definite": _definite,
}
