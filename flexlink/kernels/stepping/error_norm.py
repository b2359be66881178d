"""Error norm of a step in metres: how far errors of the angles and rates at its end displace the bodies.

An error e_q of the angles displaces them at once. An error e_v of the rates displaces them later, against springs and
dampers. In a time τ, by one implicit Euler step, the displacement of the angles is

    δ = τ (M + τ D + τ² K)⁻¹ M e_v

The norm is the largest δ for τ = 1/ω₁ (ω₁: the lowest frequency), 1/(8 ω₁), … > h. For a vibration of frequency ω, it
is 0.3 to 0.5 times the amplitude e_v/ω; for joints that turn freely, it is e_v/ω₁. The simpler weight 1/ω₁ for all
rates would overestimate fast vibrations by a factor of hundreds. The weight h would ignore errors of slow motion at
small steps.

A sampled law also reads the rates of fast vibrations and keeps its torque for a period T. An error of the rates that
would otherwise vanish then becomes an impulse T k_d e_v, which displaces bodies, within τ = 1/ω₁, by

    δ = τ (M + τ D + τ² K)⁻¹ T k_d e_v

Implicit methods damp fast vibrations and, in their error estimates, hide them: such errors are in fact several times
larger and, because the law repeats them, add up. They count by a factor `STEPPER.read`, so that the steps follow the
vibrations that the law reads. Errors of rates that nothing holds last; their displacements are added up for the
stated error of a run.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.forward.mass_plus import displacement, factor, shift_cells, solve
from flexlink.kernels.forward.mass_plus_cells import FACTORS, add_products
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.ties import pull_back
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine

CLOSER = 1 / 8  # factor from one τ to the next


class Springs(NamedTuple):
    """Stiffness and damping of joints in addition to their hinges' springs and dampers; scratch of the error norm."""

    kp: Any  # (n,) proportional gains of the drives; kd: derivative gains
    kd: Any
    own: Any  # (2, n) ∂T_k/∂q_k and ∂T_k/∂q̇_k of force elements; None for a plain chain
    impulse: Any  # (n,) T k_d of a sampled law, T its period
    factors: Any  # (n, 8) factors of M + τ D + τ² K
    r: Any  # (n,) right-hand side; δ (n,): solution
    δ: Any


@subroutine
def step_error_norm(h, e_q, e_v, springs, posture, chain, stepper, ties):
    """Error norm [m] of a step of length h with errors e_q of its angles and e_v of its rates (n,).

    The scratch is passed in parts, because a call copies its arguments, and the descriptors of a method's whole scratch
    take a thousand machine words.
    """
    coast = stepper[STEPPER.coast]
    stepper[STEPPER.drift] = stepper[STEPPER.kick] = 0.0
    if coast > 0.0:
        stepper[STEPPER.drift] = displacement_norm(coast, e_v, springs, posture, chain, ties) / coast
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
        largest = max(largest, displacement_norm(τ, e_v, springs, posture, chain, ties))
        τ *= CLOSER
    for k in range(len(e_v)):
        if springs.impulse[k] != 0.0:
            stepper[STEPPER.weighed] += 1.0
            for j in range(len(e_v)):
                springs.r[j] = longest * springs.impulse[j] * e_v[j]
            stepper[STEPPER.kick] = thrown(longest, springs, posture, chain)
            return max(largest, stepper[STEPPER.read] * stepper[STEPPER.kick])
    return largest


@recursion
def displacement_norm(τ, e_v, springs, posture, chain, ties):
    """Largest displacement [m] of a body in a time τ due to errors e_v of the rates."""
    displace(τ, e_v, springs, posture, chain)
    if ties is not None:
        pull_back(τ, springs.δ, springs.factors, posture, ties)
    return displacement(springs.δ, posture)


@recursion
def deflection_norm(τ, e_v, springs, posture, chain):
    """Largest displacement [m] of a body in a time τ due to e_v, counting only deflections of springs."""
    displace(τ, e_v, springs, posture, chain)
    for k in range(len(e_v)):
        if chain.hinges[k].stiffness == 0.0:
            springs.δ[k] = 0.0
    return displacement(springs.δ, posture)


@subroutine
def displace(τ, e_v, springs, posture, chain):
    """Write δ for rate errors e_v; omits dry friction, whose slope at rest would hide any error of a rate."""
    factors, r, δ = springs.factors, springs.r, springs.δ
    for k in range(len(e_v)):
        held = implicit_rotor(τ, k, springs, chain)
        factors[k, FACTORS.A], r[k] = chain.hinges[k].armature + held, -τ * held * e_v[k]
    shift_cells(τ, factors, posture)
    if posture.first is not None and len(posture.first) > 0:
        add_products(-τ * τ, -τ * τ * τ, chain.rare, e_v, r)
    factor(factors, posture)
    solve(factors, r, δ, posture)
    for k in range(len(e_v)):
        δ[k] += τ * e_v[k]


@subroutine
def thrown(τ, springs, posture, chain):
    """Largest displacement [m] of a body in a time τ due to impulses [N m s]; `springs.r` is τ times the impulses."""
    factors, r, δ = springs.factors, springs.r, springs.δ
    for k in range(len(r)):
        factors[k, FACTORS.A] = chain.hinges[k].armature + implicit_rotor(τ, k, springs, chain)
    shift_cells(τ, factors, posture)
    factor(factors, posture)
    solve(factors, r, δ, posture)
    return displacement(δ, posture)


@inlined
def implicit_rotor(τ, k, springs, chain):
    """τ D + τ² K of joint k, including the gains of its drive and the slope of its force elements."""
    d = chain.hinges[k].damping + springs.kd[k]
    if springs.own is not None:
        d += springs.own[1, k]
    return τ * (d + τ * held(k, springs, chain))


@inlined
def held(k, springs, chain):
    """K of joint k: its spring, the gain of its drive and the slope of its force elements."""
    stiffness = chain.hinges[k].stiffness + springs.kp[k]
    if springs.own is not None:
        stiffness += springs.own[0, k]
    return stiffness
