"""The linear arm that a controller drives: states, torques of the moving driven joints, and what the controller sees.

The arm is held at rest in its state, by torques that balance gravity, springs and the tip wrench.
"""

import dataclasses

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Complex, Indices
from flexlink.dynamics.free_motion import coordinates_of
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.tangent import load_torque
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.vibration.derived_models import Matrices
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.linear_model import rates
from flexlink.dynamics.vibration.sensor_outputs import SensorOutputs
from flexlink.motion.inputs.actuation import wrench_at


@dataclasses.dataclass(frozen=True, eq=False)
class Plant:
    """δẋ = A δx + B δu, δy = C δx + D δu, with angles in units of 1/ω, which balances A."""

    A: Array  # (s, s)
    B: Array  # (s, m); u: torques of the m driven joints that move
    C: Array  # (p, s); y: q, q̇, and then the readings of sensors
    D: Array  # (p, m)
    delays: Array  # of each output [s], (p,)
    chain: Chain
    t: float  # [s] and q (n,): about which the model is linearized
    q: Array
    angles: Indices  # coordinate of each of the first states, which are angles
    unit: Array  # factor of these angles, ω [1/s]
    moving: Indices  # numbers of the inputs among `chain.active`
    inputs: tuple[str, ...]  # names with units
    readings: tuple[str, ...]  # names of the sensor columns
    seen: Array  # values of the sensor columns about which they are linearized

    @property
    def matrices(self) -> Matrices:
        """A, B, C, D."""
        return self.A, self.B, self.C, self.D

    def shape(self, state: Complex) -> Complex:
        """Displacements of the coordinates (n,) in a state (s, …)."""
        found = np.zeros(self.chain.freedoms, complex)
        found[self.angles] = state[: len(self.angles)] / self.unit
        return found if self.chain.shapes is None else np.asarray(self.chain.shapes.matrix @ found)


def plant_of(problem: InitialValueProblem, q: Array, t: float, *, sensors: bool) -> Plant:
    """The arm of a problem at rest with angles q (n,) at time t [s]; errors as in `linearize`."""
    chain, zero = problem.chain, np.zeros(problem.chain.n)
    wrench, frame = wrench_at(problem.inputs, t)
    hold = load_torque(chain, q, zero, wrench) + elastic_torque(chain, q)
    readings = SensorOutputs(problem.scene) if sensors else None
    outputs = ("state",) if readings is None else ("state", readings)
    model = linearize(chain, q, zero, hold, tip_wrench=wrench, frame=frame, outputs=outputs)
    fixed = chain.held
    prescribed = coordinates_of(chain, fixed)
    internal = coordinates_of(chain, np.isin(np.arange(chain.n), chain.internal))
    of_angles, of_rates = np.flatnonzero(~internal), np.arange(chain.freedoms)
    free = np.concatenate([~prescribed[of_angles], ~prescribed[of_rates]])
    kept = np.concatenate([np.flatnonzero(free), np.arange(len(free), len(model.x))])
    angles, moving = of_angles[~prescribed[of_angles]], np.flatnonzero(~fixed[chain.active])
    A, B, C = model.A[np.ix_(kept, kept)], model.B[np.ix_(kept, moving)], model.C[:, kept]
    size = len(angles)
    rows = size + np.searchsorted(of_rates[~prescribed], angles)  # both are sorted, and every angle has a rate
    unit = rates(A[rows, np.arange(size)])
    A[:size] *= unit[:, None]
    A[:, :size] /= unit
    B[:size] *= unit[:, None]
    C[:, :size] /= unit
    return Plant(
        A, B, C, model.D[:, moving], model.delays, chain, t, q, angles, unit, moving,
        tuple(model.inputs[k] for k in moving), model.outputs[2 * chain.n :], model.y[2 * chain.n :],
    )  # fmt: skip
