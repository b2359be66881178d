"""Who is timed at Runge-Kutta steps: our compiled loop, MuJoCo's `mj_step`, and Python around Pinocchio's `aba`.

Each function prepares a run from the scene's initial state and returns work that takes so many steps of RK4.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import rollout

from flexlink import engines
from flexlink.dynamics import lanes_workspace, solver_for
from flexlink.engines.mujoco import MujocoEngine, quiet
from flexlink.errors import FlexlinkError
from flexlink.inputs import input_arrays, losses, losses_side_by_side
from flexlink.kernels.lanes import LANES
from flexlink.kernels.runge_kutta import integrate
from flexlink.scene import Scene
from flexlink.tableaus import tableau
from validation.timing.families import of_steps
from validation.timing.stopwatch import Work


def native(scene: Scene) -> Work:
    """The loop of `flexlink.simulate`."""
    chain, h = scene.chain(), scene.run.step
    work = solver_for(chain, "articulated").workspace(chain.arrays)
    fixed = chain.arrays, work, tableau("RK4").arrays, input_arrays(scene, chain), losses(chain), h
    start = scene.initial_state(chain)
    samples = *np.zeros((2, 2, chain.n)), np.zeros(2)

    def take(steps: int) -> None:
        state = start[0].copy(), start[1].copy(), np.zeros(chain.n + 1)
        _demand(scene, "flexlink", integrate(*fixed, 0, steps, steps, state, samples) == steps)

    return take


def native_batch(members: Sequence[Scene]) -> Work:
    """The loop of `flexlink.simulate_many`, on one thread: members of one chain, eight side by side."""
    scene = members[0]
    chain, h = scene.chain(), scene.run.step
    work = lanes_workspace(solver_for(chain, "articulated"), [chain])
    inputs, lost = input_arrays(scene, chain), losses_side_by_side([chain] * LANES)
    fixed = chain.arrays, work, tableau("RK4").arrays, inputs, lost, h
    starts = np.array([member.initial_state(chain) for member in members]).reshape(-1, LANES, 2, chain.n)
    blocks = np.ascontiguousarray(starts.transpose(0, 2, 3, 1))  # block, q or q̇, hinge, lane
    samples = *np.zeros((2, 2, chain.n, LANES)), np.zeros((2, LANES))

    def take(steps: int) -> None:
        for q, qd in blocks:
            state = q.copy(), qd.copy(), np.zeros((chain.n + 1, LANES))
            _demand(scene, "flexlink", integrate(*fixed, 0, steps, steps, state, samples) == steps)

    return take


def by_pinocchio(scene: Scene) -> Work:
    """The adapter's Python loop over `aba`."""
    engine = engines.load("pinocchio", scene.chain())
    return lambda steps: engine.integrate(of_steps(scene, steps))


def by_mujoco(scene: Scene) -> Work:
    """`mj_step`, many steps a call; autoreset is off in the exported file."""
    model, data, start = _loaded(scene)

    def take(steps: int) -> None:
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = start
        with quiet():
            mujoco.mj_step(model, data, steps)
        in_time = abs(data.time - steps * scene.run.step) < 0.5 * scene.run.step
        _demand(scene, "MuJoCo", in_time and not data.warning.number.any() and bool(np.isfinite(data.qpos).all()))

    return take


def by_mujoco_rollout(members: Sequence[Scene]) -> Work:
    """`mujoco.rollout` on the calling thread, all members in one call."""
    scene = members[0]
    model, data, _ = _loaded(scene)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.zeros((len(members), mujoco.mj_stateSize(model, full)))
    for row, member in zip(states, members, strict=True):
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = member.initial_state(scene.chain())
        mujoco.mj_getState(model, data, row, full)
    pool = rollout.Rollout(nthread=0)

    def take(steps: int) -> None:
        with quiet():
            found, _ = pool.rollout(model, data, states, nstep=steps)
        _demand(scene, "MuJoCo", bool(np.isfinite(found[:, -1]).all()) and not data.warning.number.any())

    return take


def _loaded(scene: Scene) -> tuple[mujoco.MjModel, mujoco.MjData, tuple[object, object]]:
    chain = scene.chain()
    engine = MujocoEngine(chain)
    engine.model.opt.timestep = scene.run.step
    return engine.model, engine.data, scene.initial_state(chain)


def _demand(scene: Scene, engine: str, stable: bool) -> None:
    if not stable:
        step = f"step = {scene.run.step:g} s"
        raise FlexlinkError(f"{scene.name}: {engine} is unstable at {step}: its time says nothing")
