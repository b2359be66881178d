"""Runs of a laboratory's two-link flexible arm (2DSFL), and a linear model fitted for comparison.

The recordings (MIT licence) are not part of the project; they are read from ../shared/measured, next to the checkout.
"""

from __future__ import annotations

import csv
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import butter, cont2discrete, lfilter

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.motion.simulate import simulate
from validation.sources import ROOT

FOLDER = ROOT.parent / "shared" / "measured"
HEADS = {"q1 [deg]": "q one [deg]", "q2 [deg]": "q two [deg]"}  # column names of the recording → of the scene's run
STRAINS = ("strain angle 1 [deg]", "strain angle 2 [deg]")
LINKS = ("one", "two")
CUTOFF = 15.0  # Hz, of the low-pass filter for the recorded angles, whose motion is below 3 Hz
LOW_PASS, ORDER = 2.0, 2  # cutoff [Hz] and order of the recorder's filter of strains
SETTLED = 1.2  # start of the windows [s], where the first run's record of strain 1 starts


class Window(NamedTuple):
    """A part of a recording: its name, the recording and the times [s]."""

    name: str
    run: str
    start: float
    end: float

    def of(self, t: Array) -> Array:
        """Mask of the samples within the window."""
        return np.asarray((t >= self.start - 1e-9) & (t <= self.end + 1e-9))


FITTED = Window("psf, first half", "psf", SETTLED, 10.0)
HELD_OUT = (Window("psf, second half", "psf", 10.0, 19.6), Window("fsf", "fsf", SETTLED, 19.4))


def recorded(run: str) -> dict[str, Array]:
    """Columns of a recording; angles have the scene's names.

    Raises
    ------
    DataFileError
        The recording is missing; it is expected next to the checkout.
    """
    path = FOLDER / f"2dsfl_{run}.csv"
    try:
        heads, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    table = np.array(rows, dtype=np.float64)
    return {HEADS.get(head, head): column for head, column in zip(heads, table.T, strict=True)}


def write_renamed(run: str, folder: Path) -> Path:
    """Write a recording with the scene's column names, for prescribed motions."""
    columns = recorded(run)
    path = folder / f"{run}.csv"
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def led_by(path: Path) -> list[dict[str, object]]:
    """Prescribed motions of both joints, from a file of `write_renamed`."""
    return [{"link": link, "file": str(path), "cutoff": CUTOFF} for link in LINKS]


def simulated(scene: Scene, run: str, end: float) -> tuple[Mapping[str, Array], Array]:
    """Run the scene with the recorded angles: its columns, and the angles' accelerations (samples, 2) [rad/s²]."""
    with tempfile.TemporaryDirectory() as folder:
        led = scene.varied({"motion": led_by(write_renamed(run, Path(folder))), "run.duration": end})
    found = simulate(led)
    joints = [found.chain.joint_names.index(link) for link in LINKS]
    return found.columns, np.asarray(CubicSpline(found.t, found.qd[:, joints])(found.t, 1))


def fit_percent(measured: Array, model: Array) -> float:
    """100 (1 − ‖measured − model‖ / ‖measured‖): 100 is perfect, 0 is no better than predicting zero."""
    return float(100 * (1 - np.linalg.norm(measured - model) / np.linalg.norm(measured)))


class LinearModel(NamedTuple):
    """Two modes, driven from rest by the joints' accelerations u; the recorder's low-pass filter is applied to both.

    z̈_ju + 2 ζ_j ω_j ż_ju + ω_j² z_ju = u for mode j and each input u; strain c is y_c = Σ_ju b_cju z_ju + d_c. The 12
    parameters are ω and ζ of the two modes, and b; with the offsets d of the strains there are 14.
    """

    poles: Array  # log ω, ζ of each mode
    weights: Array  # (inputs × modes, strains); an optional last row contains the offsets

    def strains(self, u: Array, h: float) -> Array:
        """Both strains (samples, 2)."""
        shapes = _shapes(self.poles, u, h)
        return np.asarray(_with_ones(shapes, len(self.weights) > shapes.shape[1]) @ self.weights)


def linear_model(
    u: Array, measured: Sequence[Array], h: float, there: Array, start: Sequence[float], *, zeros: bool = False
) -> LinearModel:
    """Fit the model to the samples where `there` is true; initial frequencies are `start` [Hz]."""
    y = np.column_stack(measured)[there]
    begin = np.array([[math.log(2 * math.pi * f), 0.015] for f in start]).ravel()

    def shapes(p: Array) -> Array:
        return _with_ones(_shapes(p, u, h)[there], zeros)

    def weights(p: Array) -> Array:
        return np.asarray(np.linalg.lstsq(shapes(p), y, rcond=None)[0])

    def residual(p: Array) -> Array:
        return np.asarray((shapes(p) @ weights(p) - y).ravel())

    low, high = begin - np.tile([0.3, 0.014], len(start)), begin + np.tile([0.3, 0.2], len(start))
    best = least_squares(residual, begin, bounds=(low, high), x_scale=np.tile([0.01, 0.005], len(start))).x
    return LinearModel(best, weights(best))


def _with_ones(shapes: Array, zeros: bool) -> Array:
    return np.column_stack([shapes, np.ones(len(shapes))]) if zeros else shapes


def _shapes(p: Array, u: Array, h: float) -> Array:
    """Low-pass filtered response of each mode to each input (samples, inputs × modes)."""
    smooth = butter(ORDER, LOW_PASS, fs=1 / h)
    columns = []
    for log_rate, ratio in p.reshape(-1, 2):
        ω = math.exp(log_rate)
        b, a, _ = cont2discrete(([1.0], [1.0, 2 * ratio * ω, ω**2]), h, method="foh")
        columns += [lfilter(*smooth, lfilter(b.ravel(), a, column)) for column in u.T]
    return np.column_stack(columns)
