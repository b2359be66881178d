"""Displacement of bodies by errors of angles and rates at the end of a step: the error that the tolerance [m] limits.

An error e_q of the angles displaces bodies at once. An error e_v of the rates continues to displace them, against
springs and dampers. In a time τ, by an implicit Euler step, the displacement follows from

    δ = τ (M + τ D + τ² K)⁻¹ M e_v

The norm is the largest δ for τ = 1/ω₁ (ω₁ the lowest frequency), 1/(8 ω₁), … > h. For a vibration of frequency ω it is
0.3 to 0.5 of the amplitude e_v/ω; for a free joint it is e_v/ω₁. Weighting all rates by 1/ω₁ would be simpler, but
overestimates fast vibrations by factors of hundreds; weighting them by h accepts any error of slow ones at small steps.

A sampled law also measures the rates of fast vibrations, and applies its torque for a period T. A rate error that would
average to zero then becomes an impulse T k_d e_v, which displaces bodies, in 1/ω₁, by

    δ = τ (M + τ D + τ² K)⁻¹ T k_d e_v
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.forward.mass_plus import FACTORS, displacement, factor, solve
from flexlink.kernels.forward.mass_plus_cells import add_products, put_couplings
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine

CLOSER = 1 / 8  # ratio of successive τ


class Springs(NamedTuple):
    """Stiffness and damping of joints in addition to their springs, and scratch arrays."""

    kp: Any  # (n,) gains of the drive; kd the same
    kd: Any
    brakes: Any  # (n,) ∂T_k/∂q̇_k of force elements; None for a plain chain
    impulse: Any  # (n,) T k_d of a sampled law
    factors: Any  # (n, 8)
    r: Any  # (n,); δ the same
    δ: Any


@subroutine
def step_error_norm(h, e_q, e_v, springs, posture, chain, stepper):
    """Error [m] of a step of length h with errors of its angles and rates (n,).

    Only parts of a method's workspace are passed: calls pass it by value, and all of it is a thousand words.
    """
    longest = max(h, stepper[STEPPER.inverse_ω1])
    at_once = displacement(e_q, posture)
    for k in range(len(e_v)):
        springs.δ[k] = longest * e_v[k]
    free = displacement(springs.δ, posture) / longest
    if longest * free <= at_once:
        return at_once
    if not free < math.inf:
        return math.nan
    τ, largest = longest, max(at_once, h * free)
    while τ * free > largest and τ > h:
        stepper[STEPPER.weighed] += 1.0
        largest = max(largest, displacement_norm(τ, e_v, springs, posture, chain))
        τ *= CLOSER
    for k in range(len(e_v)):
        if springs.impulse[k] != 0.0:
            stepper[STEPPER.weighed] += 1.0
            return max(largest, impulse_norm(longest, e_v, springs, posture, chain))
    return largest


@recursion
def displacement_norm(τ, e_v, springs, posture, chain):
    """Largest displacement [m] by an error of the rates in a time τ."""
    displace(τ, e_v, springs, posture, chain)
    return displacement(springs.δ, posture)


@recursion
def deflection_norm(τ, e_v, springs, posture, chain):
    """Largest displacement [m] in a time τ, computed from the angles of springs only."""
    displace(τ, e_v, springs, posture, chain)
    for k in range(len(e_v)):
        if chain.hinges[k].stiffness == 0.0:
            springs.δ[k] = 0.0
    return displacement(springs.δ, posture)


@subroutine
def displace(τ, e_v, springs, posture, chain):
    """δ of an error of the rates, without dry friction: its slope at rest would suppress any error."""
    factors, r, δ = springs.factors, springs.r, springs.δ
    for k in range(len(e_v)):
        held = implicit_rotor(τ, k, springs, chain)
        factors[k, FACTORS.A], r[k] = chain.hinges[k].armature + held, -τ * held * e_v[k]
    if posture.first is not None and len(posture.first) > 0:
        put_couplings(τ, τ * τ, posture.coupled, factors)
        add_products(-τ * τ, -τ * τ * τ, chain.rare, e_v, r)
    factor(factors, posture)
    solve(factors, r, δ, posture)
    for k in range(len(e_v)):
        δ[k] += τ * e_v[k]


@recursion
def impulse_norm(τ, e_v, springs, posture, chain):
    """Largest displacement [m] in a time τ by the response of a sampled law to errors of the rates."""
    for k in range(len(e_v)):
        springs.r[k] = τ * springs.impulse[k] * e_v[k]
    return thrown(τ, springs, posture, chain)


@recursion
def thrown(τ, springs, posture, chain):
    """Largest displacement [m] in a time τ by impulses [N m s] times τ, `r`."""
    factors, r, δ = springs.factors, springs.r, springs.δ
    for k in range(len(r)):
        factors[k, FACTORS.A] = chain.hinges[k].armature + implicit_rotor(τ, k, springs, chain)
    if posture.first is not None and len(posture.first) > 0:
        put_couplings(τ, τ * τ, posture.coupled, factors)
    factor(factors, posture)
    solve(factors, r, δ, posture)
    return displacement(δ, posture)


@inlined
def implicit_rotor(τ, k, springs, chain):
    """τ D + τ² K of a joint and its drive."""
    hinge = chain.hinges[k]
    d = hinge.damping + springs.kd[k]
    if springs.brakes is not None:
        d += springs.brakes[k]
    return τ * (d + τ * (hinge.stiffness + springs.kp[k]))
