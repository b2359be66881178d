"""Ringing of a steel strip on a robot's flange after the robot has stopped, in three orientations.

The measured frequency falls with increasing amplitude, by 1 % from the smallest to the largest. The computed modes are
those of small motion, so they are compared with the frequency at amplitude zero, which a straight line through the
means of the moves gives. The mean of the runs is also given. The chain's frequency rises with the amplitude, but a
hundred times less.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.vibration.modal import modes
from flexlink.motion.inputs.initial_state import initial_state
from validation.measured.readings import Derived, Reading
from validation.reference_values import look_up

DATA = "measured/steel_strip_on_flange"
MEAN, SMALL = "mean of the runs", "at amplitude zero"


def readings() -> dict[str, Reading]:
    """Ringing frequencies by orientation [Hz].

    The uncertainty u of a mean is the scatter of the runs, since their amplitudes differ and the model ignores
    amplitude. For the straight line, u is the standard error of its value at amplitude zero.
    """
    found = {}
    for attitude, moves in _moves().items():
        runs = [run for move in moves.values() for run in move]
        frequencies = [run[3] for run in runs]
        spread = float(np.std(frequencies, ddof=1))
        found[f"{attitude}, {MEAN}"] = Reading(float(np.mean(frequencies)), spread, "Hz", "frequency")
        means = np.array(
            [[np.mean([run[5] for run in move]), np.mean([run[3] for run in move])] for move in moves.values()]
        )
        found[f"{attitude}, {SMALL}"] = Reading(*_at_zero(*means.T), "Hz", "frequency, small amplitude")
    return found


def derived() -> Iterator[Derived]:
    """Effect of gravity, which stiffens a hanging strip and softens an upright one."""
    for which, group in ((MEAN, "gravity's split"), (SMALL, "gravity's split, small amplitude")):
        yield Derived(f"down − up, {which}", group, "difference", f"down, {which}", f"up, {which}")


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


def _at_zero(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    """Value of the least-squares line at x = 0, and its standard error."""
    design = np.column_stack([np.ones(len(x)), x])
    line, residual, *_ = np.linalg.lstsq(design, np.asarray(y), rcond=None)
    variance = residual[0] / (len(x) - 2)
    return float(line[0]), float(np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0]))


def _first_frequency(scene: Scene, stop_deg: Sequence[float]) -> float:
    turned = scene.varied({"initial.joint_deg": [*map(float, stop_deg), 0.0]})
    chain = lump(turned)
    sag = solve_static(chain, initial_state(turned, chain)[0])
    return float(modes(chain, sag.q).hertz[0])
