"""Lowest and highest natural frequency due to a chain's springs, in O(n) per iteration, to choose method and step."""

import dataclasses
import math

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.memo import keep_last
from flexlink.common.types import Array
from flexlink.dynamics.terms import inverse_dynamics
from flexlink.kernels.forward.mass_plus_plane import PlanePosture, plane_posture
from flexlink.kernels.forward.mass_plus_shapes import ShapedPosture, shaped_posture
from flexlink.kernels.forward.mass_plus_space import SpacePosture, space_posture
from flexlink.kernels.forward.power_iteration import largest_eigenvalue, smallest_square

PASSES = 30  # largest number of power iterations
CLOSE = 1e-2
"""Relative change of ω² below which power iterations end; error weights and the choice of a method need no more."""


def inertia_alone(chain: Chain) -> Chain:
    """Return the chain without gravity, springs and friction, whose equation of motion at rest is M q̈ = τ."""
    hinges = chain.hinges.copy()
    for name in ("stiffness", "damping", "coulomb"):
        hinges[name] = 0.0
    return dataclasses.replace(chain, hinges=hinges, gravity=np.zeros(3), couplings=chain.couplings[:0])


@keep_last(256)  # runs of one scene share frequencies
def slowest_frequency(chain: Chain, q: Array) -> float:
    """Lowest natural frequency due to springs [rad/s]; joints without springs are free, and gravity is ignored.

    Power iteration φ ← K⁻¹ S φ for K φ = ω² S φ on the hinges p with springs. S = M_pp − M_pa M_aa⁺ M_ap is their
    inertia while the joints a without springs are free. M_aa is singular if a stretched arm moves only a point mass.
    The result is inf if no joint has a spring, or if the sprung mass is below the rounding error.
    """
    square = smallest_square(chain.arrays, q, PASSES, CLOSE)
    if math.isnan(square):  # a torque is beyond float64: raise an error that names it
        inverse_dynamics(inertia_alone(chain), q, np.zeros(chain.n), (chain.stiffness > 0) * 1.0)
    return math.sqrt(square) if square > 0 else math.inf


@keep_last(256)
def fastest_frequency(chain: Chain, q: Array) -> float:
    """Highest natural frequency due to springs [rad/s], from below; 0 without springs, inf without inertia."""
    return fastest_of(chain, q, chain.stiffness, np.zeros(chain.n))[0]


@keep_last(256)
def fastest_decay(chain: Chain, q: Array) -> float:
    """Highest decay rate due to dampers [1/s], from D φ = δ M φ, estimated from below."""
    return fastest_of(chain, q, np.zeros(chain.n), chain.damping)[1]


Posture = PlanePosture | SpacePosture | ShapedPosture
"""Workspace for configurations of a chain, as `mass_plus` takes it."""


def scratch(chain: Chain) -> Posture:
    """Workspace for configurations of a chain."""
    posture: PlanePosture | SpacePosture = (plane_posture if chain.is_planar else space_posture)(chain.arrays)
    return posture if chain.shapes is None else shaped_posture(chain.arrays, chain.shapes, posture)


def fastest_of(
    chain: Chain, q: Array, stiffness: Array, damping: Array, posture: Posture | None = None
) -> tuple[float, float]:
    """√λ and λ of the largest λ of K φ = λ M φ and D φ = λ M φ, by φ ← M⁻¹ K φ; held joints are at rest."""
    found = [0.0, 0.0]
    for k, (name, weights) in enumerate((("stiffness", stiffness), ("damping", damping))):
        if weights.any():
            posture = posture or scratch(chain)
            matrix = np.ascontiguousarray(weights), np.array(chain.couplings[name])
            λ = float(largest_eigenvalue(chain.arrays, q, *matrix, PASSES, CLOSE, posture))
            found[k] = λ if math.isfinite(λ) else math.inf
    return math.sqrt(found[0]), found[1]
