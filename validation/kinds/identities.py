"""Identities of the equation of motion at random states, independent of other engines.

Derivatives are exact, not finite differences with a small step. As functions of one angle, kinetic and gravity energy
are trigonometric polynomials of degree at most 2, so five equidistant points over the full turn give the derivative:

    f'(0) = Σ_j=1,2 w_j (f(jΔ) − f(−jΔ)),    Δ = 2π/5,    w_j = ½ (−1)^(j+1) / sin(jΔ/2)

As functions of one rate (or of one angle, for elastic energy) energies are quadratic, and f'(0) = (f(1) − f(−1))/2.

Every error is relative to the sum of the magnitudes of all added terms; rounding alone causes errors of about eps.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.diagnosis.quantities import State, random_states
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.dynamics.point_motion import body_motion
from flexlink.dynamics.rounding import acceleration_error, in_units, of_mass_matrix
from flexlink.dynamics.terms import algorithms_of
from validation.case import Case, Measured
from validation.kinds import kind

TRIGONOMETRIC_STENCIL = {
    j * 2 * math.pi / 5 * sign: sign * 0.5 * (-1) ** (j + 1) / math.sin(j * math.pi / 5)
    for j in (1, 2)
    for sign in (1, -1)
}
"""Angle → weight, for the derivative of a trigonometric polynomial of degree 2."""
QUADRATIC_STENCIL = {1.0: 0.5, -1.0: -0.5}
"""Step → weight, for the derivative of a quadratic."""


@kind(long=True)
def run(case: Case, samples: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest violation of each identity over the states of each scene."""
    for scene in case.load_scenes():
        chain = fl.lump(scene)
        states = random_states(chain, samples, seed=seed)
        for quantity, (violation, worst) in IDENTITIES.items():
            found = worst([violation(chain, state) for state in states])
            yield Measured(quantity, found, scene.name, varied={"states": samples})


def _asymmetry(chain: Chain, s: State) -> float:
    if chain.is_serial_revolute:
        M = fl.mass_matrix(chain, s.q, algorithm="columns")  # the only method that computes both triangles
    else:
        bias = fl.bias_torque(chain, s.q, np.zeros(chain.n))
        M = np.array([fl.inverse_dynamics(chain, s.q, np.zeros(chain.n), unit) - bias for unit in np.eye(chain.n)])
    return float(np.abs(M - M.T).max() / np.abs(M).max())


def _smallest_eigenvalue(chain: Chain, s: State) -> float:
    values = np.linalg.eigvalsh(fl.mass_matrix(chain, s.q))
    return float(values[0] / np.abs(values).max())


def _methods(chain: Chain, s: State) -> float:
    M = np.array([fl.mass_matrix(chain, s.q, algorithm=name) for name in algorithms_of(chain)])
    return float(in_units(np.ptp(M, axis=0), of_mass_matrix(chain, s.q)).max())


def _solvers(chain: Chain, s: State) -> float:
    qdd = [fl.forward_dynamics(chain, s.q, s.qd, s.tau, solver=name, tip_wrench=s.wrench) for name in SOLVERS]
    pairs = itertools.combinations(qdd, 2)
    return float(
        np.max([acceleration_error(chain, s.q, s.qd, s.tau, solutions=pair, tip_wrench=s.wrench) for pair in pairs])
    )


def _kinetic(chain: Chain, s: State) -> float:
    terms = 0.5 * np.outer(s.qd, s.qd) * fl.mass_matrix(chain, s.q)
    return float(abs(fl.energy(chain, s.q, s.qd).kinetic - terms.sum()) / np.abs(terms).sum())


def _power(chain: Chain, s: State) -> float:
    """q̇·(T_EX − T_FR − T_DRAG) = dE/dt along the motion, with q̈ from forward dynamics."""
    qdd = fl.forward_dynamics(chain, s.q, s.qd, s.tau)
    supplied = s.qd * (s.tau - fl.friction_torque(chain, s.qd) - fl.drag_torque(chain, s.q, s.qd))
    rate, size = (
        _rates(lambda q: _rigid_energy(chain, q, s.qd), s.q, s.qd, TRIGONOMETRIC_STENCIL)
        + _rates(lambda q: fl.energy(chain, q, s.qd).elastic, s.q, s.qd, QUADRATIC_STENCIL)
        + _rates(lambda qd: fl.energy(chain, s.q, qd).kinetic, s.qd, qdd, QUADRATIC_STENCIL)
    )
    return _relative(supplied - rate, np.abs(supplied) + size)


def _skew(chain: Chain, s: State) -> float:
    """q̇ᵀ Ṁ q̇ = 2 q̇ᵀ C q̇, with C q̇ = T_GC − T_G and ½ q̇ᵀ Ṁ q̇ = Σ q̇_k ∂T/∂q_k at fixed q̇."""
    slope, size = _rates(lambda q: fl.energy(chain, q, s.qd).kinetic, s.q, s.qd, TRIGONOMETRIC_STENCIL)
    coriolis = s.qd * (fl.bias_torque(chain, s.q, s.qd) - fl.gravity_torque(chain, s.q))
    return _relative(slope - coriolis, size + np.abs(coriolis))


def _inverse(chain: Chain, s: State) -> float:
    """Inverse dynamics of the accelerations from forward dynamics returns the drive torque."""
    qdd = fl.forward_dynamics(chain, s.q, s.qd, s.tau, tip_wrench=s.wrench)
    own = fl.elastic_torque(chain, s.q) + fl.friction_torque(chain, s.qd) + fl.drag_torque(chain, s.q, s.qd)
    back = fl.inverse_dynamics(chain, s.q, s.qd, qdd, tip_wrench=s.wrench) + own
    size = np.abs(fl.mass_matrix(chain, s.q)) @ np.abs(qdd) + np.abs(own)
    return float(np.abs(back - s.tau).max() / size.max())


def _hinge_moments(chain: Chain, s: State) -> float:
    """The internal moment about a hinge axis is minus the inverse-dynamics torque without the rotor's torque."""
    qdd = fl.forward_dynamics(chain, s.q, s.qd, s.tau, tip_wrench=s.wrench)
    found = fl.strength.internal_loads(chain, s.q, s.qd, qdd, tip_wrench=s.wrench)
    torque = fl.inverse_dynamics(chain, s.q, s.qd, qdd, tip_wrench=s.wrench) - chain.hinges["armature"] * qdd
    size = np.abs(fl.mass_matrix(chain, s.q)) @ np.abs(qdd) + np.abs(fl.bias_torque(chain, s.q, s.qd))
    return float(np.abs(found.hinge_moment + torque).max() / size.max())


def _equilibrium(chain: Chain, s: State) -> float:
    """Newton-Euler equations of each segment, in its axes: Σ f = m (a − g), Σ (n + r × f) = I α + ω × I ω."""
    qdd = fl.forward_dynamics(chain, s.q, s.qd, s.tau, tip_wrench=s.wrench)
    cut = fl.strength.internal_loads(chain, s.q, s.qd, qdd, tip_wrench=s.wrench)
    f, n = cut.force, cut.moment
    R, p, _, _, *turning, _ = body_motion(chain, s.q, s.qd, qdd)
    worst = 0.0
    for i, body in enumerate(chain.bodies[:-1]):
        ω, a, α = (R[i].T @ part[i] for part in turning)
        to, c, mass, inertia = R[i].T @ R[i + 1], body["center"], body["mass"], body["inertia"]
        near, far = -c, R[i].T @ (p[i + 1] - p[i]) - c
        out, couple = to @ f[i + 1], to @ n[i + 1]
        force = out - f[i] - mass * (a - R[i].T @ chain.gravity + np.cross(α, c) + np.cross(ω, np.cross(ω, c)))
        moment = couple - n[i] + np.cross(far, out) - np.cross(near, f[i])
        moment -= inertia @ α + np.cross(ω, inertia @ ω)
        worst = max(worst, np.abs(force).max() / np.abs(f).max(), np.abs(moment).max() / np.abs(n).max())
    return float(worst)


def _rigid_energy(chain: Chain, q: Array, qd: Array) -> Any:
    parts = fl.energy(chain, q, qd)
    return parts.kinetic + parts.gravity


def _rates(f: Callable[[Array], Any], x: Array, xd: Array, stencil: dict[float, float]) -> Array:
    """ẋ_k ∂f/∂x_k, and the sum of magnitudes of its terms; shape (2, n)."""
    out = np.zeros((2, len(x)))
    for k in range(len(x)):
        for step, weight in stencil.items():
            moved = x.copy()
            moved[k] += step
            term = xd[k] * weight * f(moved)
            out[:, k] += term, abs(term)
    return out


def _relative(terms: Array, sizes: Array) -> float:
    return float(abs(terms.sum()) / sizes.sum())


IDENTITIES: dict[str, tuple[Callable[[Chain, State], float], Callable[[list[float]], float]]] = {
    "M symmetric": (_asymmetry, max),
    "M positive definite": (_smallest_eigenvalue, min),
    "four methods for M": (_methods, max),
    "solvers for q̈": (_solvers, max),
    "½ q̇ᵀMq̇ = kinetic energy": (_kinetic, max),
    "power balance": (_power, max),
    "Ṁ − 2C skew": (_skew, max),
    "ID∘FD = identity": (_inverse, max),
    "moments about hinges": (_hinge_moments, max),
    "equilibrium of cut segments": (_equilibrium, max),
}
