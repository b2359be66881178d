"""Frequency responses: their files, their variance, and their prediction by the linear model at rest.

    H(f) = C (iω − A)⁻¹ B + D,  ω = 2πf        σ² = (1 − γ²) / (2 n γ²) |H|²

σ is the standard deviation of the real and of the imaginary part of a response that is estimated from n averages with
coherence γ² (Bendat and Piersol, Random Data, 4th ed. 2010, section 9.2.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import short_list
from flexlink.data.csv_table import head_of, read_csv
from flexlink.data.measured import named
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.sensors.outputs import SensorOutputs
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.linear_model import LinearModel
from flexlink.dynamics.vibration.outputs import OutputSource
from flexlink.identification.operating_point import at_rest
from flexlink.identification.problem import FitFrf

LEAST = 1e-3
"""Smallest standard deviation relative to the response: at coherence 1 the calibration of the instruments limits it."""


class Response(NamedTuple):
    """A measured frequency response in SI units.

    Attributes
    ----------
    f
        Frequencies [Hz], shape (k,).
    H
        Response, shape (k,).
    σ
        Standard deviation of its real and of its imaginary part, shape (k,).
    coherence
        Coherence γ², shape (k,); nan where it is not given.
    input, output
        Names of the input and of the output, with SI units.
    """

    f: Array
    H: Complex
    σ: Array
    coherence: Array
    input: str
    output: str

    @property
    def name(self) -> str:
        """Output over input, with the unit of the response."""
        (output, unit), (of, per) = head_of(self.output), head_of(self.input)
        return f"{output} / {of} [{unit}/({per})]" if " " in per else f"{output} / {of} [{unit}/{per}]"


def predicted(scene: Scene, input: str, output: str, hertz: Array) -> Complex:
    """Response of an output to an input, at rest with the driven joints held at their angles, shape (k,).

    Raises
    ------
    FlexlinkError
        There is no equilibrium, or the response is infinite.
    """
    model = _model(scene, output)
    H = model.frequency_response(hertz)
    return np.asarray(H[:, model.outputs.index(output), model.inputs.index(input)])


def _model(scene: Scene, output: str) -> LinearModel:
    chain, rest, load = at_rest(scene)
    sensors = [one.name for one in scene.sensor if output in column_names((one,), scene.arm)]
    kind: str | OutputSource = "state"
    if sensors:
        kind = SensorOutputs(scene, *sensors)
    elif output.startswith("tip "):
        kind = "tip_rate" if output.startswith("tip rate") else "tip"
    return linearize(chain, rest.q, tau=rest.tau, outputs=(kind,), tip_force=True, **load)


def measured_response(scene: Scene, part: FitFrf, where: str) -> Response:
    """Read a measured response.

    Raises
    ------
    DataFileError
        The file or its columns, or the names of input and output are wrong.
    """
    if part.file:
        _, heads, values = read_csv(Path(part.file))
    else:
        heads, values = tuple(part.columns), table_of(where, part.columns)
    known = [*column_names(scene.sensor, scene.arm)]
    known += [name for kind in ("tip ", "tip rate ", "") for name in _model(scene, kind).outputs]
    input, of_input = named(f"{where}: input", part.input, dict.fromkeys(_model(scene, "").inputs))
    output, of_output = named(f"{where}: output", part.output, dict.fromkeys(known))
    columns = _columns(where, heads, values, f"{head_of(part.output)[1]}/{head_of(part.input)[1]}")
    low, high = part.band or (0.0, np.inf)
    needed = [columns[name] for name in columns if name != "coherence" or part.averages is not None]
    kept = np.isfinite(needed).all(axis=0) & (columns["f"] >= low) & (columns["f"] <= high)
    if not kept.any():
        raise DataFileError(f"{where}: no values from {low:g} to {high:g} Hz", id="no-measured-values")
    columns = {name: column[kept] for name, column in columns.items()}
    H = _complex(columns) * (of_output / of_input)
    γ2 = columns.get("coherence", np.full(len(H), np.nan))
    if not H.any():
        raise DataFileError(f"{where}: the response is zero at all frequencies", id="no-measured-values")
    smallest = 1e-6  # relative to the largest response, for the deviation of zeros
    size = np.maximum(np.abs(H), smallest * np.abs(H).max())
    return Response(columns["f"], H, _deviation(where, part, γ2) * size, γ2, input, output)


def table_of(where: str, columns: Mapping[str, tuple[float, ...]]) -> Array:
    """Values of columns, shape (rows, columns).

    Raises
    ------
    DataFileError
        The columns have different lengths.
    """
    lengths = {head: len(column) for head, column in columns.items()}
    if len(set(lengths.values())) != 1:
        raise DataFileError(f"{where}: columns of different lengths: {lengths}", id="one-per-row")
    return np.array(list(columns.values())).T


def _columns(where: str, heads: tuple[str, ...], values: Array, unit: str) -> dict[str, Array]:
    """Columns by quantity, in Hz, radians and the `unit` of the response.

    Raises
    ------
    DataFileError
        A header is unknown, or has another unit; frequencies do not increase.
    """
    allowed = {
        "f": ("Hz",), "magnitude": ("", unit, "dB"), "phase": ("deg", "rad"), "real": ("", unit),
        "imaginary": ("", unit), "coherence": ("", "1"),
    }  # fmt: skip
    found = {}
    for head, column in zip(heads, values.T, strict=True):
        quantity, given = head_of(head)
        if quantity not in allowed or given not in allowed[quantity] or quantity in found:
            text = "twice" if quantity in found else "unknown"
            shown = short_list([f"{name} [{units[-1]}]" for name, units in allowed.items()])
            raise DataFileError(f"{where}: column {head!r}: {text}; expected {shown}", id="no-such-column")
        value = column if given != "dB" else 10 ** (column / 20)
        found[quantity] = np.deg2rad(value) if given == "deg" else value
    if "f" not in found or (not {"magnitude", "phase"} <= found.keys() and not {"real", "imaginary"} <= found.keys()):
        raise DataFileError(
            f"{where}: columns {short_list(list(heads))}; expected 'f [Hz]', and magnitude and phase, or real and "
            "imaginary", id="no-such-column",
        )  # fmt: skip
    f = found["f"][np.isfinite(found["f"])]
    if (f < 0).any() or (np.diff(f) <= 0).any():
        raise DataFileError(f"{where}: f [Hz]: expected increasing frequencies >= 0", id="frequencies-not-increasing")
    return found


def _complex(columns: Mapping[str, Array]) -> Complex:
    if "real" in columns:
        return np.asarray(columns["real"] + 1j * columns["imaginary"])
    return np.asarray(columns["magnitude"] * np.exp(1j * columns["phase"]))


def _deviation(where: str, part: FitFrf, γ2: Array) -> Array:
    """Standard deviation relative to the response, shape (k,)."""
    if part.averages is None:
        return np.full(len(γ2), part.deviation)
    wrong = γ2[~((γ2 > 0) & (γ2 <= 1))]
    if len(wrong):
        given = "missing" if np.isnan(wrong[0]) else f"{wrong[0]:g}"
        raise DataFileError(
            f"{where}: coherence {given}: expected numbers > 0 and <= 1; or remove averages and give deviation",
            id="coherence-range",
        )
    return np.maximum(np.sqrt((1 - γ2) / (2 * part.averages * γ2)), LEAST)
