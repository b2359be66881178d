"""Is rigid enough? Told without any run of a flexible arm: by the loads that the rigid run puts on the springs.

    θ = −(M q̈ + T_GC) / k        of the hinges that the links would have, from the rigid run's q, q̇, q̈
    u = p(q, θ) − p(q, 0)        how far they bend the tip away, if they followed at once
    ÿ + ω² (y − u) = 0           how far it swings, ω the lowest frequency of the springs

Neither is a bound by itself: joints give way, loads meet other modes. Measured on 22 scenes of arms that are driven,
led, fall, hit resonance: the error of a rigid model is at most 0.8 of `SAFE` times the larger.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.bench import Bench, Outcome
from flexlink.advice.goal import Ruler
from flexlink.advice.model import Axes, Model, is_scene, uniform
from flexlink.analysis.extremes import slowest_frequency
from flexlink.chain.chain import Chain
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.terms import inverse_dynamics
from flexlink.motion.result import Trajectory

Array = NDArray[np.float64]

SAFE = 2.5
"""Over the larger of u and y."""

TAME = 10.0
"""Growth of an error up to which it is contained in `SAFE`."""

NUDGE = 1e-7
"""Angle [rad] that a twin starts with more: large beside rounding, small beside all else."""

COARSE = 2
"""Hinges of each link, at Gauss points: exact for the deflection under loads that are linear along it."""

HALVINGS = 5
LARGEST_ANGLE = 1.0
"""Of a hinge [rad], beyond which a linear spring's angle says no more than that it is large."""


class Guess(NamedTuple):
    """What a rigid model may be off by [m], and the lowest frequency of the springs [Hz]."""

    error: float
    hertz: float


def rigid_model(bench: Bench) -> Model:
    """All links rigid."""
    return (None,) * len(bench.scene.arm.links)


def rigid_runs(bench: Bench, ruler: Ruler, share: float) -> list[Outcome]:
    """Runs of the rigid arm by RK4, each with half the step, until this changes less than a part of the motion.

    None where nothing moves, where the rigid arm is not a model, or where fixed steps do not fit the scene.
    """
    model = rigid_model(bench)
    if not is_scene(bench.scene, model):
        return []
    runs: list[Outcome] = []
    largest = bench.scene.run.sample
    for _ in range(HALVINGS + 1):
        stepping = bench.fixed(largest)
        if stepping is None or stepping.step is None:
            break
        outcome = bench.run(model, stepping)
        if runs and outcome.whole and runs[-1].whole:
            change = ruler(outcome.tip - runs[-1].tip)
            runs.append(outcome)
            if change <= share * max(np.linalg.norm(np.ptp(outcome.tip, axis=0)), np.finfo(float).tiny):
                break
        else:
            runs.append(outcome)
        largest = stepping.step / 2
    return [outcome for outcome in runs if outcome.whole]


def own_error(runs: list[Outcome], k: int, ruler: Ruler) -> float:
    """Error of the steps of one of these runs [m], against all that have smaller ones."""
    if len(runs) < 2:
        return np.inf
    last = ruler(runs[-1].tip - runs[-2].tip)  # of the last but one; the last one's is less
    return last if k == len(runs) - 1 else ruler(runs[k].tip - runs[-1].tip) + last / 15


def guess(bench: Bench, run: Trajectory, axes: Axes, ruler: Ruler) -> Guess:
    """What bending that is left out would do to the tip, swung up; without the growth of errors."""
    chain = bench.chain(uniform(axes, COARSE))
    q, qd, qdd = (_spread(run.chain, chain, values) for values in (run.q, run.qd, run.qdd))
    loads = inverse_dynamics(chain, q, qd, qdd, tip_wrench=run.tip_wrench)
    bent = np.array([c.segment > 0 for c in chain.coordinates])
    θ = np.zeros_like(q)
    θ[:, bent] = np.clip(-loads[:, bent] / chain.stiffness[bent], -LARGEST_ANGLE, LARGEST_ANGLE)
    u = tip_position(chain, q + θ) - tip_position(chain, q)
    ω = slowest_frequency(chain, q[0])
    y = swung(u, ω, bench.scene.run.sample, start=u[0] if bench.scene.initial.passive == "static" else 0 * u[0])
    return Guess(SAFE * max(ruler(u), ruler(y)), ω / (2 * np.pi))


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


def growth(bench: Bench, outcome: Outcome) -> float:
    """How many times an error of the initial angles has grown at the tip, at most, in the rigid run of an outcome."""
    twin = bench.twin(rigid_model(bench), outcome.stepping, NUDGE)
    if twin is None:
        return 1.0
    reach = bench.chain(rigid_model(bench)).reach
    apart = np.linalg.norm(twin.tip - outcome.tip, axis=1).max()
    return float(apart / (NUDGE * reach)) if twin.whole else np.inf
