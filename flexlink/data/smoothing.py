"""Rates and accelerations of measured angles, from a zero-phase low-pass filter that is differentiated exactly.

The smoothing spline f of degree 5 of angles y at times t minimizes Σ w_k (y_k − f(t_k))² + λ ∫ f‴² dt. The weight w_k
is the time interval of a sample; λ = (2π cutoff)⁻⁶. The gain at frequency f is 1 / (1 + (f/cutoff)⁶), without delay, as
for a third-order Butterworth filter run forward and backward. The gain is 50 % at the cutoff, 98 % at half of it and
99.9 % at a third of it. Parabolas are unchanged, even at both ends of the record.
(Schoenberg 1964; Eilers & Marx 1996 for the B-spline basis)

The cutoff "auto" minimizes the generalized cross-validation, which estimates the error in predicting left-out samples,

    GCV = (1/n) Σ (y_k − f(t_k))² / (1 − p/n)²,    p = 3 + 2 T cutoff (π/6)/sin(π/6)

p is the number of free parameters of f, the integral of the gain over all frequencies. (Woltring 1986)
"""

import math

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array

AUTO = "auto"  # instead of a cutoff: the cutoff with the least generalized cross-validation


def best_cutoff(t: Array, y: Array) -> float:
    """Cutoff [Hz], at most 0.45 of the sampling rate, with the least generalized cross-validation, within 5 %."""
    length, spacing = float(t[-1] - t[0]), float(np.diff(t).max())
    highest = 0.45 / spacing
    tried = np.geomspace(min(2 / length, highest), highest, max(int(np.log(length * highest) / np.log(1.05)), 2))
    free = 3 + 2 * length * tried * (math.pi / 6) / math.sin(math.pi / 6)
    errors = np.array([float(np.mean((y - smoothed(t, y, float(cutoff))[0]) ** 2)) for cutoff in tried])
    share = np.maximum(1 - free / len(t), 1e-3)
    return float(f"{tried[np.argmin(errors / share**2)]:.3g}")


def noise_of(y: Array) -> float:
    """Standard deviation of white noise in y (samples,), from third differences, which are small in smooth motion."""
    return float(np.sqrt(np.mean(np.diff(y, 3) ** 2) / 20)) if len(y) > 3 else 0.0


def smoothed(t: Array, y: Array, cutoff: float | str) -> tuple[Array, Array, Array]:
    """Low-pass filtered values, rates and accelerations (samples,) of y (samples,) at times t [s]; `cutoff` in Hz.

    The cutoff "auto" is `best_cutoff`.
    """
    # with fewer samples, the smoothing spline could only be a parabola
    fewest = 5
    if len(t) < fewest:
        text = f"cutoff = {cutoff!r}: {len(t)} samples are too few; expected {fewest} or more"
        raise SceneError(text, id="too-few-samples")
    spacing, cutoff = float(np.diff(t).max()), best_cutoff(t, y) if isinstance(cutoff, str) else cutoff
    if 2 * spacing * cutoff >= 1:
        hint = "; if the times are in ms, name the column t [ms]" * (spacing >= 1)
        why = f"expected less than {0.5 / spacing:.6g} Hz, half the sampling rate{hint}"
        raise SceneError(f"cutoff = {cutoff!r}: samples are up to {spacing:.6g} s apart; {why}", id="cutoff-too-high")
    from scipy.interpolate import BSpline  # noqa: PLC0415  slow to import: 0.1 s
    from scipy.linalg import solveh_banded  # noqa: PLC0415

    unit, degree, penalty = 1 / (2 * math.pi * cutoff), 5, 3
    # Smallest knot spacing as a fraction of 1 / (2π cutoff): accelerations in the pass band are then accurate to 1e-5,
    # and the equations, with a condition number of up to near⁻⁶, keep eleven digits. Sites are times this far apart.
    near = 0.2
    x = t / unit
    sites = x[np.flatnonzero(np.diff(np.floor((x - x[0]) / near), prepend=-1.0) > 0)]
    sites = np.append(sites[: max(1, int(np.searchsorted(sites, x[-1] - near, side="right")))], x[-1])
    knots = np.concatenate([[sites[0]] * degree, sites, [sites[-1]] * degree])
    weights = np.gradient(x)
    weights[[0, -1]] /= 2
    B = BSpline.design_matrix(x, knots, degree)
    matrix = B.T @ B.multiply(weights[:, None]) + _penalty(knots, sites, degree, penalty)
    bands = np.zeros((degree + 1, matrix.shape[0]))
    for k in range(degree + 1):
        bands[k, : matrix.shape[0] - k] = matrix.diagonal(-k)
    spline = BSpline(knots, solveh_banded(bands, B.T @ (weights * y), lower=True), degree)
    return tuple(np.asarray(spline(x, nu=k)) / unit**k for k in range(3))  # type: ignore[return-value]


def _penalty(knots: Array, sites: Array, highest: int, penalty: int):  # type: ignore[no-untyped-def]  # SciPy sparse
    """∫ B_i‴ B_j‴ dt of B-splines B_i, exact with three Gauss points per interval, where each B_i‴ is a parabola."""
    from scipy.interpolate import BSpline  # noqa: PLC0415
    from scipy.sparse import diags_array  # noqa: PLC0415

    slopes, inner = None, knots
    for degree in range(highest, highest - penalty, -1):
        count = len(inner) - degree - 1  # number of coefficients before differentiation
        each = degree / (inner[degree + 1 : degree + count] - inner[1:count])
        step = diags_array([-each, each], offsets=[0, 1], shape=(count - 1, count))
        slopes, inner = step if slopes is None else step @ slopes, inner[1:-1]
    nodes, weights = np.polynomial.legendre.leggauss(penalty)
    half = np.diff(sites)[:, None] / 2
    x = (sites[:-1, None] + half * (1 + nodes)).ravel()
    third = BSpline.design_matrix(x, inner, highest - penalty) @ slopes
    return third.T @ third.multiply((half * weights).ravel()[:, None])
