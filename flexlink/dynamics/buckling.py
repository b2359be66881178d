"""Linear buckling: multiples of the present load at which an arm loses its stiffness."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.layout import Joints
from flexlink.common.types import Array
from flexlink.dynamics.forces import about
from flexlink.dynamics.free_motion import restricted
from flexlink.dynamics.tangent import stiffness_matrix, unlocked


def buckling_loads(
    chain: Chain,
    q: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    locked: Joints = (),
) -> Array:
    """Load factors at which the arm can buckle: multiples of gravity and tip wrench together (dimensionless).

    At a buckling load, K_elastic + s K_load(q) is singular; q is fixed, and joints without springs are locked.
    Only real positive s are returned; there are none if the loads do not reduce the stiffness.

    Parameters
    ----------
    chain
        The chain.
    q
        Configuration [rad], shape (n,); default: springs slack, joints at zero.
    tip_wrench
        Force and moment on the tip [N, N m], shape (6,), axes of frame 0.
    locked
        Coordinates that do not move, as in `solve_static`.

    Returns
    -------
    Array
        Factors s, in ascending order.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names an unknown coordinate.

    Examples
    --------
    >>> standing = np.where(np.arange(chain.n) == 0, np.pi / 2, 0.0)  # rad; upright
    >>> factors = fl.strength.buckling_loads(chain, standing, locked=["upper", "fore"])
    >>> print(factors[0].round(1))  # multiple of its weight and load
    140.9
    """
    n = require_type("chain", chain, Chain).n
    q = chain.rest.copy() if q is None else vector("q", q, n)
    wrench = wrench_vector(tip_wrench)
    free = unlocked(chain, locked)
    elastic = about(chain, q)
    sprung = free[(chain.stiffness[free] > 0) | (elastic.stiffness[free] > 0)]
    K = restricted(elastic.matrix("stiffness"), chain, sprung)
    load = restricted(stiffness_matrix(chain, q, np.zeros(chain.n), wrench), chain, sprung) - K
    diagonal = not elastic.springs_join_hinges and chain.shapes is None
    inverse = scipy.linalg.eigvals(-_per_stiffness(load, K, diagonal=diagonal))  # 1/s
    rounding = len(K) * np.finfo(float).eps * np.abs(inverse).max(initial=0.0)
    softening = inverse.real > rounding
    real = np.abs(inverse.imag) <= np.sqrt(np.finfo(float).eps) * np.abs(inverse)  # double eigenvalues are less exact
    return np.asarray(np.sort(1 / inverse.real[softening & real]))


def _per_stiffness(load: Array, K: Array, *, diagonal: bool) -> Array:
    """Return L⁻¹ A L⁻ᵀ for A = `load` and K = L Lᵀ; it has the eigenvalues of K⁻¹ A. `diagonal`: if K is diagonal.

    If K is not positive definite, which can occur for rotation-vector springs at large angles, return K⁻¹ A.
    """
    if diagonal:
        k = K.diagonal()
        return np.asarray(load / np.sqrt(np.outer(k, k)))
    try:
        L = scipy.linalg.cholesky(K, lower=True)
    except scipy.linalg.LinAlgError:
        return np.asarray(scipy.linalg.solve(K, load))
    half = scipy.linalg.solve_triangular(L, load, lower=True)
    return np.asarray(scipy.linalg.solve_triangular(L, half.T, lower=True).T)
