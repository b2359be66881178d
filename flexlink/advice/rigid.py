"""Estimate the error of rigid links without a flexible run, from the spring loads that the rigid run implies.

    θ = −K⁻¹ (M q̈ + T_GC)        angles from rest that the links' hinges would have, from q, q̇, q̈ of the rigid run
    u = p(q, θ₀ + θ) − p(q, θ₀)  quasi-static deflection of the tip
    ÿ + ω² (y − u) = 0           vibration y of the tip, ω the lowest natural frequency
    d                            drift of the tip when springs that are initially bent are released (`release`)

None of these is a bound, because joints yield and loads excite other modes. The estimate is 2.5 times the largest of u,
y and d. On 22 scenes of arms that are driven, falling or in resonance, the error of the rigid model was at
most 0.8 times the estimate.

Release of links that start in static equilibrium with locked joints (`initial.passive` = "static").

    w                             initial angles of the springs, in equilibrium with locked joints
    δ = M_aa⁺ M_ap w              rotation of the free joints a as the springs p straighten, at zero momentum
    d(t) = p_δ(t) − p(t)          tip of a rigid arm that starts with an offset δ, minus tip without this offset

The remaining deflection vibrates under the loads of the run like any other deflection (`rigid.estimate`).
"""

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from flexlink.advice.goal import Goal, Thresholds, TipErrorNorm, least_tolerance
from flexlink.advice.model import Axes, Model, can_move, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.chain.coordinates import Kind
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.dynamics.forces import deflections, force_torque
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.terms import inverse_dynamics, mass_matrix
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.results.tip_motion import largest_distance, tip_travel


def rigid_model(runner: ModelRunner) -> Model:
    """The model with all links rigid."""
    return (None,) * len(runner.scene.arm.links)


def rigid_run(runner: ModelRunner, goal: Goal, size: float) -> Outcome | None:
    """Run the rigid arm with steps whose errors are far below the allowed error; None if it cannot move, or fails."""
    model, motion = rigid_model(runner), Thresholds.first_guess * size
    if not can_move(runner.scene, model):
        return None

    def tolerance(motion: float) -> float:
        return max(Thresholds.reference_step_share * goal.tolerance(motion, motion), least_tolerance(size))

    while True:
        outcome = runner.run(model, Stepping("Radau5", tolerance=tolerance(motion)))
        if not outcome.completed:
            return None
        assumed, motion = motion, tip_travel(outcome.tip)
        if assumed <= Thresholds.rerun_factor * motion or outcome.stepping.tolerance == tolerance(motion):
            return outcome


def cheapest_run(runner: ModelRunner, strict: Outcome, allowed: float, error: Callable[[Array], float]) -> Outcome:
    """Run the rigid arm with cheaper steps; return the cheapest run found whose tip's `error` [m] is allowed.

    Implicit and fixed steps are tried in the order of their expected costs, then adaptive explicit steps if stability
    allows long enough ones.
    """
    model, found = rigid_model(runner), strict

    def is_better(outcome: Outcome) -> bool:
        return outcome.completed and error(outcome.tip) <= allowed and outcome.seconds < found.seconds

    for stepping in _steppings(runner, strict, allowed):
        if is_better(outcome := runner.run(model, stepping, compared=True)):
            found = outcome
            break
    for factor in Thresholds.loose if runner.least_explicit_cost(model) < found.seconds else ():
        if is_better(outcome := runner.run(model, Stepping("DOP853", tolerance=factor * allowed), compared=True)):
            return outcome
    return found


def _steppings(runner: ModelRunner, strict: Outcome, allowed: float) -> list[Stepping]:
    """Steps expected to be cheaper than the steps of a strict run, cheapest first."""
    assert strict.stepping.tolerance is not None
    costs = {}
    for tolerance in (factor * allowed for factor in Thresholds.loose):  # steps follow an error estimate of order 4
        cost = strict.seconds * (tolerance / strict.stepping.tolerance) ** -0.25
        costs[Stepping("Radau5", tolerance=tolerance)] = cost
    if (fixed := runner.fixed_steps(runner.scene.run.spacing)) is not None:
        costs[fixed] = runner.fixed_steps_cost(rigid_model(runner), fixed)
    return sorted((stepping for stepping, cost in costs.items() if cost < strict.seconds), key=lambda s: costs[s])


def estimate(runner: ModelRunner, strict: Outcome, axes: Axes, norm: TipErrorNorm) -> tuple[float, float]:
    """Estimated tip error of rigid links [m], before errors grow along the run, and the lowest frequency [Hz]."""
    run, model = strict.run, uniform(axes, Thresholds.hinges)
    assert run is not None
    chain = runner.chain(model)
    there = [chain.index(*coordinate) for coordinate in run.chain.coordinates]
    q, (qd, qdd) = np.tile(chain.rest, (len(run.q), 1)), np.zeros((2, len(run.q), chain.n))
    q[:, there], qd[:, there], qdd[:, there] = run.q, run.qd, run.accelerations()  # 0 at the hinges
    loads = inverse_dynamics(chain, q, qd, qdd, tip_wrench=run.tip_wrench) + force_torque(chain, q, qd)
    bent = chain.where(Kind.HINGE)
    θ = np.zeros_like(q)
    θ[:, bent] = np.clip(deflections(chain, -loads)[:, bent], -1.0, 1.0)  # [rad]; larger values do not matter
    u = tip_position(chain, q + θ) - tip_position(chain, q)
    ω = slowest_frequency(chain, q[0])
    start, drift = release(runner, strict, model, q[0])
    y = oscillator_response(u, ω, runner.scene.run.spacing, start)
    return 2.5 * max(norm(u), norm(y), norm(drift)), ω / (2 * np.pi)


def oscillator_response(u: Array, ω: float, Δ: float, start: Array) -> Array:
    """Exact solution y of ÿ + ω² (y − u) = 0, from rest at y(0) = `start`, with u linear between samples Δ apart.

    With the slope s of u, e = y − u and v = (ẏ − s)/ω, z = e + i v rotates at the rate −ω, and v jumps where s does.
    """
    slopes = np.diff(u, axis=0) / Δ
    turn = np.exp(1j * ω * Δ * np.arange(len(u)))[:, None]
    jumps = np.vstack([(start - u[0]) - 1j * slopes[:1] / ω, -1j * np.diff(slopes, axis=0) / ω, 0 * u[:1]])
    return np.asarray(u + (np.cumsum(turn * jumps, axis=0) / turn).real)


def growth(runner: ModelRunner, outcome: Outcome, error: float) -> float:
    """Largest growth of an initial tip error [m] in a rigid run, by a perturbed run; inf if it is not proportional."""
    assert outcome.stepping.tolerance is not None
    size = runner.chain(rigid_model(runner)).size
    start = max(error, Thresholds.perturbation * outcome.stepping.tolerance)
    perturbed = runner.perturbed_run(rigid_model(runner), outcome.stepping, start / size)
    if perturbed is None:
        return 1.0
    apart = largest_distance(perturbed.tip, outcome.tip)
    proportional = Thresholds.proportional * max(tip_travel(outcome.tip), Thresholds.modest_growth * start)
    return apart / start if apart <= proportional else np.inf


def release(runner: ModelRunner, strict: Outcome, model: Model, q: Array) -> tuple[Array, Array]:
    """Effect of initially deflected links on the tip: its initial deflection (3,) and its drift (samples, 3) [m].

    The initial deflection is for locked joints. The drift d is relative to a rigid run that starts at `q`, coordinates
    of the model; it is nan after an early end of the run from which it is computed.
    """
    assert strict.run is not None
    if runner.scene.initial.passive != "static":
        return np.zeros(3), np.zeros_like(strict.tip)
    chain, rigid = runner.chain(model), strict.run.chain
    try:
        bent, _ = initial_state(runner.scene_of(model, strict.stepping), chain)
    except FlexlinkError:  # no equilibrium: the deflection is unknown
        return np.full(3, np.nan), np.full_like(strict.tip, np.nan)
    start = tip_position(chain, bent) - tip_position(chain, q)
    there = np.array([chain.index(*coordinate) for coordinate in rigid.coordinates], np.intp)
    free, δ = ~rigid.held, np.zeros(rigid.n)
    rows = mass_matrix(chain, q)[there[free]]
    δ[free] = np.linalg.pinv(rows[:, there[free]]) @ (rows @ (bent - q))
    if not δ.any():
        return start, np.zeros_like(strict.tip)
    initial = replace(runner.scene.initial, passive="zero", q=tuple((strict.run.q[0] + δ).tolist()))
    return start, runner.run_from(initial, (None,) * len(model), strict.stepping).tip - strict.tip
