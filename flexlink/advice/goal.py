"""Goal of the advice: the required accuracy, the norm that measures tip errors, and thresholds for the choice."""

import re
from typing import NamedTuple

import numpy as np

from flexlink.chain.arguments import positive, real
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.run_settings import RunSettings
from flexlink.dynamics import rounding
from flexlink.results.tip_motion import largest_so_far


class Goal(NamedTuple):
    """Allowed error of the tip at any sample."""

    size: float  # a fraction of the tip's travel, or of its largest deflection, or a length [m]
    metres: bool = False  # whether it is a length
    deflection: bool = False  # whether it is a fraction of the deflection
    band: float = np.inf  # vibrations above this frequency are ignored [Hz]

    def tolerance(self, travel: float, deflection: float) -> float:
        """Allowed error [m] for this travel and this deflection of the tip [m]."""
        return self.size if self.metres else self.size * (deflection if self.deflection else travel)

    def __str__(self) -> str:
        return f"{self.size * 1e3:.3g} mm" if self.metres else f"{self.size:.0e}"


def goal_of(tip: float | str, *, deflection: bool, band: float | None, run: RunSettings) -> Goal:
    """Convert the arguments of `advise` to a goal."""
    wanted = "a fraction of the tip's travel, such as 1e-3, or a length with its unit, such as '2 mm'"
    units = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "um": 1e-6}
    if isinstance(tip, str) and (match := re.fullmatch(r"\s*([0-9.eE+-]+)\s*(m|mm|µm|um)\s*", tip)):
        size, metres = real("tip", match[1], wanted) * units[match[2]], True
    else:
        size, metres = real("tip", tip, wanted), False
    if not 0 < size < (np.inf if metres else 1.0):
        why = f"tip = {truncated(tip)}: expected a fraction of the travel between 0 and 1, or a length such as '2 mm'"
        raise ArgumentError(why, id="tip-goal")
    if metres and deflection:
        why = f"deflection = True: tip = {truncated(tip)} is a length; expected a fraction of the deflection"
        raise ArgumentError(why, id="tip-goal")
    if band is not None:
        band, highest = positive("band", band), 0.5 / run.spacing
        if band > highest:
            why = f"band = {band!r}: samples {run.spacing:g} s apart resolve at most {highest:g} Hz"
            raise ArgumentError(why, id="band-too-wide")
    return Goal(size, metres, deflection, np.inf if band is None else band)


class TipErrorNorm:
    """Norm of differences between tip paths, shape (samples, 3) [m], below the goal's band."""

    def __init__(self, goal: Goal, sample: float) -> None:
        half = round(1.0 / (goal.band * sample)) if np.isfinite(goal.band) else 0
        # Hann window of length 2/band; its gain is zero above the band, except for side lobes of 3 %
        self.window = np.hanning(2 * half + 1)[1:-1] if half > 1 else None

    def lengths(self, difference: Array) -> Array:
        """Length of the difference, without vibrations above the band, at every sample [m]."""
        if self.window is not None:
            before, samples = len(self.window) // 2, len(difference)
            columns = [np.ones(samples), *difference.T]  # the result is as long as the run even if the window is longer
            weight, *found = (np.convolve(one, self.window)[before : before + samples] for one in columns)
            difference = np.column_stack([column / weight for column in found])
        return np.asarray(np.linalg.norm(difference, axis=1))

    def up_to(self, difference: Array) -> Array:
        """Running maximum of `lengths`, shape (samples,) [m]; inf from the first sample that is not finite."""
        return largest_so_far(self.lengths(difference))

    def __call__(self, difference: Array) -> float:
        """Largest length of the difference [m]; inf if the difference is not finite."""
        return float(self.lengths(difference).max()) if np.isfinite(difference).all() else np.inf


def least_tolerance(size: float) -> float:
    """Smallest tolerance of steps for an arm of this size [m]: a thousand rounding errors of the tip's position."""
    return 1e3 * rounding.of_reach(size)


class Thresholds:
    """Fractions of the allowed error, safety factors, and initial choices."""

    reference_step_share = 0.02  # tolerance of the steps of reference runs, relative to the allowed error
    stable_share = 0.9  # fixed step, relative to the smallest stable step of several configurations
    # tolerances of the steps of rigid arms to try, relative to the allowed error; larger ones would promise less
    loose = (1.0, 0.3)
    perturbation = 10.0  # smallest initial distance of a perturbed run from the original, relative to steps' tolerance
    proportional = 0.1  # largest distance of two runs that is proportional to the initial one, relative to the travel
    modest_growth = 10.0  # largest growth of errors for which the safety factor of the estimate is sufficient
    sensitive_growth = 30.0  # growth of initial errors above which the motion itself causes a large error
    hinges = 2  # per link, at Gauss points: deflections are exact for loads that vary linearly along the link
    first_guess = 0.1  # assumed travel of the tip before the first run, relative to the size of the arm
    rerun_factor = 1.5  # ratio of assumed to actual travel, and so of step tolerances, above which a run is repeated
    # hinges of each link for screening, which compares runs, not loads: about one axis, loads bent a link by only 3e-4
    # of the motion, but omitting this axis changed the motion by 6e-3
    screening_hinges = 2
    allowed_share = 0.1  # allowed change of the tip's path by all omitted axes together, relative to the tolerance
    strict = 0.1  # tolerance of the steps that measure the step errors of levels, relative to that of the levels
    scatter = 5.0  # upper bound of the ratio of step errors at the finest and at a coarser level, in sensitive motion
    # largest accepted amount by which the observed order of the limit's errors exceeds the order of the rule, as two
    # limits can agree by chance
    limit_fall = 4.0
