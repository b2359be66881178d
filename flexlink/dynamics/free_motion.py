"""Coordinates of small motion: the free joints or, for hinges that move by shapes, the shapes. δq = B δz, B (n, f).

Matrices and vectors of the joints become those of the coordinates by A → Bᵀ A B and τ → Bᵀ τ. Without shapes B selects
rows and columns.
"""

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array

Free = NDArray[np.intp]

DENSE = 100
"""Number of joints up to which matrices are dense, and all their eigenvalues are computed, in O(n³); with more joints
only the eigenvalues that are needed, in O(n)."""


def basis(chain: Chain, free: Free) -> Array:
    """B (n, f): motion of all joints per unit of each free coordinate. A shape is free if all its hinges are."""
    if chain.shapes is None:
        return np.eye(chain.n)[:, free]
    Φ, moving = chain.shapes.matrix, np.zeros(chain.n, dtype=bool)
    moving[free] = True
    return np.asarray(Φ[:, ~(Φ[~moving] != 0).any(axis=0)])


def restricted(A: Array, chain: Chain, free: Free) -> Array:
    """Bᵀ A B (f, f) of a matrix A (n, n)."""
    if chain.shapes is not None:
        B = basis(chain, free)
        return np.asarray(B.T @ A @ B)
    return A if len(free) == chain.n else np.ascontiguousarray(A[np.ix_(free, free)])


def expanded(vectors: NDArray[np.inexact], chain: Chain, free: Free) -> NDArray[np.inexact]:
    """B times vectors (f, m) of the free coordinates, as rows of all joints, (m, n)."""
    if chain.shapes is not None:
        return np.asarray((basis(chain, free) @ vectors).T)
    rows = np.zeros((vectors.shape[1], chain.n), dtype=vectors.dtype)
    rows[:, free] = vectors.T
    return rows


def sums_of_squares(weights: Array, chain: Chain, free: Free) -> Array:
    """Σ_k B_kj² w_k (f,) for weights (n,) of the joints."""
    return np.asarray(weights[free] if chain.shapes is None else (basis(chain, free) ** 2).T @ weights)


def all_motions(chain: Chain) -> Array:
    """Motion of all joints per unit of each coordinate, free or not, (n, freedoms)."""
    return np.eye(chain.n) if chain.shapes is None else chain.shapes.matrix


def coordinates_of(chain: Chain, joints: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask (freedoms,) of the coordinates that move one of the joints of a mask (n,)."""
    return joints if chain.shapes is None else np.asarray((chain.shapes.matrix[joints] != 0).any(axis=0))


def first_joints(chain: Chain, free: Free) -> Free:
    """The first joint that each free coordinate moves, (f,)."""
    return free if chain.shapes is None else np.argmax(basis(chain, free) != 0, axis=0)


def state_names(chain: Chain) -> tuple[str, ...]:
    """Names and units of z and ż of all coordinates, free or not."""
    units = np.array(chain.joint_units)[first_joints(chain, np.arange(chain.n))]
    names = [f"{name} [{unit}" for name, unit in zip(chain.freedom_names, units, strict=True)]
    return (*(f"q {name}]" for name in names), *(f"qd {name}/s]" for name in names))


def input_names(chain: Chain) -> tuple[str, ...]:
    """Names and units of the torques of driven joints, or of their accelerations if they are held."""
    given, units = chain.held.tolist(), (chain.torque_units, [f"{unit}/s²" for unit in chain.joint_units])
    return tuple(f"{('tau', 'qdd')[given[k]]} {chain.joint_name(k)} [{units[given[k]][k]}]" for k in chain.active)
