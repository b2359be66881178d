"""Claims about an arm at one state."""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.chain.coordinates import SPRINGS, Kind
from flexlink.dynamics import rounding
from flexlink.dynamics.terms import algorithms_of
from tests.matrix.case import EPS, Array, Case, close, difference

STEP = 1e-3
"""Step of finite differences."""
SOLVERS = "articulated", "lu", "cholesky"


def forces(chain: fl.Chain, q: Array, qd: Array) -> Array:
    """Sum of spring, friction and drag torques, T_FL + T_FR + T_DRAG."""
    return fl.elastic_torque(chain, q) + fl.friction_torque(chain, qd) + fl.drag_torque(chain, q, qd)


def inverse_of_forward(case: Case) -> None:
    """All solvers satisfy the equation of motion, to rounding."""
    q, qd, tau, wrench = case.state()
    for frame in ("world", "tip"):
        for solver in SOLVERS:
            qdd = fl.forward_dynamics(case.chain, q, qd, tau, tip_wrench=wrench, frame=frame, solver=solver)
            left = fl.inverse_dynamics(case.chain, q, qd, qdd, tip_wrench=wrench, frame=frame)
            left += forces(case.chain, q, qd) - tau
            assert not np.delete(qdd, case.free).any(), "prescribed joints do not accelerate"
            own = np.abs(tau) + np.abs(fl.drag_torque(case.chain, q, qd))
            allowed = rounding.of_residual(case.chain, q, qd, qdd, own, tip_wrench=wrench)
            assert np.abs(case.motions(case.free).T @ left).max() <= allowed, (frame, solver)


def coordinates(case: Case) -> None:
    """Every coordinate has one kind, one name and one unit; what names and kinds select is consistent."""
    chain, every = case.chain, list(range(case.chain.n))
    assert sorted(k for kind in Kind for k in chain.where(kind)) == every
    assert [chain.joint_index("k", name) for name in chain.joint_names] == every
    assert [chain.index(*c) for c in chain.coordinates] == every
    assert sorted(k for _, joints in chain.by_unit(every) for k in joints) == every
    assert {c for c in chain.coordinates if c.kind.springs} == {chain.coordinates[k] for k in chain.where(*SPRINGS)}
    assert not chain.stiffness[np.setdiff1d(every, chain.where(*SPRINGS))].any(), "only these kinds have springs"
    assert np.array_equal(chain.free, case.free)
    last = [max(k for k in every if chain.body(k) == body) for body in map(chain.body, every)]
    assert all(chain.coordinates[k].body == chain.coordinates[j].body for k, j in enumerate(last))


def mass_matrices(case: Case) -> None:
    """M from every algorithm is symmetric, positive definite and equal to ∂τ/∂q̈ of inverse dynamics."""
    q, qd, _, _ = case.state()
    bias, I = fl.bias_torque(case.chain, q, qd), np.eye(case.chain.n)
    columns = np.array([fl.inverse_dynamics(case.chain, q, qd, row) - bias for row in I])
    error = rounding.of_mass_matrix(case.chain, q)
    for algorithm in algorithms_of(case.chain):
        M = fl.mass_matrix(case.chain, q, algorithm=algorithm)
        assert np.abs(M - M.T).max() <= error and np.linalg.eigvalsh(M).min() > 0, algorithm
        close(M, columns, 0.0, error + 2 * rounding.of_bias_torque(case.chain, q, qd))


def batches(case: Case) -> None:
    """Many states and many chains side by side equal single evaluations, to rounding."""
    states = [case.state(seed)[:3] for seed in range(9)]
    many = [np.array(part) for part in zip(*states, strict=True)]
    chains = [case.chain, *(fl.lump(case.heavier(0.01 * k)) for k in range(1, 9))]
    for alike, q̈ in (
        ([case.chain] * 9, fl.forward_dynamics(case.chain, *many)),
        (chains, fl.forward_dynamics(chains, *many)),
    ):
        for chain, found, state in zip(alike, q̈, states, strict=True):
            alone = fl.forward_dynamics(chain, *state)
            assert rounding.acceleration_error(chain, *state, solutions=(found, alone)).max() <= 1.0


def quick_calls(case: Case) -> None:
    """Functions bound to the chain give the numbers of the public functions, to the bit."""
    q, qd, tau, _ = case.state()
    bound, chain = fl.Dynamics(case.chain), case.chain
    for found, expected in (
        (bound.forward_dynamics(q, qd, tau), fl.forward_dynamics(chain, q, qd, tau)),
        (bound.inverse_dynamics(q, qd, tau), fl.inverse_dynamics(chain, q, qd, tau)),
        (bound.mass_matrix(q), fl.mass_matrix(chain, q)),
        (bound.jacobian(q)[1], fl.jacobian(chain, q).angular),
        (bound.forward_dynamics_derivatives(q, qd, tau)[2], fl.forward_dynamics_derivatives(chain, q, qd, tau).dtau),
        (bound.inverse_dynamics_derivatives(q, qd, tau)[0], fl.inverse_dynamics_derivatives(chain, q, qd, tau).dq),
    ):
        np.testing.assert_array_equal(found, expected)


def slopes_forward(case: Case) -> None:
    """Derivatives of q̈ with respect to q, q̇ and T_EX match fourth-order differences with a step of 1e-3."""
    q, qd, tau, wrench = case.state()
    for frame in ("world", "tip"):
        found = fl.forward_dynamics_derivatives(case.chain, q, qd, tau, tip_wrench=wrench, frame=frame)

        def f(q: Array, qd: Array, frame: Any = frame) -> Array:
            return fl.forward_dynamics(case.chain, q, qd, tau, tip_wrench=wrench, frame=frame)

        as_differences(case, (found.dq, found.dqd), f, (q, qd), 1e-7)
        B = case.motions(case.free)
        close(found.dtau[:, case.free] @ fl.mass_matrix(case.chain, q)[case.free] @ B, B, 1e-9)


def slopes_inverse(case: Case) -> None:
    """Derivatives of inverse dynamics with respect to q, q̇ and q̈ match differences."""
    q, qd, qdd, wrench = case.state()
    for frame in ("world", "tip"):
        found = fl.inverse_dynamics_derivatives(case.chain, q, qd, qdd, tip_wrench=wrench, frame=frame)

        def f(*state: Array, frame: Any = frame) -> Array:
            return fl.inverse_dynamics(case.chain, *state, tip_wrench=wrench, frame=frame)

        as_differences(case, (found.dq, found.dqd, found.dqdd), f, (q, qd, qdd), 1e-8)


def as_differences(
    case: Case, found: Sequence[Array], f: Callable[..., Array], state: tuple[Array, ...], relative: float
) -> None:
    """Check derivatives of f with respect to all parts of a state against differences, within their rounding error.

    Slides in beams have a tenth of the step: segments are centimetres long.
    """
    steps = STEP * np.where([c.kind is Kind.STRAIN for c in case.chain.coordinates], 0.1, 1.0)
    rounded = 100 * EPS * np.abs(f(*state)).max() / steps
    for slopes, expected in zip(found, along(f, *state, steps=steps), strict=True):
        close(slopes, expected, relative, rounded.max())


def along(f: Callable[..., Array], *state: Array, steps: Array | None = None) -> Iterator[Array]:
    """Derivatives of f with respect to each part of a state, one matrix per part."""
    for k, part in enumerate(state):

        def moved(h: float, e: Array, k: int = k, part: Array = part) -> Array:
            return f(*state[:k], part + h * e, *state[k + 1 :])

        each = np.full(len(part), STEP) if steps is None else steps
        yield np.array(
            [
                difference(functools.partial(moved, e=e), h)
                for e, h in zip(np.eye(len(part)), each.tolist(), strict=True)
            ]
        ).T


def linear_model(case: Case) -> None:
    """A and B are derivatives of forward dynamics, C is the derivative of the tip; internal angles are not states."""
    q, qd, tau, _ = case.state()
    found, n = fl.linearize(case.chain, q, qd, tau), case.chain.n
    slopes = fl.forward_dynamics_derivatives(case.chain, q, qd, tau)
    Φ = np.eye(n) if case.chain.shapes is None else case.chain.shapes.matrix
    back, m = np.linalg.pinv(Φ), Φ.shape[1]
    kept = np.delete(np.arange(2 * m), case.chain.internal)
    A = np.block([[np.zeros((m, m)), np.eye(m)], [back @ slopes.dq @ Φ, back @ slopes.dqd @ Φ]])
    close(found.A, A[np.ix_(kept, kept)], 1e-12)
    assert not A[m:, case.chain.internal].any()
    close(found.B[-m:], back @ slopes.dtau[:, case.chain.active], 1e-12)
    angles = kept[kept < m]
    tips = [difference(lambda h, e=e: fl.tip_position(case.chain, q + h * e)) for e in Φ.T[angles]]
    close(found.C[:3, : len(angles)], np.array(tips).T, 1e-8, 1e-12)


def potential(case: Case) -> None:
    """T_G + T_FL is the gradient of the potential energy of gravity and springs."""
    q, _, _, _ = case.state()

    def energy(q: Array) -> float:
        found = fl.energy(case.chain, q, np.zeros(case.chain.n))
        return found.gravity + found.elastic

    expected = [difference(lambda h, e=e: energy(q + h * e)) for e in np.eye(case.chain.n)]
    close(fl.gravity_torque(case.chain, q) + fl.elastic_torque(case.chain, q), np.array(expected), 1e-9,
          100 * EPS * abs(energy(q)) / STEP)  # fmt: skip


def power(case: Case) -> None:
    """In any motion, the energy rate equals the power of drives, wrench, friction and drag."""
    q, qd, qdd, wrench = case.state()
    own = fl.friction_torque(case.chain, qd) + fl.drag_torque(case.chain, q, qd)
    tau = fl.inverse_dynamics(case.chain, q, qd, qdd, tip_wrench=wrench) + fl.elastic_torque(case.chain, q) + own
    J = fl.jacobian(case.chain, q, tip=case.tip)
    pushed = np.concatenate([J.linear, J.angular]).T @ wrench

    def energy(h: float) -> float:
        return fl.energy(case.chain, q + h * qd, qd + h * qdd).total

    close(difference(energy), np.array((tau + pushed - own) @ qd), 1e-8, 100 * EPS * abs(energy(0.0)) / STEP)
    assert fl.friction_torque(case.chain, qd) @ qd >= 0 and fl.drag_torque(case.chain, q, qd) @ qd >= 0


def loads(case: Case) -> None:
    """Moments about hinges balance springs, friction, rotors and drives; the load at the tip is the wrench."""
    q, qd, tau, wrench = case.state()
    qdd = fl.forward_dynamics(case.chain, q, qd, tau, tip_wrench=wrench)
    found = fl.strength.internal_loads(case.chain, q, qd, qdd, tip_wrench=wrench)
    spring = fl.elastic_torque(case.chain, q) + fl.friction_torque(case.chain, qd)
    wanted = spring + case.chain.hinges["armature"] * qdd - tau
    allowed = 10 * rounding.of_residual(case.chain, q, qd, qdd, tau, tip_wrench=wrench)
    B = case.motions(case.free).T
    close(B @ found.hinge_moment, B @ wanted, 0.0, allowed)


def points(case: Case) -> None:
    """Velocity and acceleration of every tip are derivatives of its position along the motion."""
    q, qd, qdd, _ = case.state()
    for tip in case.chain.tips:
        found = fl.point_motion(case.chain, q, qd, qdd, tip=tip)
        place = lambda h, tip=tip: fl.tip_position(case.chain, q + h * qd + h * h / 2 * qdd, tip=tip)  # noqa: E731
        close(fl.jacobian(case.chain, q, tip=tip).linear @ qd, difference(place), 1e-8, 1e-12)
        close(found.velocity, difference(place), 1e-8, 1e-12)
        close(found.acceleration, difference(lambda h, at=place: difference(lambda k: at(h + k))), 1e-6, 1e-8)


def momenta(case: Case) -> None:
    """Linear momentum is mass times velocity of the centre of mass; rotors have no effect on it."""
    q, qd, _, _ = case.state()
    masses = case.chain.bodies["mass"]

    def centre(h: float) -> Array:
        frames = fl.frames(case.chain, q + h * qd)
        return masses @ (frames.points + np.einsum("bij,bj->bi", frames.rotations, case.chain.bodies["center"]))

    close(fl.momentum(case.chain, q, qd).linear, difference(centre), 1e-8, 1e-12)
