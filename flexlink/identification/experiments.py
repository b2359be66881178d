"""Experiments that could be added to a fit problem, read from TOML: built-in ones and those of a user's file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

import msgspec

from flexlink.common.errors import SceneError, errors_at
from flexlink.data.documents import read_toml, require_path
from flexlink.describe import spec
from flexlink.describe.spec import Deviation, Positive, Spec, Vector3


class Experiment(Spec, frozen=True):
    """What all experiments have."""

    name: str
    """Name of the experiment or instrument, in messages."""
    reason: str
    """Reason for the assumed deviation, such as the kind of instrument, or for the motion."""


class ColumnExperiment(Experiment, frozen=True):
    """One more column in a repeat of a recorded run: a column of every run, or the readings of a new sensor."""

    columns: str = ""
    """Regular expression for the names of columns of runs."""
    sensor: dict[str, Any] = msgspec.field(default_factory=dict)
    """Keys of a sensor without `name` and `link`; it is tried on every link. Gauges are at the outermost fibres."""
    places: tuple[Annotated[float, msgspec.Meta(ge=0, le=1)], ...] = ()
    """For a sensor: positions along each link, as fractions of its length [1]. Default: its `x`, or the end."""
    noise: Deviation | None = None
    """Standard deviation of the noise, in the unit of the column."""
    share: Deviation | None = None
    """Standard deviation of the noise as a fraction of the largest value [1], instead of `noise`."""
    gain: bool = False
    """Whether the scale of the column is unknown."""
    bias: bool = False
    """Whether the offset of the column is unknown."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.columns) == bool(self.sensor):
            raise SceneError(f"columns = {self.columns!r}: specify either columns or a sensor", id="both-given")
        if (self.noise is None) == (self.share is None):
            raise SceneError(f"noise = {self.noise!r}: specify either noise or share", id="both-given")
        _check_pattern("columns", self.columns)


class StaticExperiment(Experiment, frozen=True):
    """Change of the tip's position under a known weight, with all driven joints locked."""

    deviation: Deviation
    """Standard deviation of the change [m]."""
    kilograms: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)]
    """Available masses [kg]; the heaviest one that moves the tip by at most `largest` is used."""
    largest: Positive = 0.03
    """Largest change, as a fraction of the arm's reach [1]."""


class ModesExperiment(Experiment, frozen=True):
    """Natural frequencies from a tap test at rest."""

    share: Deviation
    """Standard deviation of a frequency as a fraction of the frequency [1]."""
    count: Annotated[int, msgspec.Meta(ge=1)] = 3
    """Number of frequencies [1], slowest first; fewer if the arm has fewer elastic modes."""
    ratio_share: Deviation | None = None
    """Standard deviation of the damping ratios as a fraction of their values [1]. Default: not measured."""
    free: bool = False
    """Whether the driven joints are free. Default: locked."""
    kilograms: tuple[Positive, ...] = ()
    """Masses that can be clamped to the end of the last link [kg]; the heaviest one up to half the arm's mass is used.
    Default: none."""


class MotionExperiment(Experiment, frozen=True):
    """Another motion, recorded with the columns of a run of the problem."""

    scale: dict[str, Any] = msgspec.field(default_factory=dict)
    """Factors of numbers or of lists of numbers, by path. "{link}" in a path is each driven link in turn."""
    add: dict[str, float] = msgspec.field(default_factory=dict)
    """Numbers to be added, by path."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Values by path."""
    tilt_deg: Vector3 = (0.0, 0.0, 0.0)
    """Rotation of the base relative to gravity, as a vector in frame 0 [deg]."""
    longer: Positive = 1.0
    """Length of the record, as a multiple of the length of the problem's run [1]."""
    kilograms: tuple[Positive, ...] = ()
    """Masses that can be clamped to the end of the last link [kg], as in a tap test. Default: none."""


class PriorExperiment(Experiment, frozen=True):
    """Measurement of a sought parameter itself, which becomes its prior."""

    paths: str
    """Regular expression for the paths of parameters that can be measured in this way."""
    deviation: Deviation | None = None
    """Standard deviation, in the unit of the parameter."""
    share: Deviation | None = None
    """Standard deviation as a fraction of the value [1], instead of `deviation`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.deviation is None) == (self.share is None):
            raise SceneError(f"deviation = {self.deviation!r}: specify either deviation or share", id="both-given")
        _check_pattern("paths", self.paths)


class Experiments(Spec, frozen=True):
    r"""Experiments to compare, as tables of a TOML file.

    Examples
    --------
    >>> weigh = {"name": "weigh", "reason": "laboratory balance", "paths": r".*\.mass", "deviation": 0.002}  # kg
    >>> more = fl.fits.Experiments(prior=(weigh,))
    >>> print(more.prior[0].name)
    weigh
    """

    column: tuple[ColumnExperiment, ...] = ()
    """Additional columns, `[[column]]` in a file."""
    static: tuple[StaticExperiment, ...] = ()
    """Static deflections, `[[static]]` in a file."""
    modes: tuple[ModesExperiment, ...] = ()
    """Tap tests, `[[modes]]` in a file."""
    motion: tuple[MotionExperiment, ...] = ()
    """Other motions, `[[motion]]` in a file."""
    prior: tuple[PriorExperiment, ...] = ()
    """Measurements of a parameter itself, `[[prior]]` in a file."""

    @classmethod
    def load(cls, path: str | Path) -> Experiments:
        r"""Read experiments from a TOML file.

        Parameters
        ----------
        path
            A TOML file with tables `[[column]]`, `[[static]]`, `[[modes]]`, `[[motion]]` and `[[prior]]`.

        Returns
        -------
        Experiments
            The experiments.

        Raises
        ------
        ArgumentError
            `path` is not a path.
        SceneError
            The file is invalid; the message names the file, the key path, the value and the allowed values.

        Examples
        --------
        >>> with open("mine.toml", "w") as file:
        ...     _ = file.write("[[prior]]\nname = 'weigh'\nreason = 'balance'\npaths = '.*mass'\ndeviation = 0.002\n")
        >>> print(fl.fits.Experiments.load("mine.toml").prior[0].deviation)
        0.002
        """
        path = require_path("path", path)
        raw = read_toml(path)
        with errors_at(f"{path}: "):
            kinds = {field.encode_name: field.type for field in spec.fields_of(cls)}
            spec.check_keys(raw, kinds, required=())
            spec.raise_together(wrong for key, value in raw.items() for wrong in spec.mistakes(value, kinds[key], key))
            return spec.decode(raw, cls)


def _check_pattern(key: str, pattern: str) -> None:
    try:
        re.compile(pattern)
    except re.error as error:
        raise SceneError(f"{key} = {pattern!r}: not a regular expression: {error}", id="wrong-value") from None
