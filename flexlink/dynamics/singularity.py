"""Where M is singular, so that there are no accelerations: which joint moves no inertia of its own."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.free_base import AXES
from flexlink.common.errors import ArgumentError, FlexlinkError, SingularMassError
from flexlink.common.types import Array
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.terms import mass_matrix
from flexlink.kernels.bodies.mass import mass_composite
from flexlink.kernels.forward.solvers import ARTICULATED, Solver

PITCH = AXES.index(1)
"""Coordinate of a free base that turns it about Y."""


def no_acceleration(chain: Chain, solver: Solver, wrench: Array, q: Array, qd: Array, tau: Array) -> FlexlinkError:
    """The error of a state whose q̈ is not finite.

    Returns
    -------
    FlexlinkError
        SingularMassError, which names the joint and the angles at its point, if q̈ is not finite at rest and without
        loads either; else ArgumentError: rates or loads are too large for float64.
    """
    rest = np.zeros(chain.n)
    if np.isfinite(solver.accelerations(chain.arrays, np.zeros(6), q, rest, rest)).all():
        return ArgumentError(
            f"q̈ of {chain.name!r} overflows float64: qd up to {np.abs(qd).max():.3g} rad/s, tau up to "
            f"{np.abs(tau).max():.3g} N m, tip_wrench up to {np.abs(wrench).max():.3g}; expected less",
            id="overflow",
        )
    k = idle_joint(chain, q)
    point = next(body for body in chain.bodies if body["first"] <= k < body["stop"])
    there = range(int(point["first"]), int(point["stop"]))
    angles = ", ".join(f"{chain.joint_name(j)} = {chain.place_in_words(j, float(q[j]))}" for j in there)
    others = ARTICULATED.accelerations(chain.arrays, wrench, q, qd, tau)
    way_out = "use solver 'articulated', which has no need of M" if np.isfinite(others).all() else "give it an armature"
    return SingularMassError(
        f"mass matrix of {chain.name!r} is singular: joint {chain.joint_name(k)!r} moves no inertia of its own "
        f"at {angles}; {way_out}, or take another posture",
        id="joint-without-inertia",
    )


def base_without_rates(chain: Chain, q: Array) -> FlexlinkError | None:
    """The error of a free base whose angles have no rates there: about Y they are at 90°, within 3e-8 rad.

    The other two then turn about one axis. Of M only cos² of that angle is left, and of this rounding leaves nothing.
    """
    if not chain.has_free_base or np.cos(q[PITCH]) ** 2 >= 4 * np.finfo(float).eps:
        return None
    pitch = f"{chain.joint_name(PITCH)} = {chain.place_in_words(PITCH, float(q[PITCH]))}"
    return SingularMassError(
        f"mass matrix of {chain.name!r} is singular: at {pitch} the base's angles cannot tell how it turns; tell them "
        "from another attitude, initial.base.rpy_deg, as runs do",
        id="attitude-singular",
    )


def idle_joint(chain: Chain, q: Array) -> int:
    """The joint with the largest part in the motion that moves the least inertia, the last one where several have it.

    That is v with M v = λ D v, D the diagonal of M, for the smallest λ: 0 if M is singular, at most 1. Joints with
    prescribed motion take no part.
    """
    M = np.zeros((chain.n, chain.n))
    mass_composite(chain.arrays, q, M)
    free = np.flatnonzero(chain.hinges["prescribed"] == 0)
    M = M[np.ix_(free, free)]
    root = np.sqrt(np.maximum(M.diagonal(), 0.0))  # below it, rounding is all that is left
    if not root.all():
        return int(free[np.flatnonzero(root == 0)[-1]])
    part = np.abs(np.linalg.eigh(M / np.outer(root, root))[1][:, 0])
    return int(free[np.flatnonzero(part > part.max() / 2)[-1]])


def regular_mass(chain: Chain, q: Array, free: NDArray[np.intp]) -> Array:
    """M of `factored_mass`."""
    return factored_mass(chain, q, free)[0]


def factored_mass(chain: Chain, q: Array, free: NDArray[np.intp]) -> tuple[Array, Array]:
    """M of the free coordinates, of which each must move inertia of its own, and L of M = L Lᵀ.

    Cholesky's pivot is the inertia of a coordinate while those before it are free to give way; it must exceed the
    rounding of M, n eps M_ii. (The diagonal of Cholesky's factor holds the square roots of the pivots.) Close to that
    bound another way to the same factor may fail, so that L goes with M.

    Raises
    ------
    SingularMassError
        It does not, or M is beyond float64.
    """
    whole = mass_matrix(chain, q, algorithm="upper")  # in body axes: twist of a slender arm, straight, keeps its digits
    M = whole if len(free) == chain.n else np.ascontiguousarray(whole[np.ix_(free, free)])
    L, stopped = scipy.linalg.lapack.dpotrf(M, lower=1)
    with np.errstate(invalid="ignore"):
        good = L.diagonal() > np.sqrt(len(M) * EPS * M.diagonal())  # False for nan, too
    if stopped or not good.all():
        k = free[stopped - 1 if stopped else int(np.argmin(good))]
        raise idle_error(chain, int(k))
    return M, np.asarray(L)


def idle_error(chain: Chain, k: int) -> SingularMassError:
    """The error of a coordinate that moves no inertia of its own."""
    return SingularMassError(
        f"{chain.name}: joint {chain.joint_name(k)!r} moves no inertia of its own at this posture, or one "
        "that overflows float64; M must be positive definite",
        id="joint-without-inertia",
    )
