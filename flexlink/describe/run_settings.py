"""Integration settings: method, steps, duration, samples, and solver of forward dynamics."""

import functools
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import msgspec

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import both_given, truncated
from flexlink.data import documents
from flexlink.describe import data_files
from flexlink.describe.numbers import is_whole, multiples, whole
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import NonNegative, Positive, Spec, measured_in

AUTO = "auto"  # instead of a method's name
DEFAULT_TOLERANCE = 1e-3
"""Default tolerance: position error of any body at the end of the run, relative to the arm's reach."""
DEFAULT_DURATION = 5.0  # s
ForwardSolver = Literal["articulated", "lu", "cholesky"]  # solvers of forward dynamics
Unstable = Literal["refuse", "allow"]  # treatment of an unstable run
Accuracy = Literal["auto", "tip", "deflection"]  # what the tolerance of a run applies to
Output = Literal["sensors", "loads", "torques"]
"""What may be read of a run besides its tip and its slow motion, and then follows vibrations."""


class RunSettings(Spec, frozen=True, dict=True):  # the dict is for cached properties
    """Integration settings: method, steps, duration, time between stored samples [s], solver of forward dynamics.

    Steps are either fixed, of length `step`, or adapted to the error allowed at the end of the run: `tolerance` [m] for
    the position of any body, or `relative_tolerance`, relative to the arm's reach, or, with accuracy = "deflection", to
    the largest displacement of any body by spring deflection so far. With a tolerance, the default is method = "auto",
    which picks the cheapest method.

    With accuracy = "tip", vibrations too small to affect the tip's path may be damped numerically; strain gauges, loads
    and accelerations would miss them. With accuracy = "auto", the default, vibrations are followed if something that
    sees them is read: the sensors of the scene, and what `outputs` lists.

    If method, step and tolerance are all omitted, the tolerance is a thousandth of the reach. With only a method, steps
    are fixed, 1e-4 s long.

    A run with a tolerance may evaluate forward or inverse dynamics `max_evaluations` times; if it needs more, it stops
    and reports why. The default is a hundred times the number that the stiffest arms with dry friction need; for ten
    joints, this many evaluations take half a minute.

    `unstable` = "allow" permits a step above the stability limit, and a run whose energy does not balance.

    Examples
    --------
    >>> by_step = fl.RunSettings(method="RK4", step=1e-4, duration=2.0, sample=0.01)  # s
    >>> by_error = fl.RunSettings(method="auto", tolerance=1e-4, duration=2.0)  # m
    >>> print(fl.simulate(scene.varied({"run": by_error})).steps.method)
    Radau5
    """

    method: str = ""
    """Runge-Kutta method: a name, the path of a method file, or auto, which picks the cheapest for the tolerance.
    Default: auto; RK4 if a step is given."""
    step: Annotated[Positive | None, measured_in("s")] = None
    """Length of fixed steps [s]. Default: adaptive steps; 1e-4 if only a method is given."""
    duration: Annotated[NonNegative, measured_in("s")] = DEFAULT_DURATION
    """Duration of the run [s]; 0: only the initial sample."""
    sample: Annotated[Positive | None, measured_in("s")] = None
    """Time between stored samples [s]. Default: 0.005, or the nearest value that divides the duration and is a multiple
    of the step."""
    solver: ForwardSolver = "articulated"
    """Solver of forward dynamics: articulated bodies, or LU (as in the paper) or Cholesky factors of M."""
    unstable: Unstable = "refuse"
    """Treatment of a step above the stability limit, and of a run whose energy does not balance."""
    tolerance: Annotated[Positive | None, measured_in("m")] = None
    """Largest error of any body's position at the end of the run [m], due to the steps alone; it determines them."""
    relative_tolerance: Positive | None = None
    """Tolerance relative to the reach or to the deflection, by `accuracy` [1]. Default: 1e-3 if no method, step or
    tolerance is given."""
    accuracy: Accuracy = "auto"
    """What the tolerance applies to: the tip and what is read (auto), the tip alone, or the elastic displacement
    (deflection), the reference length of the relative tolerance."""
    outputs: tuple[Output, ...] = ()
    """What is read of the run besides its tip and its sensors: loads (also stress and strain), torques (also
    accelerations); with accuracy = "auto" the run follows the vibrations that these contain."""
    max_evaluations: Positive = 1e7
    """Number of evaluations of dynamics after which a run with a tolerance stops with an error."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.method:
            fixed = self.step is not None and not self.has_tolerance
            msgspec.structs.force_setattr(self, "method", "RK4" if fixed else AUTO)
        msgspec.structs.force_setattr(self, "method", documents.absolute(self.method))
        if self.tolerance is not None and self.relative_tolerance is not None:
            why = f"tolerance = {self.tolerance!r} is also given; specify only one"
            raise self._refused("relative_tolerance", why, "both-given")
        if self.step is not None and self.has_tolerance:
            key = "tolerance" if self.tolerance is not None else "relative_tolerance"
            raise both_given("step", self.step, f"{key} = {getattr(self, key)!r}")
        if self.controlled and self.accuracy == "deflection" and self.relative_tolerance is None:
            why = "needs relative_tolerance, a fraction of the deflection"
            raise self._refused("accuracy", why, "needs-another-key")
        key, time = (self._duration_key, self.duration) if self.sample is None else ("sample", self.sample)
        self.require_steps(key, time, "")
        whole(self._duration_key, self.duration, self.label("sample"), self.spacing)

    @property
    def has_tolerance(self) -> bool:
        """Whether a tolerance is given."""
        return self.tolerance is not None or self.relative_tolerance is not None

    @functools.cached_property
    def controlled(self) -> bool:
        """Whether steps are adapted to a tolerance."""
        return self.has_tolerance or self.method == AUTO

    @property
    def by_default(self) -> bool:
        """Whether the default tolerance applies because neither method, step nor tolerance is given."""
        return self.method == AUTO and not self.has_tolerance

    @property
    def in_words(self) -> str:
        """Method, step or tolerance, and duration, on one line."""
        steps = f"step {self.fixed_step:g} s"
        if self.tolerance is not None:
            steps = f"tolerance {self.tolerance:g} m"
        elif self.controlled:
            steps = f"tolerance {self.tolerance_within(1.0):g} of the {self.measure}"
        return f"{self.method}, {steps}, duration {self.duration:g} s"

    @property
    def measure(self) -> str:
        """Reference length of a relative tolerance, as text."""
        return "deflection" if self.accuracy == "deflection" else "reach"

    @property
    def _duration_key(self) -> str:
        """Key of the duration, for messages."""
        return "duration" if self.duration != DEFAULT_DURATION else f"duration (default {DEFAULT_DURATION})"

    def follows_vibrations(self, sensors: Sequence[object]) -> bool:
        """Whether steps follow vibrations that do not move the tip, because `sensors` or outputs contain them."""
        read = bool(sensors or self.outputs)
        return self.controlled and (self.accuracy == "deflection" or (self.accuracy == "auto" and read))

    def require_steps(self, name: str, time: float, above: str = "run.") -> None:
        """Check that a time called `name` is a multiple of the step, if steps are fixed."""
        if not self.controlled:
            whole(name, time, self.label("step", above), self.fixed_step)

    def label(self, key: str, above: str = "") -> str:
        """Key of a setting for messages, prefixed by `above`, and by "the default" if it was not given."""
        return f"{above}{key}" if getattr(self, key) is not None else f"the default {above}{key}"

    def tolerance_within(self, length: float) -> float:
        """The tolerance [m]; a relative tolerance is multiplied by `length` [m]."""
        return self.tolerance or (self.relative_tolerance or DEFAULT_TOLERANCE) * length

    @property
    def fixed_step(self) -> float:
        """Length of fixed steps [s]."""
        return 1e-4 if self.step is None else self.step  # 1e-4 if only a method is given

    @functools.cached_property
    def spacing(self) -> float:
        """Time between stored samples [s], as given or by default."""
        if self.sample is not None:
            return self.sample
        return default_sample(self.duration, None if self.controlled else self.fixed_step)

    @functools.cached_property
    def steps_per_sample(self) -> int:
        """Number of fixed steps between stored samples."""
        return round(self.spacing / self.fixed_step)

    @functools.cached_property
    def between(self) -> float:
        """Time between stored samples [s]; with fixed steps, exactly steps per sample times the step."""
        return self.spacing if self.controlled else self.steps_per_sample * self.fixed_step

    @functools.cached_property
    def samples(self) -> int:
        """Number of stored samples, including the initial one."""
        return round(self.duration / self.spacing) + 1

    @property
    def times(self) -> Array:
        """Times of the stored samples [s] of a run that starts at t = 0, shape (samples,)."""
        return self.times_from(0.0)

    def times_from(self, start: float) -> Array:
        """Times of the stored samples [s]; if the start is an integer multiple of their spacing, so are all others."""
        return multiples(start, self.between, self.samples)


@functools.lru_cache(maxsize=256)
def default_sample(duration: float, step: float | None) -> float:
    """Default time between stored samples [s]: near 0.005 s, a divisor of the duration and a multiple of the step."""
    sample = 0.005  # preferred time between stored samples [s]
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
    """Whether changes only set run settings to plain values, not to a user file, whose content may change."""
    return isinstance(changes, Mapping) and bool(changes) and all(map(_plain, changes, changes.values()))


def _plain(path: object, value: object) -> bool:
    known = value is None or isinstance(value, str | int | float)
    return known and isinstance(path, str) and path.startswith("run.") and not documents.is_user_file(value)


def implied(run: RunSettings, changes: Mapping[str, object]) -> dict[str, None]:
    """Run settings removed by changes: a tolerance replaces fixed steps, and a step replaces a tolerance."""
    changed = {path for path, value in changes.items() if value is not None}
    tolerances, step = changed & {"run.tolerance", "run.relative_tolerance"}, "run.step" in changed
    if tolerances and step:
        raise both_given("run.step", changes["run.step"], min(tolerances))
    gone: list[str] = []
    if tolerances or step:
        gone += ["run.tolerance", "run.relative_tolerance", "run.step" if tolerances else "run.accuracy"]
    known = run.method in data_files.names("methods")  # a user's file is read only when it runs
    controllable = run.controlled or (known and method(run.method).controlled)
    if (tolerances and not controllable) or (step and run.method == AUTO):
        gone += ["run.method"]
    return dict.fromkeys(gone)


def steps_explicitly(run: RunSettings) -> bool:
    """Whether a run uses fixed steps with an explicit method."""
    return not run.controlled and method(run.method).explicit


def check_method(run: RunSettings) -> None:
    """Check that the method of a run exists and supports its settings."""
    if run.method == AUTO:
        if run.by_default and run.step is not None:
            given = f"run.method = {AUTO!r}: needs a tolerance, but run.step = {run.step!r} is given"
            raise SceneError(f"{given}; give run.tolerance or a method, or leave run.step out", id="method-and-step")
        return
    try:
        supported = method(run.method).controlled or not run.controlled
    except DataFileError as error:
        raise DataFileError(f"run.{error}") from None
    except ArgumentError as error:
        raise SceneError(f"run.{error}".replace("allowed are", f"allowed are {AUTO},", 1)) from None
    if not supported:
        allowed = ", ".join([AUTO, *(name for name in data_files.names("methods") if method(name).controlled)])
        why = f"has no error estimate; with a tolerance use {allowed}"
        raise SceneError(f"run.method = {truncated(run.method)}: {why}", id="method-without-error")
