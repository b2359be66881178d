"""Newton's iteration for the stages K_i of an implicit step: its linear systems, solved in O(n).

    R_i = f(t_i, Q_i, V_i) − M(Q_i) K_i → 0        K ← K + x

The Jacobian is simplified: M at the posture in the middle of the step, and matrices K and D of springs, dampers,
friction's slope and a drive's gains, diagonal except for couplings. With A = T Λ T⁻¹ the equations decouple into one
system for each eigenvalue λ of A, where one of each complex pair suffices. The matrix of this system is M with rotors
A_λ = hλ D + h²λ² K:

    (M + A_λ) x_λ = T⁻¹ R        x = T x_λ

The omitted terms, the derivatives of gravity and of velocity terms, lead to a contraction factor of 1e-3 to 0.2 at
useful steps.

A hinge that twists a straight slender arm moves a millionth of the inertia that it moves when the arm is bent. Then δM,
the change of M from stage to stage, is not small compared with M, and the term M⁻¹ δM K_i makes the iteration diverge.
In this case every stage is solved with a separate matrix, and a second solution with M + A_λ corrects the coupling of
the stages:

    w_i = (M(Q_i) + A_γ)⁻¹ R_i        x_λ = T⁻¹ w − (M + A_λ)⁻¹ (A_λ − A_γ) T⁻¹ w        γ the real eigenvalue

so x_γ = T⁻¹ w. Without dampers the remaining effect of δM is (1 − λ²/γ²) (M + h²λ² K)⁻¹ δM (M + h²γ² K)⁻¹ h²γ² K.
"""

import math

from flexlink.kernels.forward.mass_plus import displacement, factor, place_bodies, posture_of_stage, shift_cells, solve
from flexlink.kernels.forward.mass_plus_cells import COUPLED, FACTORS, add_products
from flexlink.kernels.stepping.error_norm import held
from flexlink.kernels.stepping.implicit_layout import STAGE, VECTOR, WEIGHT
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.ties import hold
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine


@inlined
def slope(work, k, rate):
    """D of joint `k`: its dampers, drive gain, and the secant slope of dry friction, which prevents overshoot."""
    hinge = work.chain.hinges[k]
    d = hinge.damping + work.springs.kd[k]
    if work.springs.own is not None:
        d += work.springs.own[1, k]
    if hinge.coulomb > 0.0:
        x = abs(rate) / hinge.coulomb_width
        d += hinge.coulomb / hinge.coulomb_width * (math.tanh(x) / x if x > 1e-8 else 1.0)
    return d


@recursion
def factor_all(h, rates, work):
    """Factor M + hλ D + h²λ² K for every λ, with friction's slope at `rates`; at an infinite rate the slope is 0."""
    for m in range(len(work.method.real)):
        shift_rotors(h * work.method.real[m], rates, work.factors[m], work)
        factor(work.factors[m], work.posture)
    for m in range(len(work.method.pairs)):
        shift_rotors(h * work.method.pairs[m], rates, work.factors_pairs[m], work)
        factor(work.factors_pairs[m], work.posture)


@inlined
def shift_rotors(z, rates, factors, work):
    """Write A = rotors + z D + z² K to `factors`."""
    for k in range(len(factors)):
        resists = slope(work, k, rates[k]) + z * held(k, work.springs, work.chain)
        factors[k, FACTORS.A] = work.chain.hinges[k].armature + z * resists
    shift_cells(z, factors, work.posture)


@recursion
def slowest_rates(qd, rates, work):
    """Write each joint's smallest rate in the step, 0 if it reverses; the secant slope is steepest at this rate."""
    for k in range(len(qd)):
        least = qd[k]
        for i in range(work.stages.shape[1]):
            rate = work.stages[STAGE.qd, i, k]
            if least * rate <= 0.0:
                least = 0.0
            elif abs(rate) < abs(least):
                least = rate
        rates[k] = least


@inlined
def inertia_beyond(k, work):
    """Inertia [kg m²] that joint k moves, without its rotor, if outboard joints have the A of the first factors."""
    if work.posture.first is not None and len(work.posture.first) > 0:
        return abs(
            work.factors[0, k, COUPLED.inertia] if len(work.factors) > 0 else work.factors_pairs[0, k, COUPLED.inertia]
        )
    if len(work.factors) > 0:
        return 1.0 / work.factors[0, k, FACTORS.inverse] - work.factors[0, k, FACTORS.A]
    return abs(1.0 / work.factors_pairs[0, k, FACTORS.inverse] - work.factors_pairs[0, k, FACTORS.A])


@subroutine
def factor_stages(h, work):
    """Factor M(Q_i) + A_γ of every stage, at the angles of the first iteration."""
    z = h * work.method.real[0]
    for i in range(work.stages.shape[1]):
        posture, factors = posture_of_stage(i, work.stage_postures), work.stage_factors[i]
        place_bodies(work.stages[STAGE.q, i], posture)
        for k in range(len(factors)):
            factors[k, FACTORS.A] = work.factors[0, k, FACTORS.A]
        shift_cells(z, factors, posture)
        factor(factors, posture)


@subroutine
def divide_stages(work):
    """Write w_i = (M(Q_i) + A_γ)⁻¹ R_i of every stage."""
    for i in range(work.stages.shape[1]):
        posture = posture_of_stage(i, work.stage_postures)
        solve(work.stage_factors[i], work.stages[STAGE.residual, i], work.stages[STAGE.divided, i], posture)


@inlined
def improve(h, by_stage, work):
    """K += T x for all eigenvalues; adds the resulting changes of angles and rates to the vectors of `changes`."""
    method, r, x, z = work.method, work.vectors[VECTOR.rhs], work.vectors[VECTOR.solution], work.pairs
    for m in range(len(method.real)):
        solve_one(h, method.real[m], method.Tinv_real[m], work.factors[m], r, x, by_stage, work)
        if work.ties is not None:
            hold(h * method.real[m], m, 1.0, method.T_real, method.Tinv_real, x, work.ties.real, work.ties)
        add_changes(h, 1.0, method.T_real[:, m], x, work)
    for m in range(len(method.pairs)):
        solve_one(h, method.pairs[m], method.Tinv_pairs[m], work.factors_pairs[m], z[0], z[1], by_stage, work)
        if work.ties is not None:
            hold(h * method.pairs[m], m, 2.0, method.T_pairs, method.Tinv_pairs, z[1], work.ties.pairs, work.ties)
        add_changes(h, 2.0, method.T_pairs[:, m], z[1], work)


@inlined
def solve_one(h, λ, Tinv, factors, r, x, by_stage, work):
    """Solve for x_λ with r = T⁻¹ R, or with r = T⁻¹ w if `by_stage`; `Tinv` is a row of T⁻¹."""
    R = work.stages[STAGE.divided if by_stage else STAGE.residual]
    r[:] = 0.0
    for j in range(len(Tinv)):
        for k in range(len(r)):
            r[k] += Tinv[j] * R[j, k]
    for k in range(len(r)):
        x[k] = (factors[k, FACTORS.A] - work.factors[0, k, FACTORS.A]) * r[k] if by_stage else r[k]
    if by_stage and work.posture.first is not None and len(work.posture.first) > 0:
        γ = work.method.real[0]
        add_products(h * (λ - γ), h * h * (λ * λ - γ * γ), work.chain.rare, r, x)
    solve(factors, x, x, work.posture)
    if by_stage:
        for k in range(len(r)):
            x[k] = r[k] - x[k]


@inlined
def add_changes(h, twice, T, x, work):
    """K_i += Re(twice T_i x); adds the resulting changes of q and q̇ at the end of the step to the vectors `changes`."""
    qdd, weights, (δq, δv) = work.stages[STAGE.qdd], work.method.weights, changes(work)
    for i in range(len(T)):
        weight = twice * T[i]
        for k in range(len(x)):
            δ = (weight * x[k]).real
            qdd[i, k] += δ
            δq[k] += h * h * weights[WEIGHT.bA, i] * δ
            δv[k] += h * weights[WEIGHT.b, i] * δ


@inlined
def changes(work):
    """The vectors δq and δv (n,): changes of angles and rates at the end of the step due to one Newton pass."""
    return work.vectors[VECTOR.q_middle], work.vectors[VECTOR.tau]


@inlined
def moved_by_changes(h, work):
    """How far δq and δv displace a body at the end of the step [m]; records the joint whose rate changes most."""
    δq, δv = changes(work)
    worst = 0
    for k in range(len(δv)):
        δv[k] *= max(h, work.stepper[STEPPER.inverse_ω1])
        if abs(δv[k]) > abs(δv[worst]):
            worst = k
    work.stepper[STEPPER.worst_joint] = worst
    return max(displacement(δq, work.posture), displacement(δv, work.posture))
