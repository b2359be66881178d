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
def step_error_norm(h, e_q, e_v, work):
    """Error [m] of a step of length h with errors of its angles and rates (n,); `work`: scratch of the method."""
    springs, longest = work.springs, max(h, work.stepper[STEPPER.inverse_ω1])
    at_once = displacement(e_q, work.posture)
    for k in range(len(e_v)):
        springs.δ[k] = longest * e_v[k]
    free = displacement(springs.δ, work.posture) / longest
    if longest * free <= at_once:
        return at_once
    if not free < math.inf:
        return math.nan
    τ, largest = longest, max(at_once, h * free)
    while τ * free > largest and τ > h:
        largest = max(largest, displacement_norm(τ, e_v, work))
        τ *= CLOSER
    for k in range(len(e_v)):
        if springs.impulse[k] != 0.0:
            return max(largest, impulse_norm(longest, e_v, work))
    return largest


@recursion
def displacement_norm(τ, e_v, work):
    """Largest displacement [m] in a time τ."""
    displace(τ, e_v, work)
    return displacement(work.springs.δ, work.posture)


@recursion
def deflection_norm(τ, e_v, work):
    """Largest displacement [m] in a time τ by the springs' angles alone."""
    displace(τ, e_v, work)
    for k in range(len(e_v)):
        if work.chain.hinges[k].stiffness == 0.0:
            work.springs.δ[k] = 0.0
    return displacement(work.springs.δ, work.posture)


@subroutine
def displace(τ, e_v, work):
    """δ of rates. Of dry friction nothing holds: its slope at rest would hide any rate."""
    factors, r, δ = work.springs.factors, work.springs.r, work.springs.δ
    for k in range(len(e_v)):
        held = implicit_rotor(τ, k, work)
        factors[k, FACTORS.A], r[k] = work.chain.hinges[k].armature + held, -τ * held * e_v[k]
    if work.posture.first is not None and len(work.posture.first) > 0:
        put_couplings(τ, τ * τ, work.posture.beside, factors)
        add_products(-τ * τ, -τ * τ * τ, work.chain.rare, e_v, r)
    factor(factors, work.posture)
    solve(factors, r, δ, work.posture)
    for k in range(len(e_v)):
        δ[k] += τ * e_v[k]


@recursion
def impulse_norm(τ, e_v, work):
    """Largest displacement [m] in a time τ by what a sampled law makes of errors of the rates."""
    for k in range(len(e_v)):
        work.springs.r[k] = τ * work.springs.impulse[k] * e_v[k]
    return thrown(τ, work)


@recursion
def thrown(τ, work):
    """Largest displacement [m] in a time τ by impulses [N m s] times τ, `r`."""
    factors, r, δ = work.springs.factors, work.springs.r, work.springs.δ
    for k in range(len(r)):
        factors[k, FACTORS.A] = work.chain.hinges[k].armature + implicit_rotor(τ, k, work)
    if work.posture.first is not None and len(work.posture.first) > 0:
        put_couplings(τ, τ * τ, work.posture.beside, factors)
    factor(factors, work.posture)
    solve(factors, r, δ, work.posture)
    return displacement(δ, work.posture)


@inlined
def implicit_rotor(τ, k, work):
    """τ D + τ² K of a joint, its own and its drive's."""
    hinge, springs = work.chain.hinges[k], work.springs
    d = hinge.damping + springs.kd[k]
    if springs.brakes is not None:
        d += springs.brakes[k]
    return τ * (d + τ * (hinge.stiffness + springs.kp[k]))
