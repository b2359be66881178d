"""A control loop in Python: a joint PD controller in NumPy, then `Simulator.step` or MuJoCo's `mj_step`.

Both programs use the same joints and the same controller, whose time is included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np
from msgspec.structs import replace

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import NonNegative, Positive
from flexlink.dynamics.terms import gravity_torque
from flexlink.engines.mujoco import MujocoEngine
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulator import Simulator
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed.races import Work, race

TIMED = True

Law = Callable[[float, Array, Array], Array]
"""T_EX of the driven joints (d,) [N m] as a function of t [s], q and q̇ (n,)."""


def rehearsal(settings: Any) -> Any:
    """Settings for a rehearsal: every method for one sample."""
    return replace(settings, turns=1, turn=0.0)


def run(
    case: Case,
    steps: dict[str, Positive],
    rate: Positive,
    kp: tuple[Positive, ...],
    kd: tuple[Positive, ...],
    turns: int = 10,
    turn: NonNegative = 0.02,
) -> Iterator[Measured]:
    """Yield the time per sample, the sampling period relative to it, and MuJoCo's time relative to flexlink's.

    `steps` are the steps of the methods [s], `rate` is the rate of the loop [Hz], `kp` [N m/rad] and `kd` [N m s/rad]
    are the gains of the driven joints; each program runs `turns` times, for `turn` [s] or longer.
    """
    between = 1.0 / rate
    for scene in case.load_scenes():
        for method, step in steps.items():
            own = scene.varied({"run.method": method, "run.step": step})
            chain = lump(own)
            law = _pd(own, chain, np.array(kp), np.array(kd))
            works = {"native": _native(own, law, between)}
            if method == "RK4":
                works["mujoco"] = _mujoco(own, chain, law, between)
            seconds = race(works, turns, turn)
            facts: Facts = {"method": method, "step": step, "n": chain.n}
            for party, of_sample in seconds.items():
                yield Measured("time of a sample", 1e6 * of_sample, scene.name, party, facts, timed=True)
            ours = seconds.pop("native")
            yield Measured(f"{method}: times real time", between / ours, scene.name, "native", facts, timed=True)
            for party, theirs in seconds.items():
                yield Measured(f"{party} / native", theirs / ours, scene.name, party, facts, timed=True)


def _pd(scene: Scene, chain: Chain, kp: Array, kd: Array) -> Law:
    """PD controller with targets that oscillate about the initial angles, where it compensates gravity."""
    driven, (start, _) = chain.active, initial_state(scene, chain)
    target, hold = start[driven], gravity_torque(chain, start)[driven]
    swing = 0.1  # rad, at 1 Hz
    return lambda t, q, qd: hold + kp * (target + swing * math.sin(2 * math.pi * t) - q[driven]) - kd * qd[driven]


def _native(scene: Scene, law: Law, between: float) -> Work:
    simulator = Simulator(scene)

    def work(calls: int) -> None:
        state = simulator.state
        for _ in range(calls):
            state = simulator.step(law(*state), duration=between)

    return work


def _mujoco(scene: Scene, chain: Chain, law: Law, between: float) -> Work:
    engine, driven = MujocoEngine(chain), chain.active
    model, data, steps = engine.model, engine.data, round(between / scene.run.fixed_step)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, scene.run.fixed_step
    data.qpos, data.qvel = initial_state(scene, chain)

    def work(calls: int) -> None:
        for _ in range(calls):
            data.qfrc_applied[driven] = law(data.time, data.qpos, data.qvel)
            mujoco.mj_step(model, data, steps)

    return work
