"""Split the error of a run into model, space, time and rounding errors, by comparing it with ever better runs.

    run → the same chain, exact in time → the same type, infinitely many hinges → the true type, infinitely many hinges
       time                            space                                   model

Each arrow is the tip's largest distance over the samples; the total error is at most the sum of the three distances.
Rounding is part of the first arrow and also shown separately. The error of a converged run is estimated by its distance
to a run with coarser settings of the same kind.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from flexlink.results.tip_motion import largest_distance

Type = Literal["rigid", "z", "yz", "xyz"]
TYPES: Mapping[str, Type] = {"T1": "z", "T2": "yz", "T3": "xyz"}  # the paper's names

SMALL_CHANGE = 1e-10  # [rad, rad/s]; its square is below rounding error, and its effect on h q̇ and h q̈ far above


class Setup(Spec, frozen=True):
    """Settings of a run: type of the links, lumping, method, and a step [s] or a tolerance [m]."""

    flex: Type
    method: str
    rule: str = "paper"
    hinges: int = 0
    step: Positive | None = None
    tolerance: Positive | None = None

    def tip(self, scene: Scene, q0: Array | None = None, qd0: Array | None = None) -> Array:
        """Tip path, shape (samples, 3) [m], from the scene's initial state or from q0, qd0, (n,) [rad, rad/s]."""
        cut = self.scene(scene)
        return simulate(cut, method=self.method, step=self.step, tolerance=self.tolerance, q0=q0, qd0=qd0).tip

    def scene(self, scene: Scene) -> Scene:
        """The scene with flexible links of this type and lumping."""
        cut: dict[str, object] = {"flex": self.flex, "segments": self.hinges + 1}
        cut |= {} if self.flex == "rigid" else {"lumping": self.rule}
        bent = [link.name for link in scene.arm.links if link.flex != "rigid"]
        return scene.varied({f"link.{name}.{key}": value for name in bent for key, value in cut.items()})


class Fine(Spec, frozen=True):
    """Settings of a converged run, and coarser ones to estimate its error."""

    method: str
    tolerances: tuple[Positive, Positive]  # m
    rule: str = "gauss"
    hinges: tuple[int, int] = (0, 0)

    def limit(self, scene: Scene, flex: Type) -> Path:
        """Path with infinitely many hinges; for a rigid arm, which has no hinges, the path exact in time."""
        counts = (0, 0) if flex == "rigid" else self.hinges
        return self._of(scene, *(Setup(flex=flex, method=self.method, rule=self.rule, hinges=k) for k in counts))

    def in_time(self, scene: Scene, setup: Setup) -> Path:
        """Path of the setup's chain, exact in time."""
        cut = replace(setup, method=self.method, step=None)
        return self._of(scene, cut, cut)

    def _of(self, scene: Scene, *cuts: Setup) -> Path:
        fine, coarse = (
            replace(cut, tolerance=tolerance).tip(scene) for cut, tolerance in zip(cuts, self.tolerances, strict=True)
        )
        return Path(fine, largest_distance(fine, coarse))


class Path(NamedTuple):
    """Tip path, shape (samples, 3), and its error estimate [m]."""

    tip: Array
    own: float


class Part(NamedTuple):
    """A part of an error, and its error estimate [m]."""

    size: float
    own: float


class Split(NamedTuple):
    """A run's error and its parts [m]; `own` is the error estimate of the reference."""

    total: float
    own: float
    parts: dict[str, Part]
    rounding: float


class Splitter:
    """Splits errors of runs of one scene; converged runs are computed once."""

    def __init__(self, scene: Scene, true: Type, fine: Fine, in_time: Fine) -> None:
        self.scene, self.true, self.in_time = scene, true, in_time
        self.limit = cache(lambda flex: (in_time if flex == "rigid" else fine).limit(scene, flex))

    def split(self, setup: Setup) -> Split:
        """Split the error of a run into its parts."""
        tip, exact = setup.tip(self.scene), self.in_time.in_time(self.scene, setup)
        limit, truth = exact if setup.flex == "rigid" else self.limit(setup.flex), self.limit(self.true)
        parts = {
            "model": _between(limit, truth),
            "space": _between(exact, limit),
            "time": _between(Path(tip, 0.0), exact),
        }
        return Split(largest_distance(tip, truth.tip), truth.own, parts, rounding(self.scene, setup, tip))


def _between(one: Path, other: Path) -> Part:
    return Part(0.0, 0.0) if one is other else Part(largest_distance(one.tip, other.tip), one.own + other.own)


def rounding(scene: Scene, setup: Setup, tip: Array) -> float:
    """Rounding error of the tip path of this run, shape (samples, 3) [m].

    Two runs start from states that are slightly perturbed in opposite directions. To second order, the mean of their
    paths is the path of the unperturbed run; the remaining difference is due to rounding, which differs in every run.
    (Another solver for q̈ would not reveal it, because it rounds q + h q̇ in the same way.)
    """
    cut = setup.scene(scene)
    chain = lump(cut)
    q, qd = initial_state(cut, chain)
    left = []
    for direction in range(3):
        dq, dqd = SMALL_CHANGE * np.random.default_rng(direction).uniform(-1.0, 1.0, (2, chain.n))
        either = (setup.tip(scene, q + way * dq, qd + way * dqd) for way in (1.0, -1.0))
        left.append(largest_distance(np.mean(list(either), axis=0), tip))
    return max(left)
