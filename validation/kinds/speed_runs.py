"""Times of complete runs, of control loops, of calls on long chains, and of the start."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator

import mujoco
import numpy as np

from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import NonNegative, Positive
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.terms import gravity_torque
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.modal import modes
from flexlink.engines.mujoco import MujocoEngine
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from flexlink.motion.simulator import Simulator
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.runs import run_facts
from validation.sources import ROOT
from validation.speed.families import Family
from validation.speed.races import Work, processor_time, race, shortest


@kind(timed=True)
def speed(case: Case, repeats: int, solvers: tuple[str, ...], engines: tuple[str, ...] = ()) -> Iterator[Measured]:
    """Speed of a complete simulation after warm-up: the fastest of several runs.

    Yield simulated seconds per second, and time per step; `solvers` are flexlink's solvers for q̈.
    """
    for scene in case.load_scenes():
        works = {("native", solver): _runs("native", scene.varied({"run.solver": solver})) for solver in solvers}
        works |= {(name, ""): _runs(name, scene) for name in engines}
        for (name, solver), seconds in race(works, repeats, 0.0).items():
            facts: Facts = run_facts(scene.run) | ({"solver": solver} if solver else {})
            quantity = "real-time factor" if name == "native" else "real-time factor of another engine"
            yield Measured(quantity, scene.run.duration / seconds, scene.name, name, facts, timed=True)
            step = 1e6 * seconds * scene.run.fixed_step / scene.run.duration
            yield Measured("time of a step", step, scene.name, name, facts, timed=True)


def _runs(name: str, scene: Scene) -> Work:
    engine = engines.load(name, lump(scene))
    return lambda calls: [engine.integrate(scene) for _ in range(calls)]


@kind(timed=True, rehearsal={"chain": shortest, "turns": 1})
def speed_long(
    case: Case, chain: dict[str, Family], tolerance: Positive, count: int, turns: int = 5
) -> Iterator[Measured]:
    """Time of calls on long chains: a run with a tolerance, static equilibrium, the slowest modes, a linear model.

    Yield the CPU time of each call, the fastest of up to `turns`, and the exponent between two lengths.

    `tolerance` [m] is the tolerance of the run, `count` the number of modes.
    """
    for name, family in chain.items():
        before: dict[str, tuple[int, float]] = {}
        for segments in family.segments:
            scene = family.scene(case, segments)
            n = lump(scene).n
            for job, call in _calls(scene, tolerance, count).items():
                seconds = _least_cpu(call, turns)
                yield Measured(f"{name} {job}, n = {n}", 1e3 * seconds, scene.name, varied={"n": n}, timed=True)
                if job in before:
                    first, least = before[job]
                    p = math.log(seconds / least) / math.log(n / first)
                    yield Measured(f"{name} {job}: exponent", p, scene.name, varied={"n": n}, timed=True)
                before[job] = n, seconds


def _calls(scene: Scene, tolerance: float, count: int) -> dict[str, Callable[[], object]]:
    chain = lump(scene)
    driven = chain.active.tolist()
    return {
        "simulate": lambda: simulate(scene, tolerance=tolerance),
        "static": lambda: solve_static(chain, locked=driven),
        "modes": lambda: modes(chain, locked=driven, count=count),
        "linear model": lambda: linearize(chain, chain.rest),
    }


def _least_cpu(call: Callable[[], object], turns: int, enough: float = 1.0) -> float:
    """Least CPU time of up to `turns` calls [s]; stops once `enough` seconds are spent."""
    taken: list[float] = []
    while len(taken) < turns and sum(taken) < enough:
        taken.append(processor_time(call))
    return min(taken)


Law = Callable[[float, Array, Array], Array]
"""T_EX of the driven joints (d,) [N m] as a function of t [s], q and q̇ (n,)."""


@kind(timed=True, rehearsal={"turns": 1, "turn": 0.0})
def speed_loop(
    case: Case,
    steps: dict[str, Positive],
    rate: Positive,
    kp: tuple[Positive, ...],
    kd: tuple[Positive, ...],
    turns: int = 10,
    turn: NonNegative = 0.02,
) -> Iterator[Measured]:
    """A control loop in Python: a joint PD controller in NumPy, then `Simulator.step` or MuJoCo's `mj_step`.

    Both programs use the same joints and the same controller, whose time is included.

    Yield the time per sample, the sampling period relative to it, and MuJoCo's time relative to flexlink's.

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


PEAK_SCRIPT = """
import sys, flexlink
from validation.memory import peak_megabytes
scene = flexlink.load_scene(sys.argv[1])
def peak(steps):
    h = scene.run.fixed_step
    flexlink.simulate(scene, duration=steps * h, sample=steps / 100 * h)
    return peak_megabytes()
short, long = peak(int(sys.argv[2])), peak(int(sys.argv[3]))
print(long - short)
"""


@kind(timed=True, long=True)
def speed_start(case: Case, repeats: int, steps: tuple[int, int]) -> Iterator[Measured]:
    """Cold and warm start, import time, and growth of memory with the length of a run.

    Every measurement is a separate process; the cold start has an empty cache folder.

    Yield CPU times of the command, cold and warm, and of the import; and a long run's additional peak memory.

    `steps` are the numbers of steps of a short and a long run, both with 101 samples.
    """
    for scene, path in zip(case.load_scenes(), case.scene_files, strict=True):
        with tempfile.TemporaryDirectory() as folder:
            environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"XDG_CACHE_HOME": folder}
            command = [sys.executable, "-m", "flexlink", "simulate", str(path)]
            seconds, output = _timed(command, environment)
            yield Measured("cold start", seconds, scene.name, timed=True)
            yield Measured("cold start says that it compiles", float("compil" in output.lower()), scene.name)
            warm = min(_timed(command, environment)[0] for _ in range(repeats))
            yield Measured("warm start", warm, scene.name, timed=True)
            importing = [sys.executable, "-c", "import flexlink"]
            again = (_timed(importing, environment)[0] for _ in range(repeats))
            yield Measured("import", min(again), timed=True)
        short, long = steps
        growth = _timed([sys.executable, "-c", PEAK_SCRIPT, str(path), str(short), str(long)], dict(os.environ))[1]
        note = f"Against {short:,} steps; 101 samples both."
        yield Measured("growth of memory", float(growth.split()[-1]), scene.name, varied={"steps": long}, note=note)


def _timed(command: list[str], environment: dict[str, str]) -> tuple[float, str]:
    """CPU time of a process from start to end, and its output."""
    start = os.times()
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    end = os.times()
    seconds = end.children_user - start.children_user + end.children_system - start.children_system
    return seconds, done.stderr + done.stdout
