"""Gradient of a function J of a run's samples by the discrete adjoint of explicit Runge-Kutta steps, back in time.

One stage, K = q̈ = M⁻¹ (T_EX − T), T the torques of all other loads, with the adjoint ν = ∂J/∂K:

    M w = ν        ∂J/∂T_EX = w        κ = ∂J/∂q = −∂(w·(M q̈ + T))/∂q        δ = ∂J/∂q̇ = −∂(w·T)/∂q̇

One step of `runge_kutta`, with the adjoint λ of the state at its end and ρ_i = ∂J/∂L_i; the stages from last to first:

    ν_i = h b_i λ_q̇ + h Σ_j>i a_ji ρ_j        ρ_i = h b_i λ_q + h Σ_j>i a_ji κ_j + δ_i
    λ_q ← λ_q + Σ κ_i                         λ_q̇ ← λ_q̇ + Σ ρ_i                             ∂J/∂T_EX = Σ w_i

The stages are not stored: they are repeated from sample to sample, by the same arithmetic as in the run.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.derivatives.forward_derivatives import friction_derivative
from flexlink.kernels.derivatives.load_gradient import LoadGradientWork, gradient_in_space
from flexlink.kernels.derivatives.planar_load_gradient import PlanarLoadGradientWork, gradient_in_plane
from flexlink.kernels.forces.elements import find_slopes, force_slopes_of, forces_of
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.inputs.tip_wrench import put_wrench
from flexlink.kernels.stepping.runge_kutta import StepWork, step
from flexlink.kernels.tools.compiler import by_type, kernel, recursion


class AdjointWork(NamedTuple):
    """Scratch of `go_back`, with the constants of a chain."""

    chain: Any
    forward: Any  # scratch of the run's forward dynamics
    bare: Any  # scratch of forward dynamics without gravity, springs and friction, which solves M w = ν
    loads: Any  # scratch of `load_gradient`
    slopes: Any  # derivatives of force elements; None for a plain chain
    ν: Any  # (s, n)
    ρ: Any  # (s, n)
    vectors: Any  # (6, n) 0, Q, w, κ, δ, and torques
    nothing: Any  # (6,) 0


@kernel
def adjoint_workspace(chain, forward, bare, loads, s):
    """Scratch of `go_back` for steps of s stages."""
    n, slopes = len(chain.hinges), force_slopes_of(chain, forces_of(chain))
    ν, ρ, vectors = np.empty((s, n)), np.empty((s, n)), np.zeros((6, n))
    return AdjointWork(chain, forward, bare, loads, slopes, ν, ρ, vectors, np.zeros(6))


@by_type({PlanarLoadGradientWork: gradient_in_plane, LoadGradientWork: gradient_in_space})
def load_gradient(chain, wrench, q, qd, qdd, w, by_angle, by_rate, work):
    """Write ∂(w·τ)/∂q and ∂(w·τ)/∂q̇ (n,) of τ = M q̈ + T_GC, under the tip wrench (6,) in frame 0."""


@kernel
def go_back(work, tableau, inputs, h, origin, every, samples, given, λ, found):
    """Take λ (2, n), ∂J/∂q and ∂J/∂q̇ of the last sample, back to the first one.

    `samples`: q and q̇ (samples, n) of a run, `every` steps apart; `given`: ∂J/∂q and ∂J/∂q̇ of each. Writes ∂J/∂T_EX
    (samples − 1, n) of torques that are held between samples to `found`. Returns the index of the sample, if any, after
    which the steps do not lead to the next sample, otherwise −1.
    """
    qs, qds = samples
    s, n = work.ν.shape
    K, L, q = np.empty((every, s, n)), np.empty((every, s, n)), np.empty((every + 1, n))
    qd, done = np.empty(n), np.zeros(1)
    for row in range(len(found) - 1, -1, -1):
        start = origin + row * every
        q[0, :], qd[:], found[row, :] = qs[row], qds[row], 0.0
        for i in range(every):
            q[i + 1, :] = q[i]
            stages = StepWork(work.vectors[1], work.vectors[5], K[i], L[i])
            step(work.forward, tableau, inputs, h, start + i, (q[i + 1], qd, done), stages)
        for k in range(n):
            if q[every, k] != qs[row + 1, k] or qd[k] != qds[row + 1, k]:
                return row
        for i in range(every - 1, -1, -1):
            step_back(work, tableau, inputs, h, start + i, q[i], (K[i], L[i]), λ, found[row])
        for k in range(n):
            λ[0, k], λ[1, k] = λ[0, k] + given[0, row, k], λ[1, k] + given[1, row, k]
    return -1


@recursion
def step_back(work, tableau, inputs, h, number, q, stages, λ, torque):
    """Take λ back from the end of a step to its start at t = number · h and angles q; add ∂J/∂T_EX to `torque` (n,)."""
    A, b, c = tableau
    (K, L), ν, ρ, vectors = stages, work.ν, work.ρ, work.vectors
    Q, w, κ, δ = vectors[1], vectors[2], vectors[3], vectors[4]
    for i in range(len(c)):
        for k in range(len(q)):
            ν[i, k], ρ[i, k] = h * b[i] * λ[1, k], h * b[i] * λ[0, k]
    for i in range(len(c) - 1, -1, -1):
        for k in range(len(q)):
            Q[k] = q[k]
        for j in range(i):
            add_multiple(h * A[i, j], L[j], Q)
        put_wrench(inputs.loads, (number + c[i]) * h, (number + 0.5) * h, Q, L[i], inputs.wrench)
        forward_dynamics(work.nothing, Q, vectors[0], ν[i], w, work.bare)
        stage_back(work, inputs.wrench, Q, L[i], K[i], w, κ, δ)
        add_multiple(1.0, δ, ρ[i])
        for j in range(i):
            add_multiple(h * A[i, j], ρ[i], ν[j])
            add_multiple(h * A[i, j], κ, ρ[j])
        add_multiple(1.0, κ, λ[0])
        add_multiple(1.0, ρ[i], λ[1])
        add_multiple(1.0, w, torque)


@recursion
def stage_back(work, wrench, q, qd, qdd, w, κ, δ):
    """Write κ and δ (n,) for w; a planar chain must be placed at the angles q."""
    hinges = work.chain.hinges
    load_gradient(work.chain, wrench, q, qd, qdd, w, κ, δ, work.loads)
    for k in range(len(q)):
        κ[k] = -κ[k] - hinges[k].stiffness * w[k]
        δ[k] = -δ[k] - friction_derivative(hinges[k], qd[k]) * w[k]
    if work.slopes is not None and work.slopes.act:
        find_slopes(work.slopes, q, qd)
        for k in range(len(q)):
            add_multiple(-w[k], work.slopes.found[0, k], κ)
            add_multiple(-w[k], work.slopes.found[1, k], δ)


@recursion
def add_multiple(x, a, b):
    """b ← b + x a, skipped for x = 0: tableaus of high order have many zeros."""
    if x != 0.0:
        for k in range(len(b)):
            b[k] += x * a[k]
