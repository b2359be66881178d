"""An identification problem as data, read from TOML: a scene, its unknown parameters, and measurements."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from flexlink.common.errors import SceneError, errors_at
from flexlink.data import documents
from flexlink.data.documents import paths_of
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import scene_named
from flexlink.describe.spec import Deviation, Positive, Spec, decode, mistakes, raise_together

Use = Literal["fit", "check"]  # use of data: to fit the parameters, or to check the fit with data that were not fitted
Loss = Literal["linear", "soft_l1", "huber", "trimmed"]
"""Loss function of the residuals: "linear" is least squares; "soft_l1" and "huber" reduce the weight of outliers;
"trimmed" leaves them out."""


def _require_order(name: str, pair: tuple[float, float] | None, expected: str) -> None:
    if pair is not None and not pair[0] < pair[1]:
        raise SceneError(f"{name} = {list(pair)}: {expected}", id="range-order")


class FitParameter(Spec, frozen=True):
    """An unknown parameter of the scene.

    Examples
    --------
    >>> young = fl.fits.FitParameter(path="material.aluminium.young", between=(5e10, 9e10))
    >>> payload = fl.fits.FitParameter(path="tip.mass", prior=(4.0, 0.1))  # weighed, ± 0.1 kg
    """

    path: str
    """Path of the number, as in `Scene.varied`; with `*` the path selects several equal numbers."""
    between: tuple[float, float] | None = None
    """Lower and upper bound. Default: a thousandth and a thousand times the initial guess if the logarithm is
    estimated, otherwise none."""
    start: float | None = None
    """Initial guess. Default: the scene's value."""
    prior: tuple[float, Deviation] | None = None
    """Prior: mean and standard deviation."""
    scale: Literal["auto", "log", "linear"] = "auto"
    """Whether to estimate the logarithm. Default ("auto"): yes for positive numbers, except in the initial state."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_order("between", self.between, "the first must be less than the second")
        if self.between is not None and self.start is not None and not self.within(self.start):
            raise SceneError(f"start = {self.start!r}: outside between = {list(self.between)}", id="parameter-start")

    def within(self, value: float) -> bool:
        """Whether a value is within the bounds."""
        low, high = self.between or (-math.inf, math.inf)
        return low <= value <= high


class FitRun(Spec, frozen=True):
    """A recorded run: its file, its differences from the scene, and the columns to compare.

    Examples
    --------
    >>> swing = fl.fits.FitRun(name="swing", file="swing.csv", set={"tip.mass": 2.0}, noise={"tip y [m]": 1e-3})
    >>> held_out = fl.fits.FitRun(name="again", file="again.csv", use="check", window=(0.0, 2.0))
    """

    name: str
    """Unique name of the run."""
    file: str | tuple[str, ...] = ""
    """CSV file with a column "t [s]" and columns named like those of a simulated run; angles may be in deg, lengths in
    mm. The path is relative to the problem's file. A list of files, each with its own times on one clock, is for
    instruments with different sampling rates."""
    columns: dict[str, tuple[float, ...]] = msgspec.field(default_factory=dict)
    """Columns that replace a file: lists of values by column head, including "t [s]"."""
    use: Use = "fit"
    """Whether to fit the run, or to keep it to check the fit."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Differences from the scene in this run, values by path."""
    compare: tuple[str, ...] = ()
    """Heads of the columns to compare; other columns are ignored. Default: all columns, which must then be known."""
    noise: dict[str, Deviation] = msgspec.field(default_factory=dict)
    """Standard deviation of a column's noise, by its head, in the unit of the head. Default: the noise of the scene's
    sensor of this name, otherwise estimated from the residuals."""
    gain: tuple[str, ...] = ()
    """Heads of columns whose scale is unknown and estimated."""
    bias: tuple[str, ...] = ()
    """Heads of columns whose offset is unknown and estimated."""
    drift: tuple[str, ...] = ()
    """Heads of columns whose offset changes linearly with time, at an unknown rate that is estimated."""
    delay: tuple[str, ...] = ()
    """Heads of columns whose delay is unknown and estimated: the column shows y(t − delay)."""
    clock: bool = False
    """Whether the rate error c of the record's clock is unknown and estimated: times are (1 + c) times true times."""
    start: float | Literal["first sample", "unknown"] | None = None
    """Time in the record at which the scene starts [s]; "first sample": the record's first time; "unknown": about the
    time of the scene's start, and estimated. Default: the scene's start, `initial.time`."""
    window: tuple[float, float] | None = None
    """First and last time to use, from the scene's start on [s]. Default: all."""
    parameter: tuple[FitParameter, ...] = ()
    """Parameters of this run alone, for example its initial angle."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == bool(self.columns):
            raise SceneError(f"file = {self.file!r}: specify either a file or columns", id="both-given")
        _require_order("window", self.window, "the first time must be earlier than the second")


def files_of(run: FitRun) -> tuple[str, ...]:
    """Files of a run; empty if it has columns instead."""
    return ((run.file,) if run.file else ()) if isinstance(run.file, str) else run.file


class FitModes(Spec, frozen=True):
    """Measured natural frequencies of the arm at rest.

    Examples
    --------
    >>> tapped = fl.fits.FitModes(hertz=(5.71, 26.9), deviation=(0.02, 0.1))
    """

    hertz: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)]
    """Frequencies [Hz]."""
    deviation: tuple[Deviation, ...]
    """Standard deviation of each frequency, or one value for all [Hz]."""
    numbers: tuple[int, ...] = ()
    """Numbers of the elastic modes, from 1, slowest first. Default: the first modes."""
    ratios: tuple[float, ...] = ()
    """Damping ratios of the same modes [1]. Default: not measured."""
    ratio_deviation: Deviation = 1e-3
    """Standard deviation of the damping ratios [1]."""
    locked: tuple[str, ...] | None = None
    """Locked links or joints. Default: all driven joints."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Differences from the scene, values by path."""
    use: Use = "fit"
    """Whether to fit these modes, or to keep them to check the fit."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, values in (("numbers", self.numbers), ("ratios", self.ratios)):
            if values and len(values) != len(self.hertz):
                text = f"{name} = {list(values)}: expected one per frequency, {len(self.hertz)}"
                raise SceneError(text, id="one-per-frequency")
        if len(self.deviation) not in (1, len(self.hertz)):
            text = f"deviation = {list(self.deviation)}: expected 1 number or {len(self.hertz)}"
            raise SceneError(text, id="one-per-frequency")
        if any(number < 1 for number in self.numbers):
            raise SceneError(f"numbers = {list(self.numbers)}: modes are counted from 1", id="modes-counted-from-1")
        pairs = sorted(zip(self.numbers or range(len(self.hertz)), self.hertz, strict=True))
        if any(after < before for (_, before), (_, after) in itertools.pairwise(pairs)):
            text = f"hertz = {list(self.hertz)}: frequencies must increase with the mode's number; sort them"
            raise SceneError(text, id="modes-not-increasing")


class FitStatic(Spec, frozen=True):
    """A measured static position of the tip with the driven joints locked, or its change if `before` is given.

    Examples
    --------
    >>> sag = fl.fits.FitStatic(axis="y", value=-3.1e-3, deviation=5e-5, before={"tip.mass": 0.0})  # m, due to payload
    """

    axis: Literal["x", "y", "z"]
    """Coordinate axis of frame 0."""
    value: float
    """Coordinate of the tip, or its increase from the state `before` [m]."""
    deviation: Deviation
    """Standard deviation of `value` [m]."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Differences from the scene, values by path."""
    before: dict[str, Any] | None = None
    """Values by path in which the reference state differs from this state."""
    use: Use = "fit"
    """Whether to fit this position, or to keep it to check the fit."""


class FitFrf(Spec, frozen=True):
    """A measured frequency response of the arm at rest: an output over an input, with its coherence.

    The prediction is the linear model at the scene's static equilibrium, with the driven joints held at their initial
    angles by constant torques. A drive torque is the torque that was measured, so controllers have no effect.

    Examples
    --------
    >>> tapped = fl.fits.FitFrf(input="tip force z [N]", output="gyro [rad/s]", file="tapped.csv", averages=10)
    """

    input: str
    """Torque of a driven joint, "tau NAME [N m]", acceleration of a prescribed joint, "qdd NAME [rad/s²]", or force on
    the tip along an axis of frame 0, "tip force z [N]"."""
    output: str
    """Name of a sensor's column, or "tip z [m]", "tip rate z [m/s]", "q NAME [rad]", "qd NAME [rad/s]"; lengths may be
    in mm and angles in deg."""
    file: str = ""
    """CSV file with a column "f [Hz]", "magnitude" (also in dB) and "phase [deg]" or "real" and "imaginary", in the
    units of output over input, and "coherence". The path is relative to the problem's file."""
    columns: dict[str, tuple[float, ...]] = msgspec.field(default_factory=dict)
    """Columns that replace a file: lists of values by column head, including "f [Hz]"."""
    averages: Annotated[float, msgspec.Meta(gt=1)] | None = None
    """Number n of independent averages, from which the coherence γ² gives the variance (1 − γ²)/(2 n γ²), relative to
    the square of the response [1]."""
    deviation: Deviation | None = None
    """Standard deviation relative to the response, if there is no coherence [1]."""
    band: tuple[float, float] | None = None
    """Lowest and highest frequency to use [Hz]. Default: all."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Differences from the scene, values by path."""
    use: Use = "fit"
    """Whether to fit this response, or to keep it to check the fit."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == bool(self.columns):
            raise SceneError(f"file = {self.file!r}: specify either a file or columns", id="both-given")
        if (self.averages is None) == (self.deviation is None):
            text = f"averages = {self.averages!r}: specify either averages, with a coherence, or deviation"
            raise SceneError(text, id="both-given")
        _require_order("band", self.band, "the first frequency must be less than the second")


class FitProblem(Spec, frozen=True):
    """A scene, its unknown parameters, and measurements.

    Examples
    --------
    >>> problem = fl.fits.FitProblem(
    ...     scene=scene,
    ...     parameter=(fl.fits.FitParameter(path="material.aluminium.young"),),
    ...     modes=(fl.fits.FitModes(hertz=(5.5,), deviation=(0.02,)),),
    ... )
    >>> print(f"{fl.fit(problem).scene.arm.materials['aluminium'].young:.3g}")
    6.52e+10
    """

    scene: Scene
    """The scene; in a file, its path relative to the file."""
    parameter: Annotated[tuple[FitParameter, ...], msgspec.Meta(min_length=1)]
    """Unknown parameters, `[[parameter]]` in a file."""
    run: tuple[FitRun, ...] = ()
    """Recorded runs, `[[run]]` in a file."""
    modes: tuple[FitModes, ...] = ()
    """Measured natural frequencies, `[[modes]]` in a file."""
    static: tuple[FitStatic, ...] = ()
    """Measured static positions of the tip, `[[static]]` in a file."""
    frf: tuple[FitFrf, ...] = ()
    """Measured frequency responses, `[[frf]]` in a file."""
    about: str = ""
    """A sentence on the purpose of the fit."""
    loss: Loss = "linear"
    """Loss function of the residuals. soft_l1 and huber reduce the weight of outliers; trimmed is least squares without
    the samples that are more than six robust standard deviations off the model."""
    noise: Literal["coloured", "white"] = "coloured"
    """Noise model. "coloured": residuals are whitened by an autoregressive model, which gives the narrowest intervals
    if the residuals are noise. "white": residuals are independent, which gives the smallest simulation error. Intervals
    account for autocorrelation either way."""
    tolerance: Positive = 1e-8
    """Tolerance of the simulations, relative to the reach [1]. It replaces the scene's tolerance, which is too coarse
    for derivatives; fixed steps are not changed."""

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [run.name for run in self.run]
        if twice := [name for name in names if names.count(name) > 1]:
            raise SceneError(f"run.name = {twice[0]!r}: two runs have this name; rename one", id="name-twice")
        paths = [parameter.path for parameter in self.parameter]
        for paths_of_run in (paths, *([*paths, *(p.path for p in run.parameter)] for run in self.run)):
            if twice := [path for path in paths_of_run if paths_of_run.count(path) > 1]:
                raise SceneError(f"parameter.path = {twice[0]!r}: given twice; remove one", id="parameter-twice")
        for key in ("run", "modes", "static", "frf"):  # none may set a parameter that is estimated for all runs
            for part in getattr(self, key):
                for path in (*part.set, *(getattr(part, "before", None) or ())):
                    if path in paths:
                        why = "is an unknown parameter, and cannot be set for part of the data; express the "
                        why += "difference by another path, for example a wrench or link.NAME.end.mass"
                        raise SceneError(f"{key}.set: {path!r} {why}", id="parameter-set")
        data: Sequence[FitRun | FitModes | FitStatic | FitFrf] = (*self.run, *self.modes, *self.static, *self.frf)
        if not any(part.use == "fit" for part in data):
            text = "run, modes, static, frf: nothing to fit; give at least one with use = 'fit'"
            raise SceneError(text, id="nothing-to-fit")

    def __repr__(self) -> str:
        sought = ", ".join(parameter.path for parameter in self.parameter)
        return f"<FitProblem of {self.scene.name!r}: {sought}>"

    @classmethod
    def load(cls, path: str | Path) -> FitProblem:
        """Read a problem from a TOML file.

        Parameters
        ----------
        path
            A TOML file: `scene`, a path relative to the file, then `[[parameter]]`, and the measurements in `[[run]]`,
            `[[modes]]`, `[[static]]` and `[[frf]]`.

        Returns
        -------
        FitProblem
            The problem; files of recorded runs are read when it is fitted.

        Raises
        ------
        ArgumentError
            `path` is not a path.
        SceneError
            The problem is invalid; the message names the file, the key path, the value and the allowed values.
        DataFileError
            The file of a lumping rule or method in the scene is not valid.

        Examples
        --------
        >>> problem = fl.fits.FitProblem.load("models/fits/tapped.toml")
        >>> print(problem.scene.name, [parameter.path for parameter in problem.parameter])
        three_links ['material.aluminium.young', 'tip.mass']
        """
        path = documents.require_path("path", path)
        raw = documents.read_toml(path)
        with errors_at(f"{path}: "):
            scene, types = scene_named(raw, path, cls, "a fit")
            for part in ("run", "modes", "static", "frf"):
                if isinstance(raw.get(part), list):
                    raw[part] = documents.with_absolute_paths(path.parent, [_as_paths(table) for table in raw[part]])
            raise_together(wrong for key, value in raw.items() for wrong in mistakes(value, types[key], key))
            return cls(scene=scene, **{key: decode(value, types[key], key) for key, value in raw.items()})


def _as_paths(table: Any) -> Any:
    """Rejoin the keys of `set` and `before` into paths; TOML has split them at their dots."""
    if not isinstance(table, dict):
        return table
    apart = (key for key in ("set", "before") if isinstance(table.get(key), dict))
    return table | {key: dict(paths_of(table[key])) for key in apart}
