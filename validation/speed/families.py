"""Families of chains, each from one scene with more and more segments in its flexible links."""

from __future__ import annotations

from typing import Any, NamedTuple

import msgspec
import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.dynamics.vibration.stability import stable_step
from validation.case import Case
from validation.physics.variant import Rule, Variant


class Family(Spec, frozen=True):
    """The case's scene varied by `change`, its numbers of segments per link, and the largest number for each engine."""

    segments: tuple[int, ...]
    pinocchio: int = 0
    mujoco: int = 0
    change: dict[str, Any] = msgspec.field(default_factory=dict)
    rule: str = "paper"

    def scene(self, case: Case, segments: int) -> Scene:
        """The scene with `segments` segments per link."""
        return Variant(change=self.change).build(case, Rule(rule=self.rule, hinges=segments - 1))

    def released(self, case: Case, segments: int) -> Scene:
        """The scene with RK4 at a stable step, half the largest one of the shortest chain times (n₀/n)².

        In the fastest mode, neighbouring hinges bend in opposite directions; the frequency grows at most with n².
        """
        first = min(self.segments)
        chain = lump(self.scene(case, first))
        step = 0.5 * stable_step(chain, np.linspace(0.1, 0.4, chain.n), method="RK4") * (first / segments) ** 2
        return of_steps(self.scene(case, segments), 0, step)


def of_steps(scene: Scene, steps: int, step: float | None = None) -> Scene:
    """The scene with `steps` steps of RK4, sampled at the start and the end; the step [s] defaults to the scene's."""
    h = step or scene.run.fixed_step
    return scene.varied({"run": RunSettings(method="RK4", step=h, duration=steps * h, sample=max(steps, 1) * h)})


class States(NamedTuple):
    """Random states: angles over the full range, rates to 10 rad/s, torques to 10 N m, accelerations to 10 rad/s²."""

    q: Array
    qd: Array
    tau: Array
    qdd: Array


def timed_states(chain: Chain, count: int = 2) -> States:
    """Random states, arrays of shape (count, n); a loop cycles through them, so no call repeats the previous one."""
    random = np.random.default_rng(0)
    return States(random.uniform(-np.pi, np.pi, (count, chain.n)), *random.uniform(-10.0, 10.0, (3, count, chain.n)))
