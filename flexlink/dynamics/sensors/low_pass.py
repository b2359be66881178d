"""Butterworth low-pass filter in modal form, exact for a signal that is linear between samples.

    H(s) = Π ω/(s − p_k) · … = Σ_k r_k/(s − p_k)        p_k = ω exp(iπ (2k + n + 1)/(2n)), k = 0 … n − 1
    ż_k = p_k z_k + u        y = Σ_k r_k z_k        n is the order; one pole of each conjugate pair is stored

For a signal u(τ) = u + g τ, z(τ) = e^{pτ} z + τ φ₁(pτ) u + τ² φ₂(pτ) g, φ₁(x) = (eˣ − 1)/x, φ₂(x) = (eˣ − 1 − x)/x².
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array, Complex


class LowPass(NamedTuple):
    """Poles of a low-pass filter in the upper half-plane, and the weights of their modes in the output."""

    poles: Complex  # (modes,) [1/s]
    weights: Complex  # (modes,) [1/s], y = Re Σ weights · z

    def settled(self, u: Array) -> Complex:
        """Steady states (…, modes) for a constant signal (…)."""
        return np.asarray(-u[..., None] / self.poles)

    def advanced(self, z: Complex, u: Array, g: Array, τ: Array) -> Complex:
        """States (…, modes) after τ ≥ 0 [s] under a signal with value u (…) now and slope g [1/s]."""
        x = τ[..., None] * self.poles
        τ, u, g = τ[..., None], u[..., None], g[..., None]
        first, second = _phi(x)
        return np.asarray(np.exp(x) * z + τ * first * u + τ**2 * second * g)

    def output(self, z: Complex) -> Array:
        """Output y (…) of states (…, modes)."""
        return np.asarray((z @ self.weights).real)

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A (n, n), B (n,), C (n,) of a real state with this output: Re z and Im z of each mode; Re z if it is real."""
        sizes = [2 if p.imag else 1 for p in self.poles]
        A, B, C = (np.zeros(shape) for shape in ((sum(sizes),) * 2, sum(sizes), sum(sizes)))
        for p, w, end, size in zip(self.poles, self.weights, np.cumsum(sizes).tolist(), sizes, strict=True):
            block = slice(end - size, end)
            A[block, block] = np.array([[p.real, -p.imag], [p.imag, p.real]])[:size, :size]
            B[end - size], C[block] = 1.0, [w.real, -w.imag][:size]
        return A, B, C


@functools.lru_cache(maxsize=64)
def butterworth(hertz: float, order: int) -> LowPass:
    """Low-pass filter with gain 1/√2 at this frequency and unit gain at zero frequency."""
    ω = 2 * math.pi * hertz
    unit = np.exp(1j * math.pi * (2 * np.arange(order) + order + 1) / (2 * order))
    apart = unit[:, None] - unit
    np.fill_diagonal(apart, 1.0)
    upper = slice((order + 1) // 2)
    poles, weights = ω * unit[upper], 2 * ω / apart.prod(axis=1)[upper]
    if order % 2:  # the last pole is real, without a conjugate
        poles[-1], weights[-1] = poles[-1].real, weights[-1].real / 2
    for array in (poles, weights):
        array.setflags(write=False)
    return LowPass(poles, weights)


def _phi(x: Complex) -> tuple[Complex, Complex]:
    """φ₁ and φ₂, accurate for small x."""
    terms = 18
    # below this |x| φ₂ is summed as a series, since eˣ − 1 − x loses digits
    near = np.abs(x) < 0.5
    small, large = np.where(near, x, 0.0), np.where(near, 1.0, x)
    series = np.full_like(small, 1.0 / math.factorial(terms + 2))
    for k in range(terms + 1, 1, -1):
        series = series * small + 1.0 / math.factorial(k)
    second = np.where(near, series, (np.exp(large) - 1 - large) / large**2)
    return 1 + x * second, second
