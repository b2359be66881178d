"""How to integrate: method, steps, duration, samples, solver of forward dynamics."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.data import documents
from flexlink.describe import data_files
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import NonNegative, Positive, Spec, measured_in
from flexlink.describe.whole_steps import is_whole, multiples, whole

AUTO = "auto"  # in place of a method's name
DEFAULT_TOLERANCE = 1e-3
"""Part of the arm's reach that any body may be off by at the end of a run that says nothing of its steps."""
DEFAULT_DURATION = 5.0  # s
ForwardSolver = Literal["articulated", "lu", "cholesky"]
"""Solvers of forward dynamics."""
Unstable = Literal["refuse", "allow"]
"""What becomes of a run that is not stable."""
Accuracy = Literal["tip", "deflection"]
"""What a relative tolerance is a part of."""


class RunSettings(Spec, frozen=True, dict=True):  # with a dict, for cached properties
    """How to integrate: method, steps, duration, time between stored samples [s], solver of forward dynamics.

    Steps are fixed, of length `step`, or follow from the error that is allowed at the end of the run: `tolerance` [m]
    of any body's place, or `relative_tolerance`, a part of the arm's reach (accuracy = "tip") or of how far all springs
    have moved any body so far, at most (accuracy = "deflection"); `step` then has no effect. method = "auto", the
    default then, takes the cheapest method. Vibrations too small to matter for the tip's path may be damped away by
    accuracy = "tip".

    Where nothing is said of method, step and tolerance, steps keep a tolerance of a thousandth of the reach. A method
    alone takes fixed steps of 1e-4 s.

    Such a run may take `max_evaluations` of forward or inverse dynamics: a hundred times what dry friction of the
    stiffest arms has taken, and half a minute of ten joints. One that would take more tells where it hangs, then stops.

    `unstable` = "allow" insists on a step beyond the largest stable one, and on a run whose energy does not balance.

    Examples
    --------
    >>> by_step = fl.RunSettings(method="RK4", step=1e-4, duration=2.0, sample=0.01)  # s
    >>> by_error = fl.RunSettings(method="auto", tolerance=1e-4, duration=2.0)  # m
    >>> print(fl.simulate(scene.varied({"run": by_error})).steps.method)
    Radau5
    """

    method: str = ""
    """Runge-Kutta method: a name, the path of a method's file, or auto, the cheapest for the tolerance. Default: auto;
    with a step RK4."""
    step: Annotated[Positive | None, measured_in("s")] = None
    """Length of fixed steps [s]. Default: steps follow from a tolerance; of a method that is named 1e-4."""
    duration: Annotated[NonNegative, measured_in("s")] = DEFAULT_DURATION
    """How long the run is [s]; 0: one sample, the start."""
    sample: Annotated[Positive | None, measured_in("s")] = None
    """Time between stored samples [s]. Default: 0.005, or what is nearest of the parts of the duration that are whole
    numbers of steps."""
    solver: ForwardSolver = "articulated"
    """Of forward dynamics: articulated bodies, or M by LU (the paper's way) or Cholesky."""
    unstable: Unstable = "refuse"
    """What becomes of a step beyond the largest stable one, and of a run whose energy does not balance."""
    tolerance: Annotated[Positive | None, measured_in("m")] = None
    """Largest error of any body's place at the end of the run [m]; steps follow from it."""
    relative_tolerance: Positive | None = None
    """The same as a part of the reach, or of the deflection (`accuracy`) [1]. Default: 1e-3, where neither method nor
    step are given."""
    accuracy: Accuracy = "tip"
    """What a relative tolerance is a part of: the arm's reach (tip), or how far springs have moved it."""
    max_evaluations: Positive = 1e7
    """Evaluations of dynamics after which a run with a tolerance stops as an error."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.method:
            fixed = self.step is not None and not self.has_tolerance
            msgspec.structs.force_setattr(self, "method", "RK4" if fixed else AUTO)
        msgspec.structs.force_setattr(self, "method", documents.absolute(self.method))
        if self.controlled:
            self._check_tolerance()
        elif self.sample is None:
            whole(self._duration_said, self.duration, self.said("step"), self.fixed_step)
        else:
            whole("sample", self.sample, self.said("step"), self.fixed_step)
        whole(self._duration_said, self.duration, self.said("sample"), self.spacing)

    def _check_tolerance(self) -> None:
        if self.tolerance is not None and self.relative_tolerance is not None:
            raise SceneError(
                f"relative_tolerance = {self.relative_tolerance!r}: tolerance = {self.tolerance!r} is given, too; "
                "give only one",
                id="both-given",
            )
        if self.step is not None and self.has_tolerance:
            key = "tolerance" if self.tolerance is not None else "relative_tolerance"
            raise SceneError(
                f"step = {self.step!r}: {key} = {getattr(self, key)!r} is given, too; give only one", id="both-given"
            )
        if self.accuracy == "deflection" and self.relative_tolerance is None:
            raise SceneError(
                "accuracy = 'deflection': needs relative_tolerance, a fraction of the deflection",
                id="needs-another-key",
            )

    @property
    def has_tolerance(self) -> bool:
        """Whether a tolerance is given."""
        return self.tolerance is not None or self.relative_tolerance is not None

    @functools.cached_property
    def controlled(self) -> bool:
        """Whether steps follow from a tolerance."""
        return self.has_tolerance or self.method == AUTO

    @property
    def by_default(self) -> bool:
        """Whether steps follow from the tolerance that is taken where neither method, step nor tolerance are given."""
        return self.method == AUTO and not self.has_tolerance

    @property
    def in_words(self) -> str:
        """Method, step or tolerance, and duration, in one line."""
        steps = f"step {self.fixed_step:g} s"
        if self.tolerance is not None:
            steps = f"tolerance {self.tolerance:g} m"
        elif self.controlled:
            steps = f"tolerance {self.tolerance_within(1.0):g} of the {self.measure}"
        return f"{self.method}, {steps}, duration {self.duration:g} s"

    @property
    def measure(self) -> str:
        """What a relative tolerance is a part of."""
        return {"tip": "reach", "deflection": "deflection"}[self.accuracy]

    @property
    def _duration_said(self) -> str:
        """Its key, for messages."""
        return "duration" if self.duration != DEFAULT_DURATION else f"duration, by default {DEFAULT_DURATION},"

    def said(self, key: str, above: str = "") -> str:
        """A key of these settings, below another, for messages: of one that nobody wrote, that it is a default."""
        return f"{above}{key}" if getattr(self, key) is not None else f"the default {above}{key}"

    def tolerance_within(self, length: float) -> float:
        """The tolerance [m], a relative one of this length."""
        return self.tolerance or (self.relative_tolerance or DEFAULT_TOLERANCE) * length

    @property
    def fixed_step(self) -> float:
        """Length of fixed steps [s]."""
        # length of the fixed steps of a run that names a method alone [s]
        return 1e-4 if self.step is None else self.step

    @functools.cached_property
    def spacing(self) -> float:
        """Time between two stored samples [s]."""
        if self.sample is not None:
            return self.sample
        return default_sample(self.duration, None if self.controlled else self.fixed_step)

    @functools.cached_property
    def steps_per_sample(self) -> int:
        """Number of fixed steps between two stored samples."""
        return round(self.spacing / self.fixed_step)

    @functools.cached_property
    def between(self) -> float:
        """Time between two stored samples [s]: of fixed steps what their number takes."""
        return self.spacing if self.controlled else self.steps_per_sample * self.fixed_step

    @functools.cached_property
    def samples(self) -> int:
        """Number of stored samples, the initial one included."""
        return round(self.duration / self.spacing) + 1

    @property
    def times(self) -> Array:
        """Times of the stored samples [s] of a run that starts at t = 0, shape (samples,)."""
        return self.times_from(0.0)

    def times_from(self, start: float) -> Array:
        """Times of the stored samples [s]: whole multiples of the time between them, if the start is one."""
        return multiples(start, self.between, self.samples)


@functools.lru_cache(maxsize=256)
def default_sample(duration: float, step: float | None) -> float:
    """Time between stored samples [s] where none is given: a part of the duration near 0.005 s, of whole steps."""
    # time between stored samples where it fits the run [s]
    sample = 0.005
    if _fits(duration, sample) and (step is None or _fits(sample, step)):
        return sample
    if step is None:
        return duration / max(1, round(duration / sample))
    near, total, tries = max(1, round(min(sample / step, 2**53))), round(duration / step), 10_000
    fitting = (number for number in range(near, max(0, near - tries), -1) if total % number == 0)
    return next(fitting, total) * step


def _fits(long: float, unit: float) -> bool:
    return long == 0 or (0.5 < long / unit < 2**53 and is_whole(long / unit))


def of_run_alone(changes: Mapping[str, object]) -> bool:
    """Whether changes of a scene are of its run, to values that mean the same everywhere, as a user's file does not."""
    return isinstance(changes, Mapping) and bool(changes) and all(map(_plain, changes, changes.values()))


def _plain(path: object, value: object) -> bool:
    known = value is None or isinstance(value, str | int | float)
    return known and isinstance(path, str) and path.startswith("run.") and not documents.is_user_file(value)


def implied(run: RunSettings, changes: Mapping[str, object]) -> dict[str, None]:
    """Settings of a run that changes by path leave out: a tolerance takes the place of fixed steps, and reversely.

    Raises
    ------
    SceneError
        Both are given.
    """
    changed = {path for path, value in changes.items() if value is not None}
    tolerances, step = changed & {"run.tolerance", "run.relative_tolerance"}, "run.step" in changed
    if tolerances and step:
        raise SceneError(
            f"run.step = {truncated(changes['run.step'])}: {min(tolerances)} is given, too; give only one",
            id="both-given",
        )
    gone: list[str] = []
    if tolerances or step:
        gone += ["run.tolerance", "run.relative_tolerance"]
    if tolerances:
        gone += ["run.step"]
    if step:
        gone += ["run.accuracy"]
    if (tolerances and not run.controlled) or (step and run.method == AUTO):
        gone += ["run.method"]
    return dict.fromkeys(gone)


def steps_explicitly(run: RunSettings) -> bool:
    """Whether a run takes fixed steps of an explicit method."""
    return not run.controlled and method(run.method).explicit


def check_method(run: RunSettings) -> None:
    """The method of a run is there, and it can do what the run asks of it.

    Raises
    ------
    SceneError
        The message names the key, the value and what is allowed.
    DataFileError
        The method's own file is not valid.
    """
    if run.method == AUTO:
        if run.by_default and run.step is not None:
            raise SceneError(
                f"run.method = {AUTO!r}: picks a method for a tolerance, but run.step = {run.step!r} is given; give "
                "run.tolerance, or a method, or leave run.step out",
                id="method-and-step",
            )
        return
    try:
        able = method(run.method).controlled or not run.controlled
    except (ArgumentError, DataFileError) as error:
        kind = DataFileError if isinstance(error, DataFileError) else SceneError
        raise kind(f"run.{error}") from None
    if not able:
        allowed = ", ".join([AUTO, *(name for name in data_files.names("methods") if method(name).controlled)])
        raise SceneError(
            f"run.method = {truncated(run.method)}: has no error estimate; with a tolerance allowed are {allowed}",
            id="method-without-error",
        )
