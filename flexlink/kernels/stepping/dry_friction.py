"""Dry friction in the stages of an implicit step, with the nonlinear law at joints that stop or reverse.

At such a joint the slope of f = c tanh(V / w) does not predict f in the next iteration, because the friction torque
changes sign within the step. `newton` solves L x = R with L = 1 ⊗ M + h A ⊗ D + h² A² ⊗ K. A small matrix G gives the
response of the rates V of these joints, in all stages, to their friction torques, and V is the root of

    V = v⁰ − G f(V)        G = h A L⁻¹ at these joints = Σ_λ hλ T_λ (M + A_λ)⁻¹ T⁻¹_λ        v⁰: rates without f

found by Newton's iteration with J = 1 + G f'(V). If this does not converge, w is first widened to the range of the
rates, where one or two iterations suffice, and then narrowed by a factor of eight at a time. This may fail as well. An
adaptive step is then shortened; a part of a fixed step (`STEPPER.turning` is inf) has the unknowns y instead,

    y = V + g f(V)        g = |G_mm| of the same joint and stage

in which the equation is linear for a single unknown. V(y) and f(V(y)) have slopes of at most 1 and 1 / g, whether the
joint sticks, y ≈ g f, or turns, y ≈ V ± g c. Each pass solves for the stages' accelerations K with R + f and then
subtracts L⁻¹ f(V).
"""

import math

from flexlink.kernels.forward.mass_plus import solve
from flexlink.kernels.stepping.implicit_layout import BUTCHER, STAGE, VECTOR
from flexlink.kernels.stepping.newton import add_changes, inertia_beyond
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.solve import solve_lu

ROW = numbered("free v step f slope")  # of `Turning.rows`: v⁰, V, the Newton step of V, f(V), f'(V)


@subroutine
def note_turning(h, qd, work):
    """Add the joints that friction may stop within the step to `turning.joints`; returns whether it added any.

    In a step, friction reduces the rate of a joint by c h / inertia. At higher rates friction hardly changes: beyond
    three widths its slope is 1 % of the slope at rest.
    """
    turning, before = work.turning, work.turning.count[0]
    for k in turning.dry:
        d = turning.count[0]
        if d < len(turning.joints) and not is_noted(k, turning):
            hinge = work.chain.hinges[k]
            slow = 3.0 * hinge.coulomb_width + h * hinge.coulomb / (hinge.armature + inertia_beyond(k, work))
            for i in range(work.stages.shape[1]):
                rate = work.stages[STAGE.qd, i, k]
                if rate * qd[k] <= 0.0 or min(abs(rate), abs(qd[k])) < slow:
                    turning.joints[d], turning.count[0] = k, d + 1
                    break
    return turning.count[0] > before


@inlined
def is_noted(k, turning):
    """Whether joint k is in `turning.joints`."""
    noted = False
    for a in range(turning.count[0]):
        noted = noted or turning.joints[a] == k
    return noted


@subroutine
def factor_turning(h, work):
    """Write Y, the columns of (M + A_λ)⁻¹ at the joints `turning.joints`, and G; call `factor_all` first."""
    method, turning, s = work.method, work.turning, work.stages.shape[1]
    r, z, d = work.vectors[VECTOR.rhs], work.pairs[0], turning.count[0]
    turning.G[: s * d, : s * d] = 0.0
    work.stepper[STEPPER.answers] += d
    for b in range(d):
        for k in range(len(r)):
            r[k] = z[k] = 0.0
        r[turning.joints[b]] = z[turning.joints[b]] = 1.0
        for m in range(len(method.real)):
            y = turning.real[m, b]
            solve(work.factors[m], r, y, work.posture)
            add_answer(h * method.real[m], method.T_real, method.Tinv_real, m, y, b, s, turning)
        for m in range(len(method.pairs)):
            y = turning.pairs[m, b]
            solve(work.factors_pairs[m], z, y, work.posture)
            add_answer(2.0 * h * method.pairs[m], method.T_pairs, method.Tinv_pairs, m, y, b, s, turning)


@inlined
def add_answer(z, T, Tinv, m, y, b, s, turning):
    """G += Re(z T y T⁻¹), with y the response of all joints to a unit torque at joint b."""
    d = turning.count[0]
    for i in range(s):
        for j in range(s):
            weight = z * T[i, m] * Tinv[m, j]
            for a in range(d):
                turning.G[i * d + a, j * d + b] += (weight * y[turning.joints[a]]).real


@recursion
def leave_out_friction(work):
    """R_i += f(V_i): the residual without the friction of the joints `turning.joints`."""
    for i in range(work.stages.shape[1]):
        for a in range(work.turning.count[0]):
            k = work.turning.joints[a]
            hinge = work.chain.hinges[k]
            part = math.tanh(work.stages[STAGE.qd, i, k] / hinge.coulomb_width)
            work.stages[STAGE.residual, i, k] += hinge.coulomb * part


@subroutine
def put_in_friction(h, qd, work):
    """K −= L⁻¹ f(V), after the update of K without friction; returns whether the iteration for V converged."""
    turning, stages = work.turning, work.stages
    s, d = stages.shape[1], turning.count[0]
    free, v = turning.rows[ROW.free], turning.rows[ROW.v]
    for i in range(s):
        for a in range(d):
            k = turning.joints[a]
            v[i * d + a], free[i * d + a] = stages[STAGE.qd, i, k], qd[k]
            for j in range(s):
                free[i * d + a] += h * work.method.A[BUTCHER.A, i, j] * stages[STAGE.qdd, j, k]
    if not (find_rates(1.0, 0.0, s * d, work) or narrow(s * d, work)):
        return False
    subtract_answers(h, work)
    return True


@recursion
def subtract_answers(h, work):
    """K −= L⁻¹ f with L⁻¹ = T Y T⁻¹, and f of the last iteration for V."""
    method, turning, x, z = work.method, work.turning, work.vectors[VECTOR.solution], work.pairs[1]
    for m in range(len(method.real)):
        subtract_answer(method.Tinv_real[m], turning.real[m], x, turning)
        add_changes(h, 1.0, method.T_real[:, m], x, work)
    for m in range(len(method.pairs)):
        subtract_answer(method.Tinv_pairs[m], turning.pairs[m], z, turning)
        add_changes(h, 2.0, method.T_pairs[:, m], z, work)


@inlined
def subtract_answer(Tinv, Y, x, turning):
    """x = −Y T⁻¹ f for one eigenvalue."""
    d = turning.count[0]
    x[:] = 0.0
    for b in range(d):
        f = x.dtype.type(0)
        for j in range(len(Tinv)):
            f += Tinv[j] * turning.rows[ROW.f, j * d + b]
        for k in range(len(x)):
            x[k] -= f * Y[b, k]


@recursion
def narrow(size, work):
    """Find V for a large friction width, then for smaller and smaller ones, or from y; returns whether it converged."""
    turning, wider = work.turning, 1.0
    for m in range(size):
        hinge = work.chain.hinges[turning.joints[m % turning.count[0]]]
        turning.rows[ROW.v, m] = turning.rows[ROW.free, m]
        wider = max(wider, abs(turning.rows[ROW.free, m]) / hinge.coulomb_width)
    if work.stepper[STEPPER.turning] == math.inf:
        return find_rates(1.0, 1.0, size, work)
    found = True
    while found and wider > 1.0:
        found = find_rates(wider, 0.0, size, work)
        wider *= 0.125
    return found and find_rates(1.0, 0.0, size, work)


@subroutine
def find_rates(wider, part, size, work):
    """Newton's iteration for V + `part` g f(V), with widths multiplied by `wider`; returns whether it converged."""
    turning, J, rows = work.turning, work.turning.J, work.turning.rows
    most, enough = 12, 1e-7  # limits: iterations; change of a joint's friction torque relative to c
    torques(wider, size, work)
    for _ in range(most):
        for m in range(size):
            rows[ROW.step, m] = rows[ROW.free, m] - rows[ROW.v, m]
            for j in range(size):
                rows[ROW.step, m] -= turning.G[m, j] * rows[ROW.f, j]
                J[m, j] = turning.G[m, j] * rows[ROW.slope, j]
            J[m, m] += 1.0
        work.stepper[STEPPER.multiplications] += size * size * (2.0 + size / 3.0)
        solve_lu(J[:size, :size], rows[ROW.step, :size], turning.probe[:, :size])
        for m in range(size):
            g = part * abs(turning.G[m, m])
            y = rows[ROW.v, m] + g * rows[ROW.f, m] + (1.0 + g * rows[ROW.slope, m]) * rows[ROW.step, m]
            rows[ROW.v, m] = rate_of(y, g, work.chain.hinges[turning.joints[m % turning.count[0]]])
        change = torques(wider, size, work)
        if not change > enough:
            return not math.isnan(change)
    return False


@recursion
def rate_of(y, g, hinge):
    """V with y = V + g f(V), by Newton's iteration for x = |V| / w, which from 0 can only increase up to the root."""
    if g == 0.0:
        return y
    a, x, δ = g * hinge.coulomb / hinge.coulomb_width, 0.0, math.inf
    while δ > 1e-15 * x:
        part = math.tanh(x)
        δ = (abs(y) / hinge.coulomb_width - x - a * part) / (1.0 + a * (1.0 - part * part))
        x += δ
    return math.copysign(x * hinge.coulomb_width, y)


@recursion
def torques(wider, size, work):
    """Write f(V) and f'(V); returns the largest change of f relative to the c of its joint."""
    turning, rows, largest = work.turning, work.turning.rows, 0.0
    for m in range(size):
        hinge = work.chain.hinges[turning.joints[m % turning.count[0]]]
        width = wider * hinge.coulomb_width
        part = math.tanh(rows[ROW.v, m] / width)
        change = part - rows[ROW.f, m] / hinge.coulomb
        largest = max(largest, abs(change)) + (change - change)
        rows[ROW.f, m], rows[ROW.slope, m] = hinge.coulomb * part, hinge.coulomb * (1.0 - part * part) / width
    return largest
