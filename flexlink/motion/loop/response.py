"""Frequency response of a loop that is broken at one input, and its margins.

    L(ω) = −(transfer function from the torque that acts to the torque that the law computes)

with all other inputs closed, at z = e^{iωT}, or at s = iω for a continuous law. The loop is stable up to a gain factor
1/|L| where L < 0, and up to a phase lag of π + arg L where |L| = 1. With S = 1/(1 + L), the sensitivity peak is max |S|
and the disk margin α = 2 / max |2 S − 1|: gain and phase may change together by any factor within the disk whose real
points are (2 − α)/(2 + α) and (2 + α)/(2 − α) (Seiler, Packard and Gahinet, IEEE Control Systems 40(5), 2020).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.types import Array, Complex
from flexlink.motion.loop.law import LinearLaw, OpenLoop


class Margins(NamedTuple):
    """Margins of a stable loop broken at one input; all are nan if the loop is unstable."""

    input: str  # name of the input, such as "tau upper [N m]"
    gain: tuple[float, float]  # factors of the torque between which the loop remains stable, such as (0, 3.2)
    phase: float  # smallest phase shift that makes the loop unstable [deg]; inf if none does
    delay: float  # smallest additional delay of this input that makes the loop unstable [s]; inf if none does
    disk: float  # disk margin α
    bandwidth: float  # highest frequency at which |L| = 1 [Hz]; nan if |L| < 1 everywhere
    sensitivity: float  # largest |S| = |1/(1 + L)|


class Response:
    """L(ω) of a loop broken at input `i`, computed from a Schur decomposition."""

    def __init__(self, plant: OpenLoop, law: LinearLaw, i: int) -> None:
        T, U = scipy.linalg.schur(plant.closed(law, broken=i), output="complex")
        self._T, self.period, b = T, plant.period, np.concatenate([plant.B[:, i], np.zeros(len(law.F))])
        self._b, self._c = U.conj().T @ b, -plant.feedback(law)[i] @ U

    def __call__(self, ω: Array) -> Complex:
        """L at angular frequencies ω, shape (k,) [rad/s]."""
        s = np.exp(1j * ω * self.period) if self.period else 1j * ω
        x = np.empty((len(self._T), len(ω)), complex)
        with np.errstate(divide="ignore", invalid="ignore"):  # at a pole
            for k in range(len(x) - 1, -1, -1):
                x[k] = (self._b[k] + self._T[k, k + 1 :] @ x[k + 1 :]) / (s - self._T[k, k])
        return np.asarray(self._c @ x)

    def grid(self) -> Array:
        """Angular frequencies that resolve every resonance, up to half the sampling rate, shape (k,) [rad/s]."""
        # relative distances from a pole at which L is evaluated, and the span of the grid beyond the slowest pole
        near, below, poles = np.logspace(-9, -0.5, 35), 1e-3, np.diag(self._T)
        if self.period:
            poles = np.log(poles[np.abs(poles) > 1e-6]) / self.period
        ω, σ = np.abs(poles.imag), np.abs(poles)
        top = np.pi / self.period if self.period else 1e3 * max(σ.max(initial=1.0), 1.0)
        low = below * min(σ[σ > 1e-9 * top].min(initial=top), top)
        spread = [ω, σ] + [each * (1.0 + sign * d) for each in (ω, σ) for d in near for sign in (1.0, -1.0)]
        every = np.unique(np.concatenate([np.geomspace(low, top, 600), *spread]))
        return np.asarray(every[(every >= low) & (every <= top)])


def classical_margins(L: Response, name: str) -> Margins:
    """Margins from the crossings of L; the delay margin is that of a pure time shift, (π + arg L)/ω."""
    ω = L.grid()
    values = L(ω)
    good = np.isfinite(values)
    ω, values = ω[good], values[good]

    def at(x: float) -> complex:
        return complex(L(np.array([x]))[0])

    unit = [float(x) for x in _roots(lambda x: float(np.log(abs(at(x)))), ω, np.log(np.abs(values)))]
    real = [x for x in _roots(lambda x: at(x).imag, ω, values.imag) if at(x).real < 0 and abs(at(x).imag) < 1e-3]
    real += [float(ω[k]) for k in (0, -1) if values[k].real < 0 and abs(values[k].imag) < 1e-9 * abs(values[k])]
    sizes = [abs(at(x)) for x in real]
    lags = [float(np.angle(-at(x)) % (2 * np.pi)) for x in unit]
    return Margins(
        name,
        gain=(max([1 / s for s in sizes if s > 1], default=0.0), min([1 / s for s in sizes if s <= 1], default=np.inf)),
        phase=float(np.degrees(min([min(lag, 2 * np.pi - lag) for lag in lags], default=np.inf))),
        delay=min([lag / x for lag, x in zip(lags, unit, strict=True)], default=np.inf),
        disk=2 / _peak(lambda x: abs(2 / (1 + at(x)) - 1), ω, np.abs(2 / (1 + values) - 1)),
        bandwidth=max(unit, default=np.nan) / (2 * np.pi),
        sensitivity=_peak(lambda x: abs(1 / (1 + at(x))), ω, np.abs(1 / (1 + values))),
    )


def _roots(f: Callable[[float], float], ω: Array, values: Array) -> list[float]:
    """Frequencies between neighbours of opposite sign at which f is zero."""
    return [_root(f, float(ω[k]), float(ω[k + 1])) for k in np.flatnonzero(values[:-1] * values[1:] < 0).tolist()]


def _root(f: Callable[[float], float], a: float, b: float) -> float:
    """A zero of f between a and b; the nearest of both if rounding decides on the sign at one of them."""
    if f(a) * f(b) >= 0:
        return min(a, b, key=lambda x: abs(f(x)))
    return float(scipy.optimize.brentq(f, a, b, xtol=1e-14 * a, rtol=1e-14))


def _peak(f: Callable[[float], float], ω: Array, values: Array) -> float:
    """Largest value of f, near the largest of the values on the grid."""
    k = int(np.argmax(values))
    low, high = float(ω[max(k - 1, 0)]), float(ω[min(k + 1, len(ω) - 1)])
    bounds, within = (low, high), {"xatol": 1e-9 * high}
    found = scipy.optimize.minimize_scalar(lambda x: -f(x), bounds=bounds, method="bounded", options=within)
    return max(float(values[k]), -float(found.fun))
