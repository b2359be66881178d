"""Timed evaluations: kernels in a compiled loop; public functions, Pinocchio and MuJoCo called from Python.

Each function below returns the calls to be timed for a chain and states, by job (q̈, RNE, M, …).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.dynamics.accelerations import solver_for
from flexlink.engines.mujoco import MujocoEngine
from validation.speed import compiled_loops, pinocchio_models
from validation.speed.families import States
from validation.speed.races import Jobs, Work

FORWARD, RNE, MASS, BIAS = "forward dynamics", "RNE", "M", "T_GC"
OF_FORWARD, OF_INVERSE = "∂q̈", "∂τ"


def native(chain: Chain, states: States) -> Jobs:
    """The kernels in a compiled loop."""
    q, qd, tau, qdd = states
    work, arrays, rest = solver_for(chain, "articulated").workspace(chain.arrays), chain.arrays, np.zeros_like(qdd)
    return {
        FORWARD: lambda calls: compiled_loops.forward_dynamics_loop(work, q, qd, tau, calls),
        RNE: lambda calls: compiled_loops.rne_loop(arrays, q, qd, qdd, calls),
        MASS: lambda calls: compiled_loops.mass_loop(arrays, q, calls),
        BIAS: lambda calls: compiled_loops.rne_loop(arrays, q, qd, rest, calls),
    }


def public(chain: Chain, states: States) -> Jobs:
    """The checked functions, called from Python."""
    q, qd, tau, qdd = (list(part) for part in states)
    return {
        FORWARD: from_python(lambda s: fl.forward_dynamics(chain, q[s], qd[s], tau[s]), len(q)),
        RNE: from_python(lambda s: fl.inverse_dynamics(chain, q[s], qd[s], qdd[s]), len(q)),
        MASS: from_python(lambda s: fl.mass_matrix(chain, q[s]), len(q)),
        BIAS: from_python(lambda s: fl.bias_torque(chain, q[s], qd[s]), len(q)),
    }


def pinocchio(chain: Chain, states: States) -> dict[str, Jobs]:
    """Pinocchio with each type of joints that fits, and in both conventions if an algorithm has two."""
    found: dict[str, Jobs] = {}
    for name, (model, sign) in pinocchio_models.build_all(chain).items():
        data = pin.Data(model)  # createData would make a second one: 2 GB at n = 400
        q, qd, tau, qdd = (list(part * sign) for part in states)
        for convention in (pin.Convention.LOCAL, pin.Convention.WORLD):
            found[f"{name}, {convention.name.lower()}"] = _pinocchio_jobs(model, data, (q, qd, tau, qdd), convention)
    return found


def _pinocchio_jobs(model: Any, data: Any, states: Any, convention: Any) -> Jobs:
    q, qd, tau, qdd = states
    jobs = {
        FORWARD: from_python(lambda s: pin.aba(model, data, q[s], qd[s], tau[s], convention), len(q)),
        MASS: from_python(lambda s: pin.crba(model, data, q[s], convention), len(q)),
    }
    if convention == pin.Convention.LOCAL:  # RNE and nle have no convention
        jobs[RNE] = from_python(lambda s: pin.rnea(model, data, q[s], qd[s], qdd[s]), len(q))
        jobs[BIAS] = from_python(lambda s: pin.nle(model, data, q[s], qd[s]), len(q))
    return jobs


def derivatives(chain: Chain, states: States) -> dict[str, Jobs]:
    """Exact derivatives by public calls, and by Pinocchio with each type of joints that fits."""
    q, qd, tau, qdd = (list(part) for part in states)
    found = {
        "public": {
            OF_FORWARD: from_python(lambda s: fl.forward_dynamics_derivatives(chain, q[s], qd[s], tau[s]), len(q)),
            OF_INVERSE: from_python(lambda s: fl.inverse_dynamics_derivatives(chain, q[s], qd[s], qdd[s]), len(q)),
        }
    }
    for name, (model, sign) in pinocchio_models.build_all(chain).items():
        found[name] = _pinocchio_derivatives(model, [list(part * sign) for part in states])
    return found


def _pinocchio_derivatives(model: Any, states: list[list[Any]]) -> Jobs:
    (q, qd, tau, qdd), data = states, pin.Data(model)
    return {
        OF_FORWARD: from_python(lambda s: pin.computeABADerivatives(model, data, q[s], qd[s], tau[s]), len(q)),
        OF_INVERSE: from_python(lambda s: pin.computeRNEADerivatives(model, data, q[s], qd[s], qdd[s]), len(q)),
    }


def mujoco_calls(chain: Chain, states: States) -> Jobs:
    """The minimal set of MuJoCo functions for each job."""
    engine = MujocoEngine(chain)
    m, d = engine.model, engine.data
    q, qd, tau, qdd = states
    torque = np.zeros(chain.n)

    def place(s: int) -> None:
        d.qpos = q[s]
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)

    def mass(s: int) -> None:
        place(s)
        mujoco.mj_makeM(m, d)

    def newton_euler(s: int, with_acceleration: int) -> None:
        place(s)
        d.qvel = qd[s]
        mujoco.mj_comVel(m, d)
        d.qacc = qdd[s]
        mujoco.mj_rne(m, d, with_acceleration, torque)

    def forward(s: int) -> None:
        d.qpos, d.qvel, d.qfrc_applied = q[s], qd[s], tau[s]
        mujoco.mj_forward(m, d)

    return {
        FORWARD: from_python(forward, len(q)),
        RNE: from_python(lambda s: newton_euler(s, 1), len(q)),
        MASS: from_python(mass, len(q)),
        BIAS: from_python(lambda s: newton_euler(s, 0), len(q)),
    }


def from_python(call: Callable[[int], object], count: int) -> Work:
    """A Python loop over the states."""

    def work(calls: int) -> None:
        for s in itertools.islice(itertools.cycle(range(count)), calls):
            call(s)

    return work
