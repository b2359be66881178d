"""Linear model of a chain about a state: what controllers and observers are designed from.

    δẋ = A δx + B δu        δy = C δx + D δu        x = (q, q̇)

    A = | 0          1          |        B = | 0          |
        | ∂q̈/∂q      ∂q̈/∂q̇      |            | ∂q̈/∂u      |

u are the drive torques; where a motion is prescribed, the acceleration.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from flexlink.chain.arguments import require_one_of, require_type, sequence, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.describe.conditions import Frame
from flexlink.describe.own_units import TORQUE
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import forward_dynamics_derivatives
from flexlink.dynamics.placement import jacobian, tip_position
from flexlink.dynamics.result import SavedResult

Output = tuple[tuple[str, ...], Array, Array, Array]
"""Names, values y, ∂y/∂q and ∂y/∂q̇."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class LinearModel(SavedResult):
    """δẋ = A δx + B δu, δy = C δx + D δu about a state, at which ẋ = `rate` and y = `y`.

    What SciPy's and python-control's functions take: `scipy.linalg.solve_continuous_are(m.A, m.B, Q, R)`.

    Attributes
    ----------
    A, B, C, D
        Shapes (2n, 2n), (2n, m), (p, 2n), (p, m), in SI units and radians.
    x, u, y
        The state (q, q̇), inputs and outputs that the model is about, shapes (2n,), (m,), (p,).
    rate
        ẋ = (q̇, q̈) there, shape (2n,); zero at an equilibrium.
    states, inputs, outputs
        Their names with units: "q upper [rad]", "tau upper [N m]", "tip x [m]".
    eigenvalues
        Of A [1/s], shape (2n,), slowest first; the slowest as accurate as the slowest joint's row, not the stiffest's.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    x: Array
    u: Array
    y: Array
    rate: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def eigenvalues(self) -> Complex:
        """λ of A [1/s], shape (2n,), slowest first, of A `graded`."""
        λ = np.diag(linalg.schur(graded(self.A), output="complex")[0])
        return np.asarray(λ[np.argsort(np.abs(λ), kind="stable")])

    def __repr__(self) -> str:
        return f"<LinearModel: {len(self.x)} states, {len(self.u)} inputs, {len(self.y)} outputs>"


def graded(A: Array) -> Array:
    """A similar matrix whose rows shrink downwards: a solver moves the slowest λ by 2n eps of the last ones.

    Stiff arms have λ from 1/100 to 1e5 1/s, which a solver may all move by 2n eps ‖A‖. Angles are counted in units
    of 1/ω, so that A = | 0 ω | −ω 0 |, and joints stand in the order of their ω² = |∂q̈_k/∂q_k|, each angle beside its
    rate.
    """
    n = len(A) // 2
    ω = np.sqrt(np.abs(np.diag(A[n:, :n])))
    ω[ω == 0] = ω[ω > 0].min(initial=1.0)
    scale, fast = np.concatenate([ω, np.ones(n)]), np.argsort(-ω, kind="stable")
    order = np.column_stack([fast, n + fast]).ravel()
    return np.asarray((A * scale[:, None] / scale)[np.ix_(order, order)])


def linearize(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
    outputs: Sequence[str] = ("tip",),
) -> LinearModel:
    """Linear model about any state, exact up to rounding: springs, friction, gravity, rates and loads counted.

    M δq̈ = δT_EX − ∂(M q̈ + T_GC + T_FL + T_FR)/∂q δq − ∂(T_GC + T_FR)/∂q̇ δq̇ (`forward_dynamics_derivatives`). About an
    equilibrium, `linearize(chain, rest.q, tau=rest.tau)` of `rest = solve_static(…)`, its eigenvalues are those of
    `modes`.

    Parameters
    ----------
    chain
        The chain.
    q, qd, tau
        Angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (n,); without rates at rest, without torques
        not driven.
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame,
        with which they turn.
    outputs
        Any of "tip" and "tip_rate", position [m] and velocity [m/s] of the tip in frame 0; "joints" and "joint_rates",
        angles [rad] and rates [rad/s] of the driven joints; "state", x itself; one below the other.

    Returns
    -------
    LinearModel
        A, B, C, D. Inputs are the torques of the driven joints, `chain.active`, and the acceleration of those whose
        motion is prescribed, which have been 0 here, as in `forward_dynamics`.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or there is no such output.
    SingularMassError
        A joint moves no inertia of its own here.

    Examples
    --------
    >>> rest = fl.solve_static(chain, q, locked=chain.active)
    >>> model = fl.linearize(chain, rest.q, tau=rest.tau, outputs=("tip", "joints"))
    >>> model
    <LinearModel: 12 states, 2 inputs, 5 outputs>
    >>> print(model.inputs, model.outputs[:2])
    ('tau upper [N m]', 'tau fore [N m]') ('tip x [m]', 'tip y [m]')
    """
    n = require_type("chain", chain, Chain).n
    q = vector("q", q, n)
    qd, tau = (np.zeros(n) if part is None else vector(name, part, n) for name, part in (("qd", qd), ("tau", tau)))
    wanted = [require_one_of("outputs", name, OUTPUTS) for name in _names(outputs)]
    slopes = forward_dynamics_derivatives(chain, q, qd, tau, tip_wrench=tip_wrench, frame=frame)
    names, values, by_angle, by_rate = zip(*(output(chain, q, qd) for output in wanted), strict=True)
    C = np.hstack([np.vstack(by_angle), np.vstack(by_rate)])
    driven = chain.active
    given_motion = chain.hinges["prescribed"][driven] != 0
    A, B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, len(driven)))  # no block of zeros besides: half a gigabyte each
    np.fill_diagonal(A[:n, n:], 1.0)
    A[n:, :n], A[n:, n:], B[n:] = slopes.dq, slopes.dqd, slopes.dtau[:, driven]
    return LinearModel(
        A=A,
        B=B,
        C=C,
        D=np.zeros((len(C), len(driven))),
        x=np.concatenate([q, qd]),
        u=np.where(given_motion, 0.0, tau[driven]),
        y=np.concatenate(values),
        rate=np.concatenate([qd, forward_dynamics(chain, q, qd, tau, tip_wrench=tip_wrench, frame=frame)]),
        states=_of_joints(chain, range(n), "q {} [{}]") + _of_joints(chain, range(n), "qd {} [{}/s]"),
        inputs=tuple(
            f"{'qdd' if motion else 'tau'} {chain.joint_name(int(k))} "
            f"[{f'{chain.joint_units[k]}/s²' if motion else TORQUE[bool(chain.slides[k])]}]"
            for k, motion in zip(driven, given_motion, strict=True)
        ),
        outputs=sum(names, ()),
    )


def _names(outputs: object) -> list[str]:
    names = sequence("outputs", outputs, "str")
    if not names:
        raise ArgumentError(f"outputs = (): empty; allowed are {', '.join(OUTPUTS)}")
    return names


def _of_joints(chain: Chain, joints: Sequence[int] | NDArray[np.intp], pattern: str) -> tuple[str, ...]:
    return tuple(pattern.format(chain.joint_name(int(k)), chain.joint_units[k]) for k in joints)


def _tip(chain: Chain, q: Array, qd: Array) -> Output:
    J = jacobian(chain, q).linear
    return tuple(f"tip {axis} [m]" for axis in "xyz"), tip_position(chain, q), J, np.zeros_like(J)


def _tip_rate(chain: Chain, q: Array, qd: Array) -> Output:
    """v = Σ_k q̇_k J_k: a turn of hinge j turns the terms from j on, and moves the tip in all terms before.

    ∂v/∂q_j = e_j × Σ_{k ≥ j} q̇_k J_k + Σ_{k < j} q̇_k e_k × J_j
    """
    tip = jacobian(chain, q)
    J, e = tip.linear, tip.angular
    turning, moving = e * qd, J * qd
    before = np.cumsum(turning, axis=1) - turning
    beyond = np.cumsum(moving[:, ::-1], axis=1)[:, ::-1]
    slope = np.cross(e, beyond, axis=0) + np.cross(before, J, axis=0)
    return tuple(f"tip rate {axis} [m/s]" for axis in "xyz"), J @ qd, slope, J


def _joints(chain: Chain, q: Array, qd: Array) -> Output:
    pick = np.eye(chain.n)[chain.active]
    return _of_joints(chain, chain.active, "q {} [{}]"), q[chain.active], pick, np.zeros_like(pick)


def _joint_rates(chain: Chain, q: Array, qd: Array) -> Output:
    pick = np.eye(chain.n)[chain.active]
    return _of_joints(chain, chain.active, "qd {} [{}/s]"), qd[chain.active], np.zeros_like(pick), pick


def _state(chain: Chain, q: Array, qd: Array) -> Output:
    every, unit = range(chain.n), np.eye(2 * chain.n)
    names = _of_joints(chain, every, "q {} [{}]") + _of_joints(chain, every, "qd {} [{}/s]")
    return names, np.concatenate([q, qd]), unit[:, : chain.n], unit[:, chain.n :]


OUTPUTS: dict[str, Callable[[Chain, Array, Array], Output]] = {
    "tip": _tip, "tip_rate": _tip_rate, "joints": _joints, "joint_rates": _joint_rates, "state": _state,
}  # fmt: skip
