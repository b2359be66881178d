"""Timed Runge-Kutta steps: flexlink's compiled loop, MuJoCo's `mj_step`, and a Python loop over Pinocchio's `aba`.

Each function prepares a run from the scene's initial state and returns a job that takes a number of steps of RK4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from mujoco import rollout

from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.accelerations import lanes_workspace, solver_for
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines.mujoco import MujocoEngine, quiet
from flexlink.engines.pinocchio import PinocchioEngine
from flexlink.formats.mjcf import to_mjcf
from flexlink.kernels.stepping.runge_kutta import integrate
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.inputs.drives import side_by_side
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from validation.speed.evaluations import from_python
from validation.speed.races import Work


def native(scene: Scene) -> Work:
    """The loop of `flexlink.simulate`."""
    problem = problem_of(scene)
    return _loop(problem, problem.workspace(), np.array([[problem.q, problem.qd]]))


def native_batch(members: Sequence[Scene]) -> Work:
    """The loop of `flexlink.simulate_many` on one thread; members have the same chain, and eight run in parallel."""
    problem = problem_of(members[0])
    chain = problem.chain
    work = lanes_workspace(solver_for(chain, "articulated"), [chain])
    starts = np.array([initial_state(member, chain) for member in members]).reshape(-1, LANES, 2, chain.n)
    return _loop(problem, work, np.ascontiguousarray(starts.transpose(0, 2, 3, 1)))


def _loop(problem: InitialValueProblem, work: Any, starts: Array) -> Work:
    """Integrate from each of the initial states (runs, 2, n), or from eight in parallel (blocks, 2, n, 8)."""
    lanes, inputs = starts.shape[3:], problem.inputs
    if lanes:
        inputs = inputs._replace(drive=side_by_side([inputs.drive]))
    fixed = work, method("RK4").arrays, inputs, problem.run.fixed_step, 0
    samples = *np.zeros((2, 2, problem.chain.n, *lanes)), np.zeros((2, *lanes))

    def take(steps: int) -> None:
        for q, qd in starts:
            state = q.copy(), qd.copy(), np.zeros((1, *lanes))
            _demand(problem.scene, "flexlink", integrate(*fixed, 0, steps, np.inf, steps, state, samples) == steps)

    return take


def by_pinocchio(scene: Scene) -> Work:
    """A plain Python loop over `aba`, four calls per step, for an arm without drive; set up once."""
    chain, h = lump(scene), scene.run.fixed_step
    engine = PinocchioEngine(chain)
    model, data, k, d = engine.model, engine.data, engine.stiffness, engine.damping
    more = engine.coulomb.any() or len(engine.couplings)
    if scene.drive.kind != "none" or scene.motion or scene.tip_wrench.any() or more:
        raise FlexlinkError(
            f"{scene.name}: Pinocchio is timed only without drive, prescribed motion, wrench, dry friction and cells"
        )
    start, rest = initial_state(scene, chain), k * engine.rest

    def acceleration(q: Array, qd: Array) -> Array:
        found: Array = pin.aba(model, data, q, qd, rest - k * q - d * qd)
        return found

    def take(steps: int) -> Array:
        q, v1 = start
        for _ in range(steps):
            a1 = acceleration(q, v1)
            v2 = v1 + 0.5 * h * a1
            a2 = acceleration(q + 0.5 * h * v1, v2)
            v3 = v1 + 0.5 * h * a2
            a3 = acceleration(q + 0.5 * h * v2, v3)
            v4 = v1 + h * a3
            a4 = acceleration(q + h * v3, v4)
            q, v1 = q + h / 6 * (v1 + 2 * (v2 + v3) + v4), v1 + h / 6 * (a1 + 2 * (a2 + a3) + a4)
        _demand(scene, "Pinocchio", bool(np.isfinite(q).all()))
        return q

    return take


def by_mujoco(scene: Scene) -> Work:
    """`mj_step` with many steps per call; autoreset is off in the exported file."""
    model, data, start = _loaded(scene)

    return lambda steps: take_in_mujoco(scene, model, data, start, steps)


def take_in_mujoco(
    scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, start: tuple[Any, Any], steps: int
) -> None:
    """Take `steps` steps of a scene from the initial state q, q̇."""
    mujoco.mj_resetData(model, data)
    data.qpos, data.qvel = start
    with quiet():
        mujoco.mj_step(model, data, steps)
    in_time = abs(data.time - steps * scene.run.fixed_step) < 0.5 * scene.run.fixed_step
    _demand(scene, "MuJoCo", in_time and not data.warning.number.any() and bool(np.isfinite(data.qpos).all()))


def by_mujoco_rollout(members: Sequence[Scene]) -> Work:
    """`mujoco.rollout` on the calling thread, all members in one call."""
    scene = members[0]
    model, data, _ = _loaded(scene)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.zeros((len(members), mujoco.mj_stateSize(model, full)))
    for row, member in zip(states, members, strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = initial_state(member, lump(scene))
        mujoco.mj_getState(model, data, row, full)
    pool = rollout.Rollout(nthread=0)

    def take(steps: int) -> None:
        with quiet():
            found, _ = pool.rollout(model, data, states, nstep=steps)
        _demand(scene, "MuJoCo", bool(np.isfinite(found[:, -1]).all()) and not data.warning.number.any())

    return take


def _loaded(scene: Scene) -> tuple[mujoco.MjModel, mujoco.MjData, tuple[Any, Any]]:
    chain = lump(scene)
    engine = MujocoEngine(chain)
    engine.model.opt.timestep = scene.run.fixed_step
    return engine.model, engine.data, initial_state(scene, chain)


def _demand(scene: Scene, engine: str, stable: bool) -> None:
    if not stable:
        step = f"step = {scene.run.fixed_step:g} s"
        raise FlexlinkError(f"{scene.name}: {engine} is unstable at {step}: its time is meaningless")


def mujoco_sweep(members: Sequence[Scene]) -> Mapping[str, Work]:
    """Jobs that cycle through the members and run each to its end by RK4 with its own step."""
    texts = [_mjcf(scene) for scene in members]
    models = list(map(_compiled, texts))
    starts = [initial_state(scene, lump(scene)) for scene in members]
    datas = list(map(mujoco.MjData, models))

    def run(k: int) -> None:
        _run_in_mujoco(members[k], models[k], datas[k], starts[k])

    def compile_and_run(k: int) -> None:
        model = _compiled(texts[k])
        _run_in_mujoco(members[k], model, mujoco.MjData(model), starts[k])

    def write_compile_and_run(k: int) -> None:
        model = _compiled(_mjcf(members[k]))
        _run_in_mujoco(members[k], model, mujoco.MjData(model), initial_state(members[k], lump(members[k])))

    each = {"run": run, "compile, run": compile_and_run, "write, compile, run": write_compile_and_run}
    return {name: from_python(one, len(members)) for name, one in each.items()}


def _mjcf(scene: Scene) -> str:
    return to_mjcf(lump(scene), shapes=False)


def _compiled(text: str) -> mujoco.MjModel:
    with quiet():
        return mujoco.MjModel.from_xml_string(text)


def _run_in_mujoco(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, start: tuple[Any, Any]) -> None:
    model.opt.timestep = scene.run.fixed_step
    take_in_mujoco(scene, model, data, start, round(scene.run.duration / scene.run.fixed_step))
