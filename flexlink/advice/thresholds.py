"""Thresholds for the choice of a model."""

from __future__ import annotations


class Thresholds:
    """Fractions of the allowed error, safety factors, and initial choices."""

    reference_step_share: float = 0.02
    """Tolerance of the steps of reference runs, relative to the allowed error."""
    stable_share: float = 0.9
    """Fixed step, relative to the smallest stable step of several configurations."""
    loose: tuple[float, ...] = (100.0, 30.0, 10.0)
    """Tolerances of the steps of rigid arms to try, relative to the allowed error.

    In smooth motion, errors are far below the tolerance.
    """
    perturbation: float = 10.0
    """Minimum initial distance between a perturbed and the original run, relative to the tolerance of steps."""
    proportional: float = 0.1
    """Largest distance between two runs, relative to the travel, that is proportional to the initial distance."""
    modest_growth: float = 10.0
    """Largest growth of errors for which the safety factor of the estimate is sufficient."""
    sensitive_growth: float = 30.0
    """Growth of initial errors above which the motion itself causes a large error."""
    hinges: int = 2
    """Number of hinges per link, at Gauss points: deflections are exact for loads that vary linearly along the link."""
    first_guess: float = 0.1
    """Assumed travel of the tip before the first run, relative to the size of the arm."""
    rerun_factor: float = 1.5
    """Ratio of assumed to actual travel (and thus of step tolerances) above which a run is repeated."""
    screening_hinges: int = 2
    """Number of hinges of each link for screening.

    Screening compares runs, not loads: about one axis, loads bent a link by only 3e-4 of the motion, but omitting
    this axis changed the motion by 6e-3.
    """
    allowed_share: float = 0.1
    """Allowed change of the tip's path by all omitted axes together, relative to the tolerance."""
    strict: float = 0.1
    """Tolerance of the steps that measure the step errors of levels, relative to the tolerance of the levels."""
    scatter: float = 5.0
    """Upper bound of the ratio of step errors at the finest level and at a coarser level, in sensitive motion."""
    limit_fall: float = 4.0
    """Largest accepted amount by which the observed order of the limit's errors exceeds the order of the rule.

    This threshold is needed because two limits can agree by chance."""
