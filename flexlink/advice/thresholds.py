"""Thresholds for the choice of a model."""

from __future__ import annotations


class Thresholds:
    """Fractions of the allowed error, safety factors, and initial choices."""

    reference_step_share: float = 0.02
    """Tolerance of the steps of reference runs over the allowed error."""
    stable_share: float = 0.9
    """Fixed step over the smallest stable step of several configurations."""
    perturbation: float = 10.0
    """Minimum initial distance of a perturbed run over the tolerance of steps: well above the step errors."""
    proportional: float = 0.1
    """Distance of two runs over the travel up to which it is proportional to the initial distance."""
    modest_growth: float = 10.0
    """Growth of errors that the safety factor of the estimate covers."""
    sensitive_growth: float = 30.0
    """Growth of initial errors above which the motion itself causes a large error."""
    hinges: int = 2
    """Hinges of each link, at Gauss points: exact for the deflection under loads that vary linearly along it."""
    first_guess: float = 0.1
    """Assumed travel of the tip over the size, before the first run."""
    rerun_factor: float = 1.5
    """Ratio of assumed to actual travel, and so of the tolerance of steps, above which a run is repeated."""
    screening_hinges: int = 2
    """Hinges of each link for screening.

    Runs are compared, not loads: an axis that loads bent by 3e-4 of the motion changed the motion by 6e-3.
    """
    allowed_share: float = 0.1
    """Allowed change of the tip by all omitted axes together, over the tolerance."""
    strict: float = 0.1
    """Tolerance of the steps that measure the step errors of levels, over the tolerance of the levels."""
    scatter: float = 5.0
    """Upper bound of step errors at the finest level over those at a coarser one, in sensitive motion."""
    limit_fall: float = 4.0
    """Largest accepted excess of the observed order of the limit's errors over the order of the rule.

    Two limits can agree by chance."""
