"""Diagnosis of a singular mass matrix M, for which accelerations do not exist: finds the joint without inertia."""

import numpy as np
import scipy

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, FlexlinkError, SingularMassError
from flexlink.common.types import Array, Indices
from flexlink.dynamics.free_motion import first_joints, restricted
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.terms import mass_matrix
from flexlink.kernels.bodies.mass import mass_composite
from flexlink.kernels.forward.solvers import ARTICULATED, Solver


def no_acceleration(chain: Chain, solver: Solver, wrench: Array, q: Array, qd: Array, tau: Array) -> FlexlinkError:
    """The error if q̈ is not finite: it names the joint if that is so at rest without loads, else rates or loads."""
    rest = np.zeros(chain.n)
    if np.isfinite(solver.accelerations(chain.arrays, np.zeros(6), q, rest, rest)).all():
        most = f"qd up to {np.abs(qd).max():.3g} rad/s, tau up to {np.abs(tau).max():.3g} N m"
        why = f"{most}, tip_wrench up to {np.abs(wrench).max():.3g}; use smaller values"
        return ArgumentError(f"q̈ of {chain.name!r} overflows float64: {why}", id="overflow")
    k = idle_joint(chain, q)
    point = next(body for body in chain.bodies if body["first"] <= k < body["stop"])
    there = range(int(point["first"]), int(point["stop"]))
    angles = ", ".join(f"{chain.joint_name(j)} = {chain.place_in_words(j, float(q[j]))}" for j in there)
    others = ARTICULATED.accelerations(chain.arrays, wrench, q, qd, tau)
    way_out = "use solver 'articulated', which does not need M" if np.isfinite(others).all() else "give it an armature"
    joint = f"joint {chain.joint_name(k)!r} has no inertia attached at {angles}"
    why = f"mass matrix of {chain.name!r} is singular: {joint}; {way_out}, or choose another configuration"
    return SingularMassError(why, id="joint-without-inertia")


def idle_joint(chain: Chain, q: Array) -> int:
    """Return the joint that moves most in the motion with the least inertia; if several move equally, the last one.

    This motion is the eigenvector v of M v = λ D v with the smallest λ, where D is the diagonal of M; λ is at most 1,
    and 0 if M is singular. Held joints are left out.
    """
    M = np.zeros((chain.n, chain.n))
    mass_composite(chain.arrays, q, M)
    free = chain.free
    M = M[np.ix_(free, free)]
    root = np.sqrt(np.maximum(M.diagonal(), 0.0))  # negative entries are rounding errors
    if not root.all():
        return int(free[np.flatnonzero(root == 0)[-1]])
    share = np.abs(np.linalg.eigh(M / np.outer(root, root))[1][:, 0])
    return int(free[np.flatnonzero(share > share.max() / 2)[-1]])


def factored_mass(chain: Chain, q: Array, free: Indices) -> tuple[Array, Array]:
    """Return M of the free coordinates and L of M = L Lᵀ; refuses a coordinate without inertia.

    A Cholesky pivot, the square of a diagonal entry of L, is the inertia of a coordinate if the previous ones move
    freely. It must exceed the rounding error of M, n eps M_ii. Just above that bound, factorizing M again by another
    method may fail, so L is returned with M.
    """
    whole = mass_matrix(chain, q, algorithm="upper")  # in body axes, accurate even for the twist of a straight thin arm
    M = restricted(whole, chain, free)
    L, stopped = scipy.linalg.lapack.dpotrf(M, lower=1)
    with np.errstate(invalid="ignore"):
        good = L.diagonal() > np.sqrt(len(M) * EPS * M.diagonal())  # False for nan
    if stopped or not good.all():
        k = first_joints(chain, free)[stopped - 1 if stopped else int(np.argmin(good))]
        raise idle_error(chain, int(k))
    return M, np.asarray(L)


def idle_error(chain: Chain, k: int) -> SingularMassError:
    """Return the error for a coordinate without inertia."""
    why = "has no inertia attached in this configuration, or its inertia overflows float64"
    remedy = "give a body beyond it mass (section and material, hub, end or tip), or the joint armature"
    return SingularMassError(f"{chain.name}: joint {chain.joint_name(k)!r} {why}; {remedy}", id="joint-without-inertia")
