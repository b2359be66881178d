"""Times of single calls and steps, compared with MuJoCo and Pinocchio."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping

import numpy as np

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Fact, Facts
from validation.kinds import kind
from validation.speed import evaluations, races, steps
from validation.speed.evaluations import FORWARD, RNE, from_python
from validation.speed.families import Family, of_steps, timed_states
from validation.speed.races import Jobs, Race, Races, clock, race
from validation.store import Series

OURS = ("native", "public")  # kernels in a compiled loop; checked functions called from Python
PLAIN = "revolute joints, local"  # default of `pin.aba` with a chain read from a file
PINOCCHIO, FASTEST = "pinocchio", "pinocchio, fastest"


@kind(timed=True, rehearsal=races.REHEARSAL)
def speed_calls(case: Case, settings: Races) -> Iterator[Measured | Series]:
    """Time of one evaluation of q̈, RNE, M and T_GC against n: flexlink compiled and from Python, engines from Python.

    Yield times, ratios of other programs' times to flexlink's, exponents of n, and a series for every job.
    """
    found: list[Race] = []
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        for one in settings.run(name, chain.n, _contestants(chain, family, segments)):
            forms = {form: seconds for form, seconds in one.seconds.items() if form not in (*OURS, "mujoco")}
            form_of = {PINOCCHIO: PLAIN, FASTEST: min(forms, key=forms.__getitem__)} if forms else {}
            seconds = {name: each for name, each in one.seconds.items() if name not in forms}
            found.append(one._replace(seconds=seconds | {name: forms[form] for name, form in form_of.items()}))
            yield from _rows(found[-1], form_of, segments == family.segments[0])
    yield from races.growth(found)


def _contestants(chain: Chain, family: Family, segments: int) -> dict[str, Jobs]:
    """Calls to be timed: native, public, MuJoCo, each form of Pinocchio; beyond the engines' limits only O(n) jobs."""
    states = timed_states(chain)
    found = {"native": evaluations.native(chain, states), "public": evaluations.public(chain, states)}
    if segments <= family.mujoco:
        found["mujoco"] = evaluations.mujoco_calls(chain, states)
    if segments <= family.pinocchio:
        return found | evaluations.pinocchio(chain, states)
    return {name: {job: jobs[job] for job in (FORWARD, RNE)} for name, jobs in found.items()}


def _rows(found: Race, form_of: Mapping[str, str], first: bool) -> Iterator[Measured]:
    what = f"{found.chain} {found.job}"
    if first:
        yield Measured(f"{what}: public call", 1e6 * found.seconds["public"], varied=found.facts, timed=True)
    for name in (name for name in found.seconds if name not in OURS):
        facts = found.facts | ({"form": form_of[name]} if name in form_of else {})
        for our in OURS:
            yield Measured(f"{what}: {name} / {our}", found.times_less(our, name), "", name, facts, timed=True)


@kind(timed=True, rehearsal=races.REHEARSAL)
def speed_derivatives(case: Case, settings: Races) -> Iterator[Measured]:
    """Time of exact derivatives, ∂q̈/∂(q, q̇, T_EX) and ∂τ/∂(q, q̇, q̈), compared with Pinocchio called from Python.

    Yield flexlink's times, and the ratios of Pinocchio's times to them, with Pinocchio's fastest joint type.
    """
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        for found in settings.run(name, chain.n, evaluations.derivatives(chain, timed_states(chain))):
            ours, *forms = found.seconds
            fastest = min(forms, key=found.seconds.__getitem__)
            what, ratio = f"{name} {found.job}", found.times_less(ours, fastest)
            yield Measured(f"{what}: pinocchio / public", ratio, "", fastest, found.facts, timed=True)
            yield Measured(f"{what}: public call", 1e6 * found.seconds[ours], varied=found.facts, timed=True)


class SpeedStepsSettings(Races, frozen=True):
    """The timing comparisons; segments of the longest chains, and their number of steps."""

    longest: dict[str, int]
    longest_steps: int


@kind(timed=True)
def speed_steps(case: Case, settings: SpeedStepsSettings) -> Iterator[Measured | Series]:
    """Time per Runge-Kutta step of complete simulations against n, compared with `mj_step` and a loop over `pin.aba`.

    Every run must remain stable: the number of steps and the state are checked at its end.

    Yield times per step, ratios, exponents, a series, and runs of the longest chains.
    """
    found: list[Race] = []
    for name, family, segments in settings.sizes():
        scene = family.released(case, segments)
        works = {"native": steps.native(scene)}
        if segments <= family.mujoco:
            works["mujoco"] = steps.by_mujoco(scene)
        if segments <= family.pinocchio:
            works["pinocchio"] = steps.by_pinocchio(scene)
        n = lump(scene).n
        found += settings.run(name, n, {engine: {"RK4 step": work} for engine, work in works.items()})
        facts: Facts = {"chain": name, "n": n}
        for other in list(works)[1:]:
            ratio = found[-1].times_less("native", other)
            yield Measured(f"{name}, n = {n}: {other} / native", ratio, "", other, facts, timed=True)
    yield from races.growth(found)
    for name, segments in settings.longest.items():
        scene = of_steps(settings.chain[name].released(case, segments), settings.longest_steps)
        start = time.perf_counter()
        end = simulate(scene)  # raises an error if it becomes non-finite
        seconds = time.perf_counter() - start
        facts = {"chain": name, "n": end.chain.n}
        yield Measured("steps of the longest chain", float(end.t[-1] / scene.run.fixed_step), varied=facts)
        yield Measured("run of the longest chain", seconds, varied=facts, timed=True)


class SpeedBatchSettings(Races, frozen=True):
    """The timing comparisons; number of members (a multiple of 8), and steps of a complete run."""

    members: int
    steps: int


@kind(timed=True, rehearsal={"members": LANES, "steps": 1, "turns": 1, "turn": 0.0})
def speed_batch(case: Case, settings: SpeedBatchSettings) -> Iterator[Measured]:
    """Time of many runs on one thread: the loop of `simulate_many`, MuJoCo's `rollout` and `mj_step`.

    Yield times of an RK4 step and of q̈ per member on one core, and the ratio of MuJoCo's faster way to flexlink.
    """
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
        for engine, of_step in per_member.items():
            yield Measured("time of a step per member", of_step, "", engine, facts, timed=True)
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


def _evaluation(scene: Scene, settings: SpeedBatchSettings) -> float:
    """Time of q̈ of all members by one public call, per member [µs]."""
    chain = fl.lump(scene)
    q, qd, tau, _ = timed_states(chain, settings.members)
    work = from_python(lambda _: fl.forward_dynamics(chain, q, qd, tau), 1)
    return 1e6 * race({"native": work}, settings.turns, settings.turn)["native"] / settings.members
