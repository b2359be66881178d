"""Predicted and observed largest stable step of every explicit method on every scene.

Each arm is in equilibrium under gravity and wrench, with constant torques at its joints. Two runs of N (a few) steps h
start slightly displaced along all modes, in opposite directions. They show the factor μ by which a step multiplies each
mode: with w its left eigenvector (by `linearize`, which `stable_step` does not use) and δ half the runs' difference,

    |μ|^N = |w·δ(N h)| / |w·δ(0)|

and h is stable if no |μ| exceeds 1 + 1e-6, as in `stable_step`. Bisection finds the largest such h. Modes that are
physically unstable, as in an inverted arm, and modes that hardly move in a step do not count. `stable_step` treats an
unstable mode as if it oscillated at its growth rate; if such a mode limits the step, nothing can be observed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import linalg

from flexlink.chain.lumping import lump
from flexlink.common.errors import ConvergenceError
from flexlink.common.types import Array, Complex
from flexlink.describe.scene import Scene
from flexlink.dynamics.terms import bias_torque, elastic_torque
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.stability import stable_step, stable_step_of
from flexlink.dynamics.vibration.stability_function import GROWTH
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import DivergenceError
from validation.case import Case, Measured
from validation.kinds import kind
from validation.physics.formulas import torques_of_links
from validation.store import Series, table

STEPS_OF_A_RUN = 3
"""Number of steps of a run; few, so that differences stay small even if they grow tenfold per step (inverted arm)."""

ANGLE_ASIDE, RATE_ASIDE_OF_WIDTH = 1e-7, 1e-4
"""Largest initial difference of angles [rad], and of rates as a fraction of the width of the friction law. Terms of
second order cancel, even if a hinge is 10⁸ times as stiff as its neighbour; terms of third order and rounding errors
are far below the growth threshold (with 1e-8 rad rounding errors reach a fifth of it: RK2 was off by 3.5 %)."""

SEARCHED, HALVINGS = (0.8, 1.25), 9
"""Range of the search, relative to the predicted step, and number of bisections, to (1.25 − 0.8) / 2⁹ = 0.1 %."""


class Rest(NamedTuple):
    """A scene at rest at q; λ [1/s] and left eigenvectors of the counted modes; a displacement along these modes."""

    scene: Scene
    q: Array
    λ: Complex
    left: Complex  # (modes, 2 n)
    aside: Array  # displacement of (q, q̇), (2 n,)


@kind(long=True)
def run(case: Case, methods: tuple[str, ...]) -> Iterator[Measured | Series]:
    """Yield observed / predicted step − 1 for every scene that has a largest stable step, and their number."""
    rows = list[tuple[str, int, str, float, float, float]]()
    scenes = case.load_scenes()
    for scene in scenes:
        rest = at_rest(scene)
        chain = lump(rest.scene)
        for name in methods:
            predicted = stable_step(chain, rest.q, tip_wrench=rest.scene.tip_wrench, method=name)
            if rest.λ.size and predicted < 0.999 * stable_step_of(rest.λ, name):
                yield Measured("bounded by what grows by itself", predicted, scene.name, varied={"method": name})
            elif predicted <= scene.run.duration:
                ratio = observed(rest, name, predicted)
                yield Measured("observed / predicted − 1", abs(ratio - 1), scene.name, varied={"method": name})
                rows.append((scene.name, chain.n, name, predicted, ratio * predicted, ratio))
    yield Measured("scenes", len(scenes))
    yield Measured("scenes with a largest stable step", len({row[0] for row in rows}))
    heads = ("scene", "n", "method", "predicted [s]", "observed [s]", "observed / predicted")
    columns = table(heads, rows or [("", 0, "", np.nan, np.nan, np.nan)])
    yield Series(
        "stable steps", "Stable step, observed and predicted", columns, heads[3], heads[3], heads[4], "log",
        group="method",
    )  # fmt: skip


def at_rest(scene: Scene) -> Rest:
    """The scene's arm at rest at its initial configuration, joints held by constant torques, and its modes."""
    still: dict[str, object] = {
        "motion": (),
        "initial.rate_deg": None,
        "initial.qd": None,
        "initial.q": None,
        "drive": {"kind": "none"},
    }
    free = scene.arm.base.free  # a free base rests in any position without gravity, but falls with it
    still |= {"initial.base": None, "gravity": (0.0, 0.0, 0.0)} if free else {"initial.passive": "static"}
    scene = scene.varied(still | {"initial.time": None})
    chain = lump(scene)
    try:
        q, zero = initial_state(scene, chain)
    except ConvergenceError:  # the arm is too soft for its weight: it rests without gravity instead
        scene = scene.varied({"gravity": (0.0, 0.0, 0.0)})
        chain = lump(scene)
        q, zero = initial_state(scene, chain)
    hold = np.zeros(chain.n)
    needed = bias_torque(chain, q, zero, tip_wrench=scene.tip_wrench) + elastic_torque(chain, q)
    hold[chain.active] = needed[chain.active]
    scene = scene.varied(
        {"drive": {"kind": "constant", "torque": torques_of_links(scene, chain, hold)}, "initial.passive": None}
    )
    λ, left, right = linalg.eig(linearize(chain, q, tau=hold, tip_wrench=scene.tip_wrench).A, left=True, right=True)
    counted = λ.real <= 1e-2 * np.abs(λ)  # others are physically unstable; rounding of an undamped mode is smaller
    one_of_two = right[:, counted & (λ.imag >= 0)]
    aside = (one_of_two * (1 + 1j) / np.abs(one_of_two).max(axis=0)).real.sum(axis=1)  # each mode in angle and in rate
    width = chain.hinges["coulomb_width"].min(where=chain.hinges["coulomb"] > 0, initial=np.inf)
    angles, rates = (np.abs(part).max() for part in np.split(aside, 2))
    with np.errstate(divide="ignore", invalid="ignore"):  # no displacement is too large without springs or friction
        aside *= min(ANGLE_ASIDE / angles, ANGLE_ASIDE * np.abs(λ).max() / rates, RATE_ASIDE_OF_WIDTH * width / rates)
    return Rest(scene, q, λ[counted], left.T.conj()[counted], aside)


def observed(rest: Rest, name: str, predicted: float) -> float:
    """The largest stable step relative to the predicted one, or the nearer limit of the search if it is beyond."""
    low, high = SEARCHED
    if growth(rest, name, low * predicted) > GROWTH:
        return low
    if growth(rest, name, high * predicted) <= GROWTH:
        return high
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if growth(rest, name, middle * predicted) > GROWTH else (middle, high)
    return (low + high) / 2


def growth(rest: Rest, name: str, h: float) -> float:
    """Largest |μ| − 1 of the modes that move in a step of h [s]."""
    start = np.concatenate([rest.q, np.zeros(len(rest.q))])
    try:
        ends = [_after_some_steps(rest.scene, name, h, start + sign * rest.aside) for sign in (-1, 1)]
    except DivergenceError:
        return np.inf
    slow = 0.02  # |hλ| of a mode that hardly moves in a step; far from any method's limit
    moving = rest.left[np.abs(h * rest.λ) > slow]
    grown = np.abs(moving @ (ends[1] - ends[0]) / 2) / np.abs(moving @ rest.aside)
    return float((grown ** (1 / STEPS_OF_A_RUN)).max(initial=0.0) - 1)


def _after_some_steps(scene: Scene, name: str, h: float, state: Array) -> Array:
    q, qd = np.split(state, 2)
    run = {"method": name, "step": h, "sample": STEPS_OF_A_RUN * h, "duration": STEPS_OF_A_RUN * h, "unstable": "allow"}
    last = simulate(scene.varied({"run": run, "initial.q": q, "initial.qd": qd}))
    return np.concatenate([last.q[-1], last.qd[-1]])
