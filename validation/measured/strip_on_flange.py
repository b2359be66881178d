"""Ringing of a steel strip on a robot's flange after the robot has stopped, in three orientations.

While the robot's joints rub, the frequency falls by up to 1.3 % and the damping rises from 0.5 to 2 %. Towards the end
of most recordings the joints stick: a decaying sine then fits all torques to within their noise. Windows of the decays
with sticking joints (`strip_decays`) give the frequency at amplitude zero. It falls there along a line with the
amplitude; the slope is taken within the runs of one move, in which the robot's posture is the same, so posture and
amplitude are not confounded. Means of all runs over 3 to 9 s, rubbing joints included, are given beside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.vibration.modal import modes
from flexlink.motion.inputs.initial_state import initial_state
from validation.measured.readings import Derived, Reading
from validation.measured.uncertainty import COVERAGE, of_mean
from validation.reference_values import look_up

DATA = "measured/steel_strip_on_flange"
MEAN, SMALL = "mean of the runs", "at amplitude zero"
STICKING = 2.0  # largest residual / noise of a window in which the joints stick; rubbing joints reach 2.4 to 5.1
DRAWS = 20_000


class Window(NamedTuple):
    """A window of a decay: run, number from the end, frequency and its standard error [Hz], amplitude [N m]."""

    run: str
    number: int
    frequency: float
    error: float
    amplitude: float


class AtZero(NamedTuple):
    """Mean frequencies [Hz] and amplitudes [N m] of an orientation's moves; slopes of all moves [Hz/(N m)]."""

    frequencies: Array
    amplitudes: Array
    slopes: Array

    def moves(self, slope: float | None = None) -> Array:
        """Frequency at amplitude zero of each move, for the mean slope or another one."""
        found: Array = self.frequencies - (self.slopes.mean() if slope is None else slope) * self.amplitudes
        return found

    @property
    def reading(self) -> tuple[float, float]:
        """Mean over the moves, and its standard uncertainty: scatter of the moves and of the slopes, with t-factors."""
        u = np.hypot(of_mean(self.moves()), of_mean(self.slopes) * self.amplitudes.mean())
        return float(self.moves().mean()), float(u)

    def u_by_draws(self, rng: np.random.Generator) -> float:
        """The same uncertainty from random slopes and means: half of the interval with 95 % of them, over 2."""
        n, m = len(self.slopes), len(self.frequencies)
        slopes = self.slopes.mean() + self.slopes.std(ddof=1) / np.sqrt(n) * rng.standard_t(n - 1, DRAWS)
        moves = self.frequencies - slopes[:, None] * self.amplitudes
        means = moves.mean(axis=1) + moves.std(axis=1, ddof=1) / np.sqrt(m) * rng.standard_t(m - 1, DRAWS)
        low, high = np.percentile(means, [2.5, 97.5])
        return float(high - low) / 2 / COVERAGE


def readings() -> dict[str, Reading]:
    """Ringing frequencies by orientation [Hz].

    The uncertainty u of a mean is the scatter of the runs, since their amplitudes differ and the model ignores
    amplitude. At amplitude zero, moves and slopes are the independent repetitions: 3 moves, 2 degrees of freedom.
    """
    found = {}
    for attitude, moves in _moves().items():
        frequencies = [run[3] for move in moves.values() for run in move]
        spread = float(np.std(frequencies, ddof=1))
        found[f"{attitude}, {MEAN}"] = Reading(float(np.mean(frequencies)), spread, "Hz", "frequency")
        found[f"{attitude}, {SMALL}"] = Reading(*at_zero(attitude).reading, "Hz", "frequency, small amplitude")
    return found


def u_again(predicted: Mapping[str, float]) -> dict[str, float]:
    """u_D a second way: random draws of slopes and moves; for the runs, Gini's mean difference, not the deviation."""
    del predicted  # the scatter is that of the readings alone
    found, rng = {}, np.random.default_rng(1)
    for attitude, moves in _moves().items():
        runs = np.array([run[3] for move in moves.values() for run in move])
        apart = np.abs(runs[:, None] - runs).sum() / (len(runs) * (len(runs) - 1))
        found[f"{attitude}, {MEAN}"] = float(np.sqrt(np.pi) / 2 * apart)
        found[f"{attitude}, {SMALL}"] = at_zero(attitude).u_by_draws(rng)
    return found


def derived() -> Iterator[Derived]:
    """Effect of gravity, which stiffens a hanging strip and softens an upright one, and of the sag of a level strip.

    Both readings at amplitude zero share the slope's error, which partly cancels; they count as independent, so u_D is
    an upper estimate.
    """
    for which, group in ((MEAN, "gravity's split"), (SMALL, "gravity's split, small amplitude")):
        yield Derived(f"down − up, {which}", group, "difference", f"down, {which}", f"up, {which}")
    level = f"level / down, {SMALL}"
    yield Derived(level, "ratio of orientations", "ratio", f"level, {SMALL}", f"down, {SMALL}")


def predicted(scene: Scene) -> dict[str, float]:
    """The strip's first frequency about its sag, averaged over the configurations in which the moves ended."""
    found = {}
    for attitude, moves in _moves().items():
        values = [_first_frequency(scene, np.mean([run[2] for run in move], axis=0)) for move in moves.values()]
        found[f"{attitude}, {MEAN}"] = found[f"{attitude}, {SMALL}"] = float(np.mean(values))
    return found


def _moves() -> dict[str, dict[str, list[list[Any]]]]:
    """Orientation of the strip → move → runs of the move."""
    found: dict[str, dict[str, list[list[Any]]]] = {}
    for run in look_up(DATA, "runs"):
        found.setdefault(run[1], {}).setdefault(run[0].rpartition("_")[0], []).append(run)
    return found


def at_zero(attitude: str) -> AtZero:
    """Windows with sticking joints: means of the last ones of an orientation's moves, and the slopes of all moves."""
    moves = sticking_windows()
    last = [[each for each in moves[move] if each.number == 0] for move in _moves()[attitude]]
    means = np.array([[np.mean([w.frequency for w in of]), np.mean([w.amplitude for w in of])] for of in last])
    slopes = [slope_within(windows) for windows in moves.values() if len(windows) > 1 + len({w.run for w in windows})]
    return AtZero(means[:, 0], means[:, 1], np.array(slopes))


def sticking_windows() -> dict[str, list[Window]]:
    """Move → windows of its runs in which the joints stick."""
    found: dict[str, list[Window]] = {}
    for run, number, frequency, error, amplitude, _, residual in look_up(DATA, "decays", "rows"):
        if residual <= STICKING:
            window = Window(run, number, frequency, error, amplitude)
            found.setdefault(run.rpartition("_")[0], []).append(window)
    return found


def slope_within(windows: Sequence[Window]) -> float:
    """Slope of frequency against amplitude [Hz/(N m)], with an own intercept for every run, weighted by the errors."""
    runs = sorted({each.run for each in windows})
    own = [[float(each.run == run) for run in runs] for each in windows]
    design = np.column_stack([own, [each.amplitude for each in windows]])
    weights = np.array([1.0 / each.error for each in windows])
    line = np.linalg.lstsq(design * weights[:, None], weights * [each.frequency for each in windows], rcond=None)[0]
    return float(line[-1])


def _first_frequency(scene: Scene, stop_deg: Sequence[float]) -> float:
    turned = scene.varied({"initial.joint_deg": [*map(float, stop_deg), 0.0]})
    chain = lump(turned)
    sag = solve_static(chain, initial_state(turned, chain)[0])
    return float(modes(chain, sag.q).hertz[0])
