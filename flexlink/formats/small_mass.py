"""Small masses for links without mass, for programs that refuse them, and how much they change.

A point with several hinges has a massless link between each two of them. It gets a mass m and inertia m r², r = 0.1 m.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, require_type
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.dynamics.terms import mass_matrix
from flexlink.formats.document import places
from flexlink.kernels.layout import BODY


def with_small_mass(chain: Chain, *, mass: float) -> Chain:
    """The chain with a body at every hinge; massless bodies get the mass m and the inertia m r².

    Parameters
    ----------
    chain
        The chain.
    mass
        m [kg].

    Returns
    -------
    Chain
        With the same coordinates; `added_inertia` bounds the change of its motion.

    Raises
    ------
    ArgumentError
        `mass` is not a finite number > 0; springs hold rotation vectors of hinges at one point, between which there
        would be bodies.
    """
    if require_type("chain", chain, Chain).has_rotation_springs:
        raise ArgumentError(
            f"{chain.name!r}: its springs hold rotation vectors, which bodies between the hinges would leave without "
            "meaning; take a lumping rule with springs = 'angles', such as gauss, or no small mass"
        )
    return _filled(chain, positive("mass", mass), keep=True)


def added_inertia(chain: Chain, q: ArrayLike, *, mass: float) -> float:
    """The largest relative change of M by small masses at a posture, δ = max vᵀ ΔM v / vᵀ M v over all v.

    By Rayleigh's quotient, every natural frequency decreases by a factor of at least 1/√(1 + δ) > 1 − δ/2.

    Parameters
    ----------
    chain
        The chain before `with_small_mass`.
    q
        Joint angles, shape (n,) [rad].
    mass
        As for `with_small_mass` [kg].

    Returns
    -------
    float
        δ; infinite if M is singular without the masses.

    Raises
    ------
    ArgumentError
        `mass` is not a finite number > 0, or `q` is not n finite numbers.
    """
    added = _filled(require_type("chain", chain, Chain), positive("mass", mass), keep=False)
    try:
        return float(scipy.linalg.eigh(mass_matrix(added, q), mass_matrix(chain, q), eigvals_only=True)[-1])
    except np.linalg.LinAlgError:
        return float("inf")


def _filled(chain: Chain, mass: float, *, keep: bool) -> Chain:
    """One body a hinge, with mass in massless ones; without `keep` nothing else has inertia, rotors included."""
    radius = 0.1  # of gyration [m]
    bodies = np.zeros(chain.n + 1, BODY)
    for k, translation, rotation, body in places(chain):
        if body is None:
            weight: tuple[float, Array, Array] = (mass, np.zeros(3), mass * radius**2 * np.eye(3))
        else:
            weight = (body["mass"], body["center"], body["inertia"]) if keep else (0.0, np.zeros(3), np.zeros((3, 3)))
        bodies[k] = (k, k + 1, int(not np.array_equal(rotation, np.eye(3))), 0, rotation, translation, *weight)
    bodies[-1] = chain.bodies[-1]
    hinges = chain.hinges.copy()
    if not keep:
        hinges["armature"] = 0.0
    return dataclasses.replace(chain, bodies=bodies, hinges=hinges)
