"""Linear model of a chain about a state, for the design of controllers and observers.

    δẋ = A δx + B δu        δy = C δx + D δu        x = (q, q̇)

    A = | 0          1          |        B = | 0          |
        | ∂q̈/∂q      ∂q̈/∂q̇      |            | ∂q̈/∂u      |

u are the drive torques or, for prescribed joints, the accelerations. Filters of sensors append states z to x.
An internal coordinate, such as that of lagging friction, contributes only its rate to x, since its angle has no effect.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import require_one_of, require_type, sequence, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.batches import is_batch, rows
from flexlink.dynamics.derivatives import ForwardDerivatives, forward_dynamics_derivatives
from flexlink.dynamics.forces import turns_with_tip
from flexlink.dynamics.free_motion import all_motions, input_names, state_names
from flexlink.dynamics.placement import jacobian
from flexlink.dynamics.tangent import LoadedState, load_torque
from flexlink.dynamics.terms import elastic_torque, mass_matrix
from flexlink.dynamics.tied_tangent import TiedState, tied_state
from flexlink.dynamics.vibration.linear_model import FILTER, OUTPUTS, LinearModel, Output, OutputSource


def linearize(
    chain: Chain, q: ArrayLike, qd: ArrayLike | None = None, tau: ArrayLike | None = None, *,
    tip_wrench: ArrayLike | None = None, frame: Frame = "world", outputs: Sequence[str | OutputSource] = ("tip",),
    tip_force: bool = False, ties: Scene | None = None,
) -> LinearModel:  # fmt: skip
    """Linear model about any state, exact up to rounding, with springs, friction, gravity, rates and loads.

    M δq̈ = δT_EX − ∂(M q̈ + T_GC + T_FL + T_FR)/∂q δq − ∂(T_GC + T_FR)/∂q̇ δq̇ (`forward_dynamics_derivatives`). At an
    equilibrium, `linearize(chain, rest.q, tau=rest.tau)` with `rest = solve_static(…)`, the model has the eigenvalues
    of `modes`.

    Parameters
    ----------
    chain, q, qd, tau
        The chain; angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (n,); default rates and torques:
        zero.
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame;
        in the latter they turn with the tip.
    outputs
        Any of "tip" and "tip_rate", position [m] and velocity [m/s] of the tip in frame 0; "joints" and "joint_rates",
        angles [rad] and rates [rad/s] of the driven joints; "state", (q, q̇); and `SensorOutputs(scene)`, readings of
        sensors. Outputs are stacked in the given order. Filters of sensors append states; see also `delays`.
    tip_force
        Whether a force on the tip along x, y and z of frame 0, in addition to `tip_wrench`, is an input as well [N].
    ties
        Scene whose ties hold the chain, at `initial.time` and at rest; None: the open chain. The states are then
        coordinates that describe the motion left by exact ties, with their rates; sensors are no outputs.

    Returns
    -------
    LinearModel
        A, B, C, D. Inputs are the torques of the driven joints, `chain.active`, or the accelerations of joints with
        prescribed motion, whose nominal value is 0, as in `forward_dynamics`; then the force on the tip.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or there is no such output; or ties leave no motion.
    SceneError
        The scene contains something that ties do not allow.
    SingularMassError
        A joint has no inertia attached in this configuration.

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
    wanted = _checked(outputs)
    state = LoadedState(q, qd, wrench_vector(tip_wrench), turns_with_tip(frame), np.arange(n))
    tied = tied_state(ties, chain, state, tau)
    acting = tau if tied is None else tau - tied.J.T @ tied.λ
    slopes = forward_dynamics_derivatives(chain, q, qd, acting, tip_wrench=tip_wrench, frame=frame)
    qdd = forward_dynamics(chain, q, qd, acting, tip_wrench=tip_wrench, frame=frame)
    if tied is not None:
        slopes = tied.slopes(slopes, mass_matrix(chain, q), qdd, all_motions(chain))
    return _model(chain, (q, qd, qdd, tau), slopes, wanted, tip_force, tied)


def linearize_many(
    chain: Chain, q: ArrayLike, qd: ArrayLike | None = None, tau: ArrayLike | None = None, *,
    tip_wrench: ArrayLike | None = None, frame: Frame = "world", outputs: Sequence[str | OutputSource] = ("tip",),
    tip_force: bool = False,
) -> list[LinearModel]:  # fmt: skip
    """`linearize` about many states in one call, such as the postures of a schedule of gains.

    Parameters
    ----------
    chain, q, qd, tau
        The chain; angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (b, n); default rates and torques:
        zero.
    tip_wrench, frame, outputs, tip_force
        As in `linearize`.

    Returns
    -------
    list of LinearModel
        In the order of the states; all have the same states, inputs and outputs.

    Raises
    ------
    ArgumentError, SingularMassError
        As in `linearize`.

    Examples
    --------
    >>> postures = [fl.solve_static(chain, [0.3, 0, 0, elbow, 0, 0], locked=chain.active) for elbow in (-1.0, -0.5)]
    >>> models = fl.linearize_many(chain, [rest.q for rest in postures], tau=[rest.tau for rest in postures])
    >>> print(len(models), models[0].A.shape)
    2 (12, 12)
    """
    n, wanted = require_type("chain", chain, Chain).n, _checked(outputs)
    if not is_batch(q):
        raise ArgumentError(f"q: expected many states, shape (b, {n}); for one state, use linearize", id="wrong-shape")
    still = np.zeros(n)
    q, qd, tau = rows(n, {"q": q, "qd": still if qd is None else qd, "tau": still if tau is None else tau})
    slopes = forward_dynamics_derivatives(chain, q, qd, tau, tip_wrench=tip_wrench, frame=frame)
    states = zip(q, qd, forward_dynamics(chain, q, qd, tau, tip_wrench=tip_wrench, frame=frame), tau, strict=True)
    each = map(ForwardDerivatives, slopes.dq, slopes.dqd, slopes.dtau)
    return [_model(chain, state, own, wanted, tip_force) for state, own in zip(states, each, strict=True)]


def _model(
    chain: Chain, state: tuple[Array, Array, Array, Array], slopes: ForwardDerivatives,
    wanted: Sequence[str | OutputSource], tip_force: bool, tied: TiedState | None = None,
) -> LinearModel:  # fmt: skip
    """The model about a state q, q̇, q̈, T_EX, with these ties."""
    (q, qd, qdd, tau), n = state, chain.n
    found = list[Output]()
    for each in wanted:
        found += [OUTPUTS[each](chain, q, qd)] if isinstance(each, str) else each.outputs(chain, q, qd, qdd, tau)
    driven = chain.active
    by_input = slopes.dtau[:, driven]
    if tip_force:
        free = ~chain.held
        by_input = np.hstack([by_input, slopes.dtau[:, free] @ jacobian(chain, q).linear.T[free]])
    size = 2 * n + sum(len(output.names) * len(output.filter.B) for output in found)
    A, B = np.zeros((size, size)), np.zeros((size, by_input.shape[1]))  # filled in place: a block can have 0.5 GB
    np.fill_diagonal(A[:n, n : 2 * n], 1.0)
    A[n : 2 * n, :n], A[n : 2 * n, n : 2 * n], B[n : 2 * n] = slopes.dq, slopes.dqd, by_input
    C, D, z, states = _put_outputs(found, A, B, driven, n)
    model = LinearModel(
        A=A, B=B, C=C, D=D, x=np.concatenate([q, qd, z]),
        u=np.append(np.where(chain.held[driven], 0.0, tau[driven]), np.zeros(3 * tip_force)),
        y=np.concatenate([output.values for output in found]), rate=np.concatenate([qd, qdd, np.zeros_like(z)]),
        states=state_names(chain) + states, inputs=input_names(chain) + TIP_FORCE * tip_force,
        outputs=tuple(name for output in found for name in output.names),
        delays=np.concatenate([np.full(len(output.names), output.delay) for output in found]),
    )  # fmt: skip
    unused = chain.internal
    if chain.shapes is not None:
        unused = chain.shapes.first[unused]
        model = _by_motions(model, chain.shapes.matrix, chain.shapes.inverse.T, chain.rest)
    if tied is not None:
        unused = np.flatnonzero(np.isin(tied.kept, unused))
        model = _by_motions(model, tied.Z, np.eye(len(tied.Z))[tied.kept], np.zeros(len(tied.Z)))
        names = np.array(state_names(chain)).reshape(2, -1)[:, tied.kept]
        model = dataclasses.replace(model, states=(*names.ravel().tolist(), *states))
    if not len(unused):
        return model
    kept = np.delete(np.arange(len(model.x)), unused)  # angles of internal coordinates have no effect
    parts = {name: getattr(model, name)[kept] for name in ("B", "x", "rate")}
    parts |= {"A": model.A[np.ix_(kept, kept)], "C": model.C[:, kept]}
    return dataclasses.replace(model, states=tuple(model.states[k] for k in kept), **parts)


def _by_motions(model: LinearModel, Φ: Array, back: Array, θ: Array) -> LinearModel:
    """The model with coordinates z, q = θ + Φ z, in place of the n coordinates q and their rates; `back` Φ = 1."""
    n = len(θ)
    filters = np.eye(len(model.x) - 2 * n)
    into, back = scipy.linalg.block_diag(Φ, Φ, filters), scipy.linalg.block_diag(back, back, filters)
    x = model.x - np.concatenate([θ, np.zeros(len(model.x) - n)])
    return dataclasses.replace(
        model, A=back @ model.A @ into, B=back @ model.B, C=model.C @ into, x=back @ x, rate=back @ model.rate,
    )  # fmt: skip


TIP_FORCE = tuple(f"tip force {axis} [N]" for axis in "xyz")  # names of the inputs for a force on the tip


def _put_outputs(
    found: Sequence[Output], A: Array, B: Array, driven: NDArray[np.intp], n: int
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Return C, D, and the filter states z with their names; write the equations of z into A and B."""
    count = sum(len(output.names) for output in found)
    C, D, z, states = np.zeros((count, len(A))), np.zeros((count, B.shape[1])), np.zeros(len(A) - 2 * n), list[str]()
    row, at = 0, 2 * n
    for output in found:
        by_state, by_input = np.hstack([output.q, output.qd]), np.zeros((len(output.names), B.shape[1]))
        if output.qdd is not None:
            by_state, by_input = by_state + output.qdd @ A[n : 2 * n, : 2 * n], output.qdd @ B[n : 2 * n]
        if output.tau is not None:
            by_input = by_input + np.pad(output.tau[:, driven], ((0, 0), (0, B.shape[1] - len(driven))))
        own, b, c, direct = output.filter
        rows = slice(row, row := row + len(output.names))
        C[rows, : 2 * n], D[rows] = output.gain * direct * by_state, output.gain * direct * by_input
        settled = output.filter.settled if len(b) else b
        for k, name in enumerate(output.names if len(b) else ()):
            block = slice(at, at := at + len(b))
            A[block, : 2 * n], A[block, block], B[block] = np.outer(b, by_state[k]), own, np.outer(b, by_input[k])
            C[rows.start + k, block] = output.gain * c
            z[block.start - 2 * n : at - 2 * n] = settled * output.signal[k]
            states += [f"{FILTER}{i} {name}" for i in range(1, len(b) + 1)]
    return C, D, z, tuple(states)


def _checked(outputs: object) -> list[str | OutputSource]:
    wanted = sequence("outputs", outputs, "str")
    if not wanted:
        raise ArgumentError(f"outputs = (): empty; allowed are {', '.join(OUTPUTS)}", id="empty")
    for each in wanted:
        if not hasattr(each, "outputs"):
            require_one_of("outputs", each, OUTPUTS)
    return wanted


def pd_poles(
    chain: Chain, q: ArrayLike, *, kp: ArrayLike, kd: ArrayLike, tip_wrench: ArrayLike | None = None
) -> Complex:
    """Poles of an arm at rest with its driven joints under T_EX = kp (target − q) − kd q̇ + holding torque.

    They are eigenvalues of A − B (kp, kd) with A and B from `linearize`, in a state where all torques balance. A
    reference filtered by an input shaper for the slowest poles, `InputShaper.at(pd_poles(…)[:2])`, excites almost no
    vibration.

    Parameters
    ----------
    chain
        The chain. Joints with prescribed motion are held.
    q
        Angles [rad], shape (n,), of the arm bent under gravity, as returned by `solve_static`.
    kp, kd
        Gains [N m/rad] and [N m s/rad], ≥ 0: one number for all driven joints, or one per joint, shape (d,).
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m].

    Returns
    -------
    Array
        Complex poles λ = −σ + iω_d with ω_d > 0 [1/s], sorted by |λ|; conjugates and aperiodic poles are left out.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not finite, or is negative.
    SingularMassError
        A joint has no inertia attached in this configuration.

    Examples
    --------
    >>> slow = fl.small_motion.pd_poles(chain, q, kp=(2e4, 1e4), kd=(600.0, 250.0))
    >>> print((abs(slow[:2]) / (2 * np.pi)).round(2))  # Hz
    [ 4.28 26.51]
    """
    n = require_type("chain", chain, Chain).n
    driven = chain.active
    q, wrench = vector("q", q, n), wrench_vector(tip_wrench)
    balance = load_torque(chain, q, np.zeros(n), wrench) + elastic_torque(chain, q)
    model = linearize(chain, q, tau=balance, tip_wrench=wrench, outputs=("state",))
    moving = ~chain.held[driven]
    B, picked = model.B[:, moving], np.eye(n)[driven[moving]]
    gains = [_gains(name, value, len(driven))[moving, None] * picked for name, value in (("kp", kp), ("kd", kd))]
    poles = np.linalg.eigvals(model.A - B @ (np.hstack(gains) @ model.C))
    vibrations = poles[poles.imag > 0]
    return np.asarray(vibrations[np.argsort(np.abs(vibrations), kind="stable")], dtype=np.complex128)


def _gains(name: str, value: ArrayLike, size: int) -> Array:
    gains = vector(name, np.broadcast_to(value, (size,)) if np.ndim(value) == 0 else value, size)
    if np.any(gains < 0):
        raise ArgumentError(f"{name}[{np.argmin(gains)}] = {gains.min()!r}: must be >= 0", id="out-of-range")
    return gains
