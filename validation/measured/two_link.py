"""Runs of a laboratory's two-link flexible arm (2DSFL), and a linear model fitted for comparison."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter

import flexlink as fl
from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.identification.coordinates import coordinates_of
from flexlink.identification.data import sources_of
from flexlink.identification.fitted import Fitted
from flexlink.identification.interval import spread_at
from flexlink.identification.problem import FitParameter, FitProblem
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Search
from flexlink.identification.systematic import covariance_of
from flexlink.motion.simulate import simulate
from validation.measured.readings import FittedInputs
from validation.sources import ROOT

STRAINS = ("strain angle 1 [deg]", "strain angle 2 [deg]")
LINKS = ("one", "two")
CUTOFF = 15.0  # Hz, of the low-pass filter for the recorded angles, whose motion is below 3 Hz
ALIKE = 0.1  # assumed noise of both strains [deg]; it is equal, so both have equal weight, as in the linear model


class Window(Spec, frozen=True):
    """A part of a recording: its name, the recording's file, from the checkout's folder, and the times [s]."""

    name: str
    recording: str
    start: float
    end: float

    def of(self, t: Array) -> Array:
        """Mask of the samples within the window."""
        return np.asarray((t >= self.start - 1e-9) & (t <= self.end + 1e-9))


class Split(Spec, frozen=True):
    """Data to identify parameters on, and data held out.

    `numbers` are values by path that differ from the scene, such as the parameters identified on these data; `start`
    are initial guesses that differ from those of the case.
    """

    fitted: Window
    held_out: tuple[Window, ...]
    numbers: dict[str, int | float] = msgspec.field(default_factory=dict)
    start: dict[str, float] = msgspec.field(default_factory=dict)

    @property
    def windows(self) -> tuple[Window, ...]:
        """All windows, the fitted one first."""
        return (self.fitted, *self.held_out)

    def identified(self, scene: Scene, sought: Sequence[FitParameter]) -> Fitted:
        """Identify the parameters of the scene, gains and offsets of both strains, from the fitted window."""
        # `fit, changed by a finer grid` measures the error of the grid
        return fl.fit(self._problem(scene, sought), grid="ignore")

    def uncertain(self, scene: Scene, sought: Sequence[FitParameter]) -> FittedInputs:
        """Covariance of the parameters as `fl.fit` states it, at the scene's values, which are its solution.

        Errors of the grid and of the recorded motions, which `fl.fit` adds, are left out.
        """
        values = np.array([scene.values_at(one.path)[0] for one in sought])
        there = [msgspec.structs.replace(one, start=float(x)) for one, x in zip(sought, values, strict=True)]
        problem = self._problem(scene, there)
        coordinates, sources = coordinates_of(problem), sources_of(problem, "fit")
        x = np.array([one.x(one.start) for one in coordinates])
        at = Search(Signals(sources, coordinates), problem.loss).at(x, [one.blocks for one in sources])
        spread = spread_at(at)
        n = len(values)
        covariance = covariance_of(coordinates, x, spread.covariance, ())[:n, :n]
        return FittedInputs([one.path for one in sought], values, covariance)

    def _problem(self, scene: Scene, sought: Sequence[FitParameter]) -> FitProblem:
        guesses = (msgspec.structs.replace(one, start=self.start.get(one.path, one.start)) for one in sought)
        recording = fl.fits.FitRun(
            name=self.fitted.name,
            file=str(ROOT / self.fitted.recording),
            window=(self.fitted.start, self.fitted.end),
            compare=STRAINS,
            gain=STRAINS,
            bias=STRAINS,
            noise=dict.fromkeys(STRAINS, ALIKE),
            set={"motion": led_by(self.fitted.recording), "run.duration": self.fitted.end},
        )
        return fl.fits.FitProblem(scene=scene, parameter=tuple(guesses), run=(recording,), noise="white")


def recorded(recording: str) -> dict[str, Array]:
    """Columns of a recording, a path from the checkout's folder.

    Raises
    ------
    DataFileError
        The recording cannot be read.
    """
    path = ROOT / recording
    try:
        heads, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    return dict(zip(heads, np.array(rows, dtype=np.float64).T, strict=True))


def led_by(recording: str) -> list[dict[str, object]]:
    """Prescribed motions of both joints, from a recording."""
    return [{"link": link, "file": str(ROOT / recording), "cutoff": CUTOFF} for link in LINKS]


def simulated(scene: Scene, recording: str, end: float) -> tuple[Mapping[str, Array], Array]:
    """Run the scene with the recorded angles: its columns, and the angles' accelerations (samples, 2) [rad/s²]."""
    found = simulate(scene.varied({"motion": led_by(recording), "run.duration": end}))
    joints = [found.chain.joint_names.index(link) for link in LINKS]
    return found.columns, np.asarray(CubicSpline(found.t, found.qd[:, joints])(found.t, 1))


def with_sensors(scene: Scene, found: Fitted) -> Scene:
    """The fitted scene, with the gains and offsets of the fit in its sensors."""
    changes: dict[str, Any] = {}
    for sensor, column in zip(scene.sensor, found.columns, strict=True):
        changes[f"sensor.{sensor.name}.gain"] = column.gain * sensor.gain
        changes[f"sensor.{sensor.name}.bias"] = column.gain * sensor.bias + column.bias
    return found.scene.varied(changes)


def fit_percent(measured: Array, model: Array) -> float:
    """100 (1 − ‖measured − model‖ / ‖measured‖): 100 is perfect, 0 is no better than predicting zero."""
    return float(100 * (1 - np.linalg.norm(measured - model) / np.linalg.norm(measured)))


class Recorder(NamedTuple):
    """The recorder's low-pass filter of strains, ω²/(s² + 2 ζ ω s + ω²) with ω = 2π hertz, and its sampling step."""

    hertz: float
    ratio: float
    h: float

    @classmethod
    def of(cls, scene: Scene, h: float) -> Recorder:
        """Filter of the scene's first sensor."""
        sensor = scene.sensor[0]
        return cls(sensor.low_pass or math.nan, sensor.damping or math.nan, h)

    def filtered(self, u: Array) -> Array:
        """Filtered signal (samples,), from rest; exact for a signal that is linear between samples."""
        ω = 2 * math.pi * self.hertz
        return self.responded(u, (ω**2,), ω, self.ratio)

    def responded(self, u: Array, numerator: Sequence[float], ω: float, ratio: float) -> Array:
        """Response of numerator / (s² + 2 ratio ω s + ω²) to a signal that is linear between samples."""
        b, a, _ = cont2discrete((numerator, (1.0, 2 * ratio * ω, ω**2)), self.h, method="foh")
        return np.asarray(lfilter(b.ravel(), a, u))


class LinearModel(NamedTuple):
    """Two modes, driven from rest by the joints' accelerations u; the recorder's low-pass filter is applied to both.

    z̈_ju + 2 ζ_j ω_j ż_ju + ω_j² z_ju = u for mode j and each input u; strain c is y_c = Σ_ju b_cju z_ju + d_c. The 12
    parameters are ω and ζ of the two modes, and b; with the offsets d of the strains there are 14.
    """

    poles: Array  # log ω, ζ of each mode
    weights: Array  # (inputs × modes, strains); an optional last row contains the offsets

    def strains(self, u: Array, recorder: Recorder) -> Array:
        """Both strains (samples, 2)."""
        shapes = _shapes(self.poles, _smooth(u, recorder), recorder)
        return np.asarray(_with_ones(shapes, len(self.weights) > shapes.shape[1]) @ self.weights)


def linear_model(
    u: Array,
    measured: Sequence[Array],
    recorder: Recorder,
    there: Array,
    start: Sequence[float],
    *,
    zeros: bool = False,
) -> LinearModel:
    """Fit the model to the samples where `there` is true; initial frequencies are `start` [Hz]."""
    y = np.column_stack(measured)[there]
    begin, smooth = np.array([[math.log(2 * math.pi * f), 0.015] for f in start]).ravel(), _smooth(u, recorder)

    def shapes(p: Array) -> Array:
        return _with_ones(_shapes(p, smooth, recorder)[there], zeros)

    def weights(p: Array) -> Array:
        return np.asarray(np.linalg.lstsq(shapes(p), y, rcond=None)[0])

    def residual(p: Array) -> Array:
        return np.asarray((shapes(p) @ weights(p) - y).ravel())

    low, high = begin - np.tile([0.3, 0.014], len(start)), begin + np.tile([0.3, 0.2], len(start))
    best = least_squares(residual, begin, bounds=(low, high), x_scale=np.tile([0.01, 0.005], len(start))).x
    return LinearModel(best, weights(best))


def _with_ones(shapes: Array, zeros: bool) -> Array:
    return np.column_stack([shapes, np.ones(len(shapes))]) if zeros else shapes


def _smooth(u: Array, recorder: Recorder) -> Array:
    """Low-pass filtered inputs (inputs, samples)."""
    return np.array([recorder.filtered(column) for column in u.T])


def _shapes(p: Array, smooth: Array, recorder: Recorder) -> Array:
    """Response of each mode to each filtered input (samples, inputs × modes)."""
    modes = [recorder.responded(smooth, (1.0,), math.exp(log_rate), ratio) for log_rate, ratio in p.reshape(-1, 2)]
    return np.vstack(modes).T
