"""Explicit Runge-Kutta with fixed step for q̈ = f(t, q, q̇), the paper's equations 5 to 12; the loop is compiled.

L_i = q̇ + h Σ_j<i a_ij K_j        K_i = f(t + c_i h, q + h Σ_j<i a_ij L_j, L_i)
q ← q + h Σ b_i L_i               q̇ ← q̇ + h Σ b_i K_i

The same method integrates the power of the non-conservative forces, P = q̇·(T_EX − T_FR) + m·ω, plus f·ṗ if the force
on the tip varies (`tip_wrench`):

W ← W + h Σ b_i P_i
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forward.solvers import forward_under
from flexlink.kernels.inputs.drive_torque import follow, sample_at_step, stage_torque
from flexlink.kernels.tools.compiler import entry, inlined, kernel, recursion, shared, subroutine
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import at, put_at

NEVER = 2**62
"""Value of `every` in `integrate` if no step is a sample."""


class StepWork(NamedTuple):
    """Scratch of `step`: a stage's angles and drive torques; rates L_i and accelerations K_i of all stages."""

    q: Any
    tau: Any
    K: Any
    L: Any


@kernel
def step_workspace(tableau, q):
    """Scratch of `step` for states of the shape of `q`: (n,), or (n, 8) of eight chains."""
    shape = (len(tableau[2]), *q.shape)
    return StepWork(np.empty_like(q), np.zeros_like(q), np.empty(shape), np.empty(shape))


@kernel
def integrate(work, tableau, inputs, h, origin, first, last, far, every, state, samples):
    """Advance the state q, q̇ (n,) and W (1,) in place from step number `first` to `last`, with scratch of a solver.

    It stops early if a free base has turned by more than `far` [rad]; `far` is inf for a fixed base.

    Steps are counted from the start of the run, where t = origin · h. Every `every`-th state goes to its row of
    `samples`: q, q̇ (rows, n) and W (rows,). Returns the number of the last step whose q and q̇ are finite. If that
    number is not `last`, `state` is the first state that is not finite, unless the base has turned.
    For eight chains, all states have shape (…, 8), and all chains stop when the state of one is not finite.
    """
    q, qd, done = state
    qs, qds, works = samples
    stages = step_workspace(tableau, q)
    for number in range(first, last):
        sample_law_at(inputs, h, origin + number, state, stages)
        step(work, tableau, inputs, h, origin + number, state, stages)
        if not (is_finite(q) and is_finite(qd)):
            return number
        if (number + 1) % every == 0:
            row = (number + 1) // every
            for k in range(len(q)):
                put_at(qs, at(q, k), row, k)
                put_at(qds, at(qd, k), row, k)
            put_at(works, at(done, 0), row)
        if has_turned(q, far):
            return number + 1
    sample_law_at(inputs, h, origin + last, state, stages)
    return last


@inlined
def has_turned(q, far):
    """Whether a free base has turned by more than `far`, inf for a fixed base; always False for eight chains."""
    if q.ndim == 1:
        return far < math.inf and base_angle(q) > far
    return False


@recursion
def base_angle(q):
    """The largest magnitude of the three angles of a free base [rad]."""
    return max(abs(q[3]), abs(q[4]), abs(q[5]))


@kernel
def probe(work, tableau, inputs, h, origins, rows, samples, ends):
    """Write to `ends` (2, rows, n) the angles after one step of h, and after two steps of h/2.

    Row i starts from row `rows[i]` of `samples`, q and q̇ (samples, n), at t = `origins[i]` · h.
    """
    qs, qds = samples
    q, qd = np.empty_like(qs[0]), np.empty_like(qds[0])
    done = np.zeros_like(q[:1])
    for i in range(len(rows)):
        for parts in (1, 2):
            stages = step_workspace(tableau, q)
            for k in range(len(q)):
                put_at(q, at(qs, rows[i], k), k)
                put_at(qd, at(qds, rows[i], k), k)
            for part in range(parts):
                number = parts * origins[i] + part
                sample_law_at(inputs, h / parts, number, (q, qd, done), stages)
                step(work, tableau, inputs, h / parts, number, (q, qd, done), stages)
                if not (is_finite(q) and is_finite(qd)):
                    break
            for k in range(len(q)):
                put_at(ends[parts - 1], at(q, k), i, k)


@inlined
def sample_law_at(inputs, h, number, state, stages):
    """Evaluate a sampled law before the step from t = number · h, if that is a sampling time of the law."""
    sample_at_step(inputs.drive, number * h, (number + 0.5) * h, state[0], state[1], stages.tau)


@subroutine
def step(work, tableau, inputs, h, number, state, stages):
    """Advance q, q̇ (n,) and W (1,) from t = number · h by h."""
    A, b, c = tableau
    q, qd, done = state
    q_stage, tau, K, L = stages.q, stages.tau, stages.K, stages.L
    for i in range(len(c)):
        t = (number + c[i]) * h
        q_dot, q_dot_dot = L[i], K[i]
        for k in range(len(q)):
            put_at(q_stage, at(q, k), k)
            put_at(q_dot, at(qd, k), k)
        for j in range(i):
            add_stage(A[i, j] * h, L, K, j, q_stage, q_dot)
        follow(inputs.motion, t, q_stage, q_dot, q_dot_dot)
        stage_torque(inputs.drive, t, (number + 0.5) * h, q_stage, q_dot, tau)
        power = forward_under(inputs, t, (number + 0.5) * h, q_stage, q_dot, tau, q_dot_dot, work)
        put_at(done, at(done, 0) + b[i] * h * power, 0)
    for i in range(len(c)):
        add_stage(b[i] * h, L, K, i, q, qd)
    follow(inputs.motion, (number + 1) * h, q, qd, K[0])


@shared
@entry
def stage(work, inputs, t, middle, q, qd, tau, qdd):
    """Write q̈ for torques `tau` (n,) in a step with this `middle`; return the power of forces without potential."""
    follow(inputs.motion, t, q, qd, qdd)
    return forward_under(inputs, t, middle, q, qd, tau, qdd, work)


@inlined
def add_stage(weight, L, K, i, q, qd):
    """q += weight L_i and q̇ += weight K_i; skips the many zeros of high-order tableaus."""
    if weight != 0.0:
        for k in range(len(q)):
            put_at(q, at(q, k) + weight * at(L, i, k), k)
            put_at(qd, at(qd, k) + weight * at(K, i, k), k)
