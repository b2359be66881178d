"""One sample of a problem during integration, with the acting torques, for sensors to measure."""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.conserved import Energy
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.samples import derive, prescribed_torques
from flexlink.results.samples import RunSamples


def sample_at(problem: InitialValueProblem, inputs: Inputs, t: float, q: Array, qd: Array) -> RunSamples:
    """The sample of a problem at time t [s] and a state (n,), with these inputs.

    With a free base, the state is given in the integrator's coordinates; the sample is returned in those
    of `problem.original`, like the samples of a finished run.
    """
    chain, time = problem.original, np.array([t])
    wrench = inputs.tip_wrenches(time, q[None], qd[None])
    if problem.base is not None:
        q, qd = problem.base.relative_to_start(q, qd)
    states = time, q[None].copy(), qd[None].copy()
    tau, tip, energy = np.zeros((1, chain.n)), np.empty((1, 3)), np.empty((3, 1))
    derive(chain.arrays, inputs, 0, 1, *states, tau, tip, energy)
    if len(inputs.motion.joints):
        scratch = solver_for(chain, problem.run.solver).workspace(chain.arrays)
        loads = None if inputs.loads is None else inputs.loads.holding(wrench[0], chain.arrays)
        prescribed_torques(scratch, inputs._replace(wrench=wrench[0], loads=loads), *states, tau)
    return RunSamples(chain, *states, tau, tip, Energy(*energy), tip_wrench=wrench, scene=problem.scene)
