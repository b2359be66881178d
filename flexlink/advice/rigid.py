"""Is rigid enough? Told without any run of a flexible arm: by the loads that the rigid run puts on the springs.

    θ = −(M q̈ + T_GC) / k        of the hinges that the links would have, from the rigid run's q, q̇, q̈
    u = p(q, θ) − p(q, 0)        how far they bend the tip away, if they followed at once
    ÿ + ω² (y − u) = 0           how far it swings, ω the lowest frequency of the springs, from where it starts
    d                            how far the joints go by a bend that they start with (`release`)

None is a bound by itself: joints give way, loads meet other modes. Measured on 22 scenes of arms that are driven,
led, fall, hit resonance: the error of a rigid model is at most 0.8 of `SAFE` times the largest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.goal import OF_STEPS, Goal, Ruler, least_tolerance
from flexlink.advice.model import Axes, Model, is_scene, uniform
from flexlink.advice.model_runner import GROWN, NUDGE, ModelRunner, Outcome, Stepping
from flexlink.advice.release import release
from flexlink.chain.chain import Chain
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.terms import inverse_dynamics
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.results.tip_motion import largest_distance, tip_travel

Array = NDArray[np.float64]

SAFE = 2.5
"""Over the largest of u, y and d."""

TAME = 10.0
"""Growth of an error up to which it is contained in `SAFE`."""

METHOD = "Radau5"
"""Of the run that others are measured by."""

LOOSE = (100.0, 10.0)
"""Tolerances of steps over what is allowed: of smooth motion long steps have much smaller errors than they tell."""

FALL = 0.25
"""Power of the tolerance by which an implicit method of order 5 with an estimate of order 4 takes fewer steps."""

FIRST_GUESS, AGAIN = 0.1, 1.5
"""Motion over reach before anything has moved, and times too large that this may be before a run is run again."""

COARSE = 2
"""Hinges of each link, at Gauss points: exact for the deflection under loads that are linear along it."""

LARGEST_ANGLE = 1.0
"""Of a hinge [rad], beyond which a linear spring's angle says no more than that it is large."""


class Guess(NamedTuple):
    """What a rigid model may be off by [m], and the lowest frequency of the springs [Hz]."""

    error: float
    hertz: float


def rigid_model(bench: ModelRunner) -> Model:
    """All links rigid."""
    return (None,) * len(bench.scene.arm.links)


def rigid_run(bench: ModelRunner, goal: Goal, reach: float) -> Outcome | None:
    """The run of the rigid arm with steps whose errors are small beside what is allowed.

    None where nothing moves, or where the rigid arm is not a model.
    """
    model, motion = rigid_model(bench), FIRST_GUESS * reach
    if not is_scene(bench.scene, model):
        return None
    while True:
        outcome = bench.run(model, Stepping(METHOD, tolerance=_of_steps(goal.tolerance(motion, motion), reach)))
        if not outcome.whole:
            return None
        assumed, motion = motion, tip_travel(outcome.tip)
        if assumed <= AGAIN * motion or outcome.stepping.tolerance == _of_steps(goal.tolerance(motion, motion), reach):
            return outcome


def _of_steps(allowed: float, reach: float) -> float:
    return max(OF_STEPS * allowed, least_tolerance(reach))


def loosest(bench: ModelRunner, strict: Outcome, allowed: float, error: Callable[[Array], float]) -> Outcome:
    """The run of the rigid arm that is expected to be the cheapest of those whose tip has no larger `error` [m]."""
    for stepping in _steppings(bench, strict, allowed):
        outcome = bench.run(rigid_model(bench), stepping)
        if outcome.whole and error(outcome.tip) <= allowed and outcome.seconds < strict.seconds:
            return outcome
    return strict


def _steppings(bench: ModelRunner, strict: Outcome, allowed: float) -> list[Stepping]:
    """Steps that may be cheaper than those of a strict run, at their expected cost."""
    assert strict.stepping.tolerance is not None
    costs = {
        Stepping(METHOD, tolerance=factor * allowed): strict.seconds
        * (factor * allowed / strict.stepping.tolerance) ** -FALL
        for factor in LOOSE
    }
    fixed = bench.fixed(bench.scene.run.sample)
    if fixed is not None:
        costs[fixed] = bench.fixed_cost(rigid_model(bench), fixed)
    return sorted((stepping for stepping, cost in costs.items() if cost < strict.seconds), key=lambda s: costs[s])


def guess(bench: ModelRunner, strict: Outcome, axes: Axes, ruler: Ruler) -> Guess:
    """What bending that is left out would do to the tip, swung up; without the growth of errors."""
    run, model = strict.run, uniform(axes, COARSE)
    assert run is not None
    chain = bench.chain(model)
    q, qd, qdd = (_spread(run.chain, chain, values) for values in (run.q, run.qd, run.qdd))
    loads = inverse_dynamics(chain, q, qd, qdd, tip_wrench=run.tip_wrench)
    bent = np.array([c.segment > 0 for c in chain.coordinates])
    θ = np.zeros_like(q)
    θ[:, bent] = np.clip(-loads[:, bent] / chain.stiffness[bent], -LARGEST_ANGLE, LARGEST_ANGLE)
    u = tip_position(chain, q + θ) - run.tip
    ω = slowest_frequency(chain, q[0])
    released = release(bench, strict, model, q[0])
    y = swung(u, ω, bench.scene.run.sample, released.start)
    return Guess(SAFE * max(ruler(u), ruler(y), ruler(released.drift)), ω / (2 * np.pi))


def _spread(rigid: Chain, chain: Chain, values: Array) -> Array:
    """Numbers of the joints of the rigid chain, put on those of another; zero on its hinges."""
    out = np.zeros((len(values), chain.n))
    for k, coordinate in enumerate(rigid.coordinates):
        out[:, chain.index(*coordinate)] = values[:, k]
    return out


def swung(u: Array, ω: float, Δ: float, start: Array) -> Array:
    """y of ÿ + ω² (y − u) = 0 from y(0) = `start` at rest, u linear between samples Δ apart, exactly.

    With slope s of u, e = y − u and v = (ẏ − s)/ω make z = e + i v turn at the rate −ω, and v jump where s does.
    """
    slopes = np.diff(u, axis=0) / Δ
    turn = np.exp(1j * ω * Δ * np.arange(len(u)))[:, None]
    jumps = np.vstack([(start - u[0]) - 1j * slopes[:1] / ω, -1j * np.diff(slopes, axis=0) / ω, 0 * u[:1]])
    return np.asarray(u + (np.cumsum(turn * jumps, axis=0) / turn).real)


def growth(bench: ModelRunner, outcome: Outcome, error: float) -> float:
    """How many times an error [m] of where the arm starts grows at the tip, at most, in the rigid run of an outcome.

    Told by a twin that starts so far off; inf where they part by too much for any proportion.
    """
    assert outcome.stepping.tolerance is not None
    reach = bench.chain(rigid_model(bench)).reach
    start = max(error, NUDGE * outcome.stepping.tolerance)
    twin = bench.twin(rigid_model(bench), outcome.stepping, start / reach)
    if twin is None:
        return 1.0
    apart = largest_distance(twin.tip, outcome.tip)
    return apart / start if apart <= GROWN * max(tip_travel(outcome.tip), TAME * start) else np.inf
