"""Time of many runs on one thread: the loop of `simulate_many`, MuJoCo's `rollout` and `mj_step`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.describe.scene import Scene
from flexlink.kernels.tools.lanes import LANES
from validation.case import Case, Measured
from validation.facts import Fact
from validation.speed import steps
from validation.speed.evaluations import from_python
from validation.speed.families import of_steps, timed_states
from validation.speed.races import Races, clock, race

TIMED = True


class Settings(Races, frozen=True):
    """The timing comparisons; number of members (a multiple of 8), and steps of a complete run."""

    members: int
    steps: int


def rehearsal(settings: Settings) -> Settings:
    """Settings with few members and steps, whose time is mostly compilation."""
    return replace(settings, members=LANES, steps=1, turns=1, turn=0.0)


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Yield times of an RK4 step and of q̈ per member on one core, and the ratio of MuJoCo's faster way to flexlink."""
    for name, family in settings.chain.items():
        scene = family.released(case, family.segments[0])
        members = _members(scene, settings.members)
        works = {
            "native": steps.native_batch(members),
            "mujoco, rollout": steps.by_mujoco_rollout(members),
            "mujoco, mj_step": steps.by_mujoco(scene),
        }
        seconds = race(works, settings.turns, settings.turn)
        per_member = {e: 1e6 * s / (1 if e == "mujoco, mj_step" else len(members)) for e, s in seconds.items()}
        facts: dict[str, Fact] = {"chain": name, "n": fl.lump(scene).n, "members": len(members)}
        for engine, time in per_member.items():
            yield Measured("time of a step per member", time, "", engine, facts, timed=True)
        ours = per_member.pop("native")
        best = min(per_member, key=per_member.__getitem__)
        yield Measured("mujoco / native", per_member[best] / ours, "", best, facts, timed=True)
        many = [of_steps(member, settings.steps) for member in members]
        whole = 1e6 * clock(lambda _, many=many: fl.simulate_many(many), 1) / len(many) / settings.steps  # type: ignore[misc]
        with_steps = facts | {"steps": settings.steps}
        yield Measured("time of a step per member, all included", whole, varied=with_steps, timed=True)
        yield Measured(
            "forward dynamics per member, public call", _evaluation(scene, settings), varied=facts, timed=True
        )


def _members(scene: Scene, count: int) -> list[Scene]:
    """The scene with different initial angles, over a range of 10°."""
    last = f"initial.joint_deg.{len(scene.arm.links)}"
    angles = scene.initial.joint_deg[-1] + np.linspace(-5.0, 5.0, count)
    return [scene.varied({last: angle}) for angle in angles]


def _evaluation(scene: Scene, settings: Settings) -> float:
    """Time of q̈ of all members by one public call, per member [µs]."""
    chain = fl.lump(scene)
    q, qd, tau, _ = timed_states(chain, settings.members)
    work = from_python(lambda _: fl.forward_dynamics(chain, q, qd, tau), 1)
    return 1e6 * race({"native": work}, settings.turns, settings.turn)["native"] / settings.members
