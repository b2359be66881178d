"""A fit as data: a scene, its parameters, and what was measured; read from TOML."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import msgspec

from flexlink.common.errors import SceneError
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Deviation, Positive, Spec

Use = Literal["fit", "check"]
"""What data are for: to fit, or to judge what was fitted without them."""
Loss = Literal["linear", "soft_l1", "huber"]
"""How residuals count: squared, or less where they are far larger than the noise."""


class FitParameter(Spec, frozen=True):
    """A number of the scene that is estimated.

    Examples
    --------
    >>> young = fl.fits.FitParameter(path="material.aluminium.young", between=(5e10, 9e10))
    >>> payload = fl.fits.FitParameter(path="tip.mass", prior=(4.0, 0.1))  # weighed, ± 0.1 kg
    """

    path: str
    """Path of the number, as `Scene.varied` takes it; `*` for several that are equal."""
    between: tuple[float, float] | None = None
    """Least and largest value that are tried. Default: a thousandth and a thousand times the start where its
    logarithm is estimated, else none."""
    start: float | None = None
    """Where the search begins. Default: the scene's value."""
    prior: tuple[float, Deviation] | None = None
    """What is known of it already: its value and its standard deviation."""
    scale: Literal["auto", "log", "linear"] = "auto"
    """Whether its logarithm is estimated. Default: of positive numbers, but not of those of the initial state."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.between is not None and not self.between[0] < self.between[1]:
            raise SceneError(
                f"between = {list(self.between)}: the first must be less than the second", id="range-order"
            )
        if self.between is not None and self.start is not None and not self.within(self.start):
            raise SceneError(f"start = {self.start!r}: outside between = {list(self.between)}", id="parameter-start")

    def within(self, value: float) -> bool:
        """Whether a value may be tried."""
        low, high = self.between or (-math.inf, math.inf)
        return low <= value <= high


class FitRun(Spec, frozen=True):
    """A run that was recorded: its file, what is known to differ from the scene, which columns count.

    Examples
    --------
    >>> swing = fl.fits.FitRun(name="swing", file="swing.csv", set={"tip.mass": 2.0}, noise={"tip y [m]": 1e-3})
    >>> held_out = fl.fits.FitRun(name="again", file="again.csv", use="check", window=(0.0, 2.0))
    """

    name: str
    """Its name, one of its own."""
    file: str = ""
    """CSV file whose heads are "t [s]" and names of columns of a run, angles also in deg, lengths in mm; in a problem's
    file from that file's folder."""
    columns: dict[str, tuple[float, ...]] = msgspec.field(default_factory=dict)
    """The same in place of a file: numbers by head, "t [s]" among them."""
    use: Use = "fit"
    """Whether it is fitted, or kept to check the fit."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """What differs from the scene in this run, values by path."""
    compare: tuple[str, ...] = ()
    """Columns that count, as in the file's heads; others may be anything. Default: all, and all must be known."""
    noise: dict[str, Deviation] = msgspec.field(default_factory=dict)
    """Standard deviation of a column's noise, by its head, in the head's unit. Default: that of the scene's sensor of
    this name, else what the fit leaves."""
    gain: tuple[str, ...] = ()
    """Heads of columns whose scale is not known: the best one is found with the fit."""
    bias: tuple[str, ...] = ()
    """Heads of columns whose zero is not known: the best one is found with the fit."""
    window: tuple[float, float] | None = None
    """First and last time that count [s]. Default: all."""
    parameter: tuple[FitParameter, ...] = ()
    """Parameters of this run alone, such as where it starts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.file) == bool(self.columns):
            raise SceneError(f"file = {self.file!r}: give either a file or columns", id="both-given")
        if self.window is not None and not self.window[0] < self.window[1]:
            raise SceneError(
                f"window = {list(self.window)}: the first time must be earlier than the second", id="range-order"
            )


class FitModes(Spec, frozen=True):
    """Natural frequencies that were measured, the arm at rest.

    Examples
    --------
    >>> tapped = fl.fits.FitModes(hertz=(5.71, 26.9), deviation=(0.02, 0.1))
    """

    hertz: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)]
    """Frequencies [Hz]."""
    deviation: tuple[Deviation, ...]
    """Standard deviation of each, or one of all [Hz]."""
    numbers: tuple[int, ...] = ()
    """Which of the arm's elastic modes they are, from 1, slowest first. Default: the first ones."""
    ratios: tuple[float, ...] = ()
    """Ratios of damping of the same modes [1]. Default: not measured."""
    ratio_deviation: Deviation = 1e-3
    """Standard deviation of the ratios [1]."""
    locked: tuple[str, ...] | None = None
    """Links or joints that are held. Default: all driven joints."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """What differs from the scene, values by path."""
    use: Use = "fit"
    """Whether they are fitted, or kept to check the fit."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, values in (("numbers", self.numbers), ("ratios", self.ratios)):
            if values and len(values) != len(self.hertz):
                raise SceneError(
                    f"{name} = {list(values)}: expected one per frequency, {len(self.hertz)}", id="one-per-frequency"
                )
        if len(self.deviation) not in (1, len(self.hertz)):
            raise SceneError(
                f"deviation = {list(self.deviation)}: expected one number, or {len(self.hertz)}", id="one-per-frequency"
            )
        if any(number < 1 for number in self.numbers):
            raise SceneError(f"numbers = {list(self.numbers)}: modes are counted from 1", id="modes-counted-from-1")


class FitStatic(Spec, frozen=True):
    """A static position of the tip that was measured, the driven joints held; with `before` a change of position.

    Examples
    --------
    >>> sag = fl.fits.FitStatic(axis="y", value=-3.1e-3, deviation=5e-5, before={"tip.mass": 0.0})  # m, by the payload
    """

    axis: Literal["x", "y", "z"]
    """Along which axis of frame 0."""
    value: float
    """The tip's coordinate, or by how much it is larger than `before` [m]."""
    deviation: Deviation
    """Its standard deviation [m]."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """What differs from the scene, values by path."""
    before: dict[str, Any] | None = None
    """What differs from that in the state that the change is counted from, values by path."""
    use: Use = "fit"
    """Whether it is fitted, or kept to check the fit."""


class FitProblem(Spec, frozen=True):
    """A scene, its parameters, and what was measured.

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
    """The scene; in a file its path, from the file's folder."""
    parameter: Annotated[tuple[FitParameter, ...], msgspec.Meta(min_length=1)]
    """Parameters, `[[parameter]]` in a file."""
    run: tuple[FitRun, ...] = ()
    """Runs that were recorded, `[[run]]` in a file."""
    modes: tuple[FitModes, ...] = ()
    """Frequencies that were measured, `[[modes]]` in a file."""
    static: tuple[FitStatic, ...] = ()
    """Static positions of the tip that were measured, `[[static]]` in a file."""
    about: str = ""
    """A sentence on what is fitted."""
    loss: Loss = "linear"
    """How residuals count; soft_l1 and huber bound the effect of outliers."""
    noise: Literal["coloured", "white"] = "coloured"
    """Noise model. "coloured": residuals are whitened by an autoregressive model, the least uncertain answer where they
    are noise; "white": residuals are independent, the least simulation error. Intervals count autocorrelation either
    way."""
    tolerance: Positive = 1e-8
    """Error of the fit's runs as a part of the reach, of scenes without fixed steps [1]; theirs is too rough for
    slopes."""

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [run.name for run in self.run]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise SceneError(f"run.name = {twice[0]!r}: two runs have this name; rename one", id="name-twice")
        paths = [parameter.path for parameter in self.parameter]
        for paths_of_run in (paths, *([*paths, *(p.path for p in run.parameter)] for run in self.run)):
            twice = [path for path in paths_of_run if paths_of_run.count(path) > 1]
            if twice:
                raise SceneError(f"parameter.path = {twice[0]!r}: is sought twice; name it once", id="parameter-twice")
        self._check_set(paths)
        data: Sequence[FitRun | FitModes | FitStatic] = (*self.run, *self.modes, *self.static)
        if not any(part.use == "fit" for part in data):
            raise SceneError(
                "run, modes, static: nothing to fit; give at least one with use = 'fit'", id="nothing-to-fit"
            )

    def _check_set(self, paths: Sequence[str]) -> None:
        """A parameter of all runs is not set for some."""
        for key in ("run", "modes", "static"):
            for part in getattr(self, key):
                for path in (*part.set, *(getattr(part, "before", None) or ())):
                    if path in paths:
                        raise SceneError(
                            f"{key}.set: {path!r} is sought as a parameter, and cannot be set for a part of the data; "
                            "say what differs by another number, such as a wrench, or link.NAME.end.mass beside a mass",
                            id="parameter-set",
                        )

    def __repr__(self) -> str:
        sought = ", ".join(parameter.path for parameter in self.parameter)
        return f"<FitProblem of {self.scene.name!r}: {sought}>"
