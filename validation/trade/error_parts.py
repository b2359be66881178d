"""The error of a run split into model, space, time and rounding, each against a run converged in that part.

    run → the same chain, exact in time → the same type, infinitely many hinges → the true type, infinitely many hinges
       time                            space                                   model

Every arrow is a distance, the largest of the tip's over the samples, so that the total is at most their sum. Rounding
is a part of the first arrow, and shown apart. What stands for infinitely many and for exact says its own error: its
distance from what a coarser choice of the same kind gives.
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
TYPES: Mapping[str, Type] = {"T1": "z", "T2": "yz", "T3": "xyz"}  # as the paper calls them

SMALL_CHANGE = 1e-10  # rad, rad/s: its square is below a rounding, its changes of h q̇ and h q̈ far above


class Setup(Spec, frozen=True):
    """How a run is made: type of the links, lumping, method, and a step [s] or a tolerance [m]."""

    flex: Type
    method: str
    rule: str = "paper"
    hinges: int = 0
    step: Positive | None = None
    tolerance: Positive | None = None

    def tip(self, scene: Scene, q0: Array | None = None, qd0: Array | None = None) -> Array:
        """The tip's path by it, shape (samples, 3) [m], from the scene's start or this one, (n,) [rad, rad/s]."""
        cut = self.scene(scene)
        return simulate(cut, method=self.method, step=self.step, tolerance=self.tolerance, q0=q0, qd0=qd0).tip

    def scene(self, scene: Scene) -> Scene:
        """The scene with its flexible links of this type, cut so."""
        cut: dict[str, object] = {"flex": self.flex, "segments": self.hinges + 1}
        cut |= {} if self.flex == "rigid" else {"lumping": self.rule}
        bent = [link.name for link in scene.arm.links if link.flex != "rigid"]
        return scene.varied({f"link.{name}.{key}": value for name in bent for key, value in cut.items()})


class Fine(Spec, frozen=True):
    """What counts as converged, and the coarser choice from which its own error is told."""

    method: str
    tolerances: tuple[Positive, Positive]  # m
    rule: str = "gauss"
    hinges: tuple[int, int] = (0, 0)

    def limit(self, scene: Scene, flex: Type) -> Path:
        """Infinitely many hinges; of a rigid arm, which has none, exact in time."""
        counts = (0, 0) if flex == "rigid" else self.hinges
        return self._of(scene, *(Setup(flex=flex, method=self.method, rule=self.rule, hinges=k) for k in counts))

    def in_time(self, scene: Scene, setup: Setup) -> Path:
        """The chain of a run, exact in time."""
        cut = replace(setup, method=self.method, step=None)
        return self._of(scene, cut, cut)

    def _of(self, scene: Scene, *cuts: Setup) -> Path:
        fine, coarse = (
            replace(cut, tolerance=tolerance).tip(scene) for cut, tolerance in zip(cuts, self.tolerances, strict=True)
        )
        return Path(fine, largest_distance(fine, coarse))


class Path(NamedTuple):
    """The tip's path, shape (samples, 3), and how far it may be from what it stands for [m]."""

    tip: Array
    own: float


class Part(NamedTuple):
    """A part of an error, and how far it may be from its true size [m]."""

    size: float
    own: float


class Split(NamedTuple):
    """A run's error and its parts [m]; `own` is the reference's own error."""

    total: float
    own: float
    parts: dict[str, Part]
    rounding: float


class Splitter:
    """Splits errors of runs of one scene; what is converged is computed once."""

    def __init__(self, scene: Scene, true: Type, fine: Fine, in_time: Fine) -> None:
        self.scene, self.true, self.in_time = scene, true, in_time
        self.limit = cache(lambda flex: (in_time if flex == "rigid" else fine).limit(scene, flex))

    def split(self, setup: Setup) -> Split:
        """The error of a run, and its parts."""
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
    """What rounding does to the path of the tip by this run, shape (samples, 3) [m].

    Moved a little one way and the other at the start, two runs have the path of the run between them as their mean, up
    to a square, but every run has roundings of its own: what is left is theirs. (Another solver for q̈ would not tell
    them: it rounds q + h q̇ alike.)
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
