"""Numbers by which a model is chosen."""

from __future__ import annotations


class Thresholds:
    """Shares of what is allowed, factors of safety, and what is tried first."""

    reference_step_share: float = 0.02
    """Tolerance of the steps of runs that others are compared with, as a share of the allowed error."""
    stable_share: float = 0.9
    """Share of the smallest stable step over several postures that fixed steps take."""
    perturbation: float = 10.0
    """Least initial distance of a perturbed run, over the tolerance of steps: well above the errors of the steps."""
    proportional: float = 0.1
    """Distance of two runs, over the travel, up to which it is proportional to the initial distance."""
    modest_growth: float = 10.0
    """Growth of errors that the safety factor of the estimate covers."""
    sensitive_growth: float = 30.0
    """Growth of initial errors from which the motion itself is to blame for a large error."""
    hinges: int = 2
    """Of each link, at Gauss points: exact for the deflection under loads that are linear along it."""
    first_guess: float = 0.1
    """Assumed travel of the tip over the size, before the first run."""
    rerun_factor: float = 1.5
    """Error of an assumed travel, and so of the tolerance of steps, from which a run is repeated."""
    screening_hinges: int = 2
    """Of each link. Runs are compared, not loads: an axis that loads bent by 3e-4 of the motion changed it by 6e-3."""
    allowed_share: float = 0.1
    """Share of the tolerance that all axes left out may change the tip by, together."""
    strict: float = 0.1
    """Tolerance of steps that measure the step errors of levels, over their tolerance."""
    scatter: float = 5.0
    """Step errors at the finest level over those at a coarser one, at most, where motion is sensitive."""
    limit_fall: float = 4.0
    """By how much the order by which errors of the limit are believed to fall exceeds that of the rule, at most.

    Two limits can agree by chance."""
