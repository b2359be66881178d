"""How far errors of angles and rates at the end of a step move bodies: what a tolerance in metres is about.

An error e_q of the angles moves them at once. One of the rates, e_v, goes on moving them, against the springs and
dampers, and gets in a time τ, by an implicit Euler step, as far as

    δ = τ (M + τ D + τ² K)⁻¹ M e_v

What counts is the largest δ of τ = 1/ω₁ (the lowest frequency), 1/(8 ω₁), … > h: of a swing with the frequency ω it
is 0.3 to 0.5 of e_v/ω, how far it goes, and of what is free to turn e_v/ω₁. Weighing all rates by 1/ω₁ is simpler, and
counts fast vibrations hundreds of times; weighing them by h lets any error of a slow one pass at small steps.

A sampled law sees the rates of fast vibrations, too, and holds what it makes of them for a period T: an error of theirs
that comes to nothing by itself becomes an impulse T k_d e_v, which throws bodies, in 1/ω₁, by

    δ = τ (M + τ D + τ² K)⁻¹ T k_d e_v
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.forward.mass_plus import FACTORS, displacement, factor, solve
from flexlink.kernels.forward.mass_plus_cells import add_products, put_couplings
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine

CLOSER = 1 / 8  # from one τ to the next


class Springs(NamedTuple):
    """What holds the joints of a chain beside their hinges, and scratch."""

    kp: Any  # (n,) a drive's gains, and so kd
    kd: Any
    brakes: Any  # (n,) slopes of force elements by each joint's own rate; None of a plain chain
    impulse: Any  # (n,) T k_d of a sampled law
    factors: Any  # (n, 8)
    r: Any  # (n,), and so δ
    δ: Any


@subroutine
def step_error_norm(h, e_q, e_v, springs, posture, chain, stepper):
    """Error [m] of a step of length h with errors of its angles and rates (n,).

    Beside them parts of the scratch of a method: calls pass what they take by value, and all of it is a thousand words.
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
    """Largest displacement [m] in a time τ."""
    displace(τ, e_v, springs, posture, chain)
    return displacement(springs.δ, posture)


@recursion
def deflection_norm(τ, e_v, springs, posture, chain):
    """Largest displacement [m] in a time τ by the springs' angles alone."""
    displace(τ, e_v, springs, posture, chain)
    for k in range(len(e_v)):
        if chain.hinges[k].stiffness == 0.0:
            springs.δ[k] = 0.0
    return displacement(springs.δ, posture)


@subroutine
def displace(τ, e_v, springs, posture, chain):
    """δ of rates. Of dry friction nothing holds: its slope at rest would hide any rate."""
    factors, r, δ = springs.factors, springs.r, springs.δ
    for k in range(len(e_v)):
        held = implicit_rotor(τ, k, springs, chain)
        factors[k, FACTORS.A], r[k] = chain.hinges[k].armature + held, -τ * held * e_v[k]
    if posture.first is not None and len(posture.first) > 0:
        put_couplings(τ, τ * τ, posture.beside, factors)
        add_products(-τ * τ, -τ * τ * τ, chain.rare, e_v, r)
    factor(factors, posture)
    solve(factors, r, δ, posture)
    for k in range(len(e_v)):
        δ[k] += τ * e_v[k]


@recursion
def impulse_norm(τ, e_v, springs, posture, chain):
    """Largest displacement [m] in a time τ by what a sampled law makes of errors of the rates."""
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
        put_couplings(τ, τ * τ, posture.beside, factors)
    factor(factors, posture)
    solve(factors, r, δ, posture)
    return displacement(δ, posture)


@inlined
def implicit_rotor(τ, k, springs, chain):
    """τ D + τ² K of a joint, its own and its drive's."""
    hinge = chain.hinges[k]
    d = hinge.damping + springs.kd[k]
    if springs.brakes is not None:
        d += springs.brakes[k]
    return τ * (d + τ * (hinge.stiffness + springs.kp[k]))
