"""Frequency responses: from records or files, their variance, and their prediction by the linear model at rest.

    H(f) = C (iω − A)⁻¹ B + D,  ω = 2πf        σ² = (1 − γ²) / (2 n γ²) |H|²

σ is the standard deviation of the real and of the imaginary part of a response that is estimated from n averages with
coherence γ² (Bendat and Piersol, Random Data, 4th ed. 2010, section 9.2.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, vector
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import short_list
from flexlink.data.csv_table import head_of, named, read_csv
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.linear_model import LinearModel, OutputSource
from flexlink.dynamics.vibration.sensor_outputs import SensorOutputs
from flexlink.dynamics.vibration.steady import rest_of
from flexlink.identification.problem import FitFrf
from flexlink.motion.inputs.actuation import initial_wrench
from flexlink.motion.inputs.initial_state import initial_state

LEAST = 1e-3
"""Smallest standard deviation relative to the response: at coherence 1 the calibration of the instruments limits it."""


class Response(NamedTuple):
    """A measured frequency response in SI units."""

    f: Array  # frequencies [Hz], shape (k,)
    H: Complex  # response, shape (k,)
    σ: Array  # standard deviation of its real and of its imaginary part, shape (k,)
    coherence: Array  # coherence γ², shape (k,); nan where it is not given
    # input, output: names of the input and of the output, with SI units
    input: str
    output: str

    @property
    def name(self) -> str:
        """Output over input, with the unit of the response."""
        (output, unit), (of, per) = head_of(self.output), head_of(self.input)
        return f"{output} / {of} [{unit}/({per})]" if " " in per else f"{output} / {of} [{unit}/{per}]"


def predicted(scene: Scene, input: str, output: str, hertz: Array) -> Complex:
    """Response of an output to an input, at rest with the driven joints held at their angles, shape (k,)."""
    model = _model(scene, output)
    return np.asarray(model.frequency_response(hertz)[:, model.outputs.index(output), model.inputs.index(input)])


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
    """Read a measured response."""
    if part.file:
        _, heads, values, _ = read_csv(Path(part.file))
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
    if "real" in columns:
        H = columns["real"] + 1j * columns["imaginary"]
    else:
        H = columns["magnitude"] * np.exp(1j * columns["phase"])
        if (least := columns["magnitude"].min()) < 0:
            why = f"magnitude {least:.4g}: must not be negative; name a column in dB 'magnitude [dB]'"
            raise DataFileError(f"{where}: {why}", id="negative-magnitude")
    H = np.asarray(H * (of_output / of_input))
    γ2 = columns.get("coherence", np.full(len(H), np.nan))
    if not H.any():
        raise DataFileError(f"{where}: the response is zero at all frequencies", id="no-measured-values")
    smallest = 1e-6  # relative to the largest response, for the deviation of zeros
    size = np.maximum(np.abs(H), smallest * np.abs(H).max())
    return Response(columns["f"], H, _deviation(where, part, γ2) * size, γ2, input, output)


def table_of(where: str, columns: Mapping[str, tuple[float, ...]]) -> Array:
    """Values of columns, shape (rows, columns)."""
    lengths = {head: len(column) for head, column in columns.items()}
    if len(set(lengths.values())) != 1:
        raise DataFileError(f"{where}: columns of different lengths: {lengths}", id="one-per-row")
    return np.array(list(columns.values())).T


def _columns(where: str, heads: tuple[str, ...], values: Array, unit: str) -> dict[str, Array]:
    """Columns by quantity, in Hz, radians and the `unit` of the response."""
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
        text = f"columns {short_list(list(heads))}; expected 'f [Hz]', and magnitude and phase, or real and imaginary"
        raise DataFileError(f"{where}: {text}", id="no-such-column")
    f = found["f"][np.isfinite(found["f"])]
    if (f < 0).any() or (np.diff(f) <= 0).any():
        raise DataFileError(f"{where}: f [Hz]: expected increasing frequencies >= 0", id="frequencies-not-increasing")
    return found


def _deviation(where: str, part: FitFrf, γ2: Array) -> Array:
    """Standard deviation relative to the response, shape (k,)."""
    if part.averages is None:
        return np.full(len(γ2), part.deviation)
    wrong = γ2[~((γ2 > 0) & (γ2 <= 1))]
    if len(wrong):
        given = "missing" if np.isnan(wrong[0]) else f"{wrong[0]:g}"
        text = f"coherence {given}: expected numbers > 0 and <= 1; or remove averages and give deviation"
        raise DataFileError(f"{where}: {text}", id="coherence-range")
    return np.maximum(np.sqrt((1 - γ2) / (2 * part.averages * γ2)), LEAST)


def at_rest(scene: Scene) -> tuple[Chain, Equilibrium, dict[str, Any]]:
    """Chain of a scene, its static equilibrium, and the arguments `tip_wrench` and `frame` of its load."""
    chain = lump(scene)
    wrench, frame = initial_wrench(scene, chain)
    load: dict[str, Any] = {"tip_wrench": wrench, "frame": frame}
    return chain, rest_of(chain, initial_state(scene, chain)[0], **load), load


# Frequency response from records of an input and an output: the H1 estimate by Welch's method.
#
#     H = S_uy / S_uu        γ² = |S_uy|² / (S_uu S_yy)
#     n = K / (1 + 2 Σ_k (1 − k/K) c_k²),  c_k = Σ w_i w_{i+kD} / Σ w_i²
#
# S are averages over K segments with a Hann window w and half overlap D. Overlapping segments are correlated, so they
# are worth n independent averages (Welch 1967). Noise in y only does not bias H.


class FrequencyResponse(NamedTuple):
    """An estimated frequency response.

    Attributes
    ----------
    f
        Frequencies [Hz], shape (k,).
    H
        Response, in units of output over input, shape (k,).
    coherence
        Coherence γ², shape (k,).
    averages
        Number of independent averages.
    """

    f: Array
    H: Complex
    coherence: Array
    averages: float

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """Columns as `FitFrf` takes them."""
        parts = {"f [Hz]": self.f, "real": self.H.real, "imaginary": self.H.imag, "coherence": self.coherence}
        return {head: tuple(column.tolist()) for head, column in parts.items()}


def frequency_response(t: ArrayLike, u: ArrayLike, y: ArrayLike, *, segment: float) -> FrequencyResponse:
    """Estimate a frequency response from records of an input and an output (H1, Welch).

    Parameters
    ----------
    t
        Evenly spaced times, shape (n,) [s].
    u, y
        Input and output at these times, shape (n,).
    segment
        Length of a segment [s]. The frequencies are multiples of its inverse. A resonance of the damping ratio ζ needs
        several times 1/(2 ζ ω) to decay within a segment; longer segments leave fewer averages.

    Returns
    -------
    FrequencyResponse
        Response, coherence, and number of averages.

    Raises
    ------
    ArgumentError
        Arrays of different lengths, uneven times, or a segment longer than two thirds of the record.

    Examples
    --------
    >>> t = np.linspace(0.0, 100.0, 20_001)
    >>> u = np.random.default_rng(0).standard_normal(len(t))
    >>> found = fl.fits.frequency_response(t, u, 3.0 * u, segment=2.0)
    >>> print(np.round(abs(found.H[:3]), 6), round(found.averages))
    [3. 3. 3.] 94
    """
    times = vector("t", t, len(np.atleast_1d(np.asarray(t))))
    n, length = len(times), positive("segment", segment)
    inputs, outputs = vector("u", u, n), vector("y", y, n)
    between = np.diff(times)
    if n < 2 or not (between > 0).all() or np.ptp(between) > 1e-3 * between.mean():
        raise ArgumentError("t: expected two or more evenly spaced, increasing times", id="uneven-times")
    rate = (n - 1) / float(times[-1] - times[0])
    size = round(length * rate)
    if size < 4 or (n - size) // (size - size // 2) < 1:
        text = f"expected at least 4 samples, and at most two thirds of the record, {2 * n / (3 * rate):.3g} s"
        raise ArgumentError(f"segment = {length:g}: {text}", id="out-of-range")
    how = {"fs": rate, "window": "hann", "nperseg": size, "noverlap": size // 2}
    f, across = scipy.signal.csd(inputs, outputs, **how)
    of_input, of_output = scipy.signal.welch(inputs, **how)[1], scipy.signal.welch(outputs, **how)[1]
    known = (f > 0) & (of_input > 0) & (of_output > 0)
    coherence = np.abs(across[known]) ** 2 / (of_input[known] * of_output[known])
    return FrequencyResponse(f[known], across[known] / of_input[known], np.minimum(coherence, 1.0), _averages(n, size))


def _averages(samples: int, size: int) -> float:
    """Number of independent averages that half-overlapping segments are worth."""
    window, step = scipy.signal.get_window("hann", size), size - size // 2
    count = (samples - size) // step + 1
    total = 1.0
    for k in range(1, min(count, -(-size // step))):
        overlap = float(window[k * step :] @ window[: size - k * step]) / float(window @ window)
        total += 2 * (1 - k / count) * overlap**2
    return count / total
