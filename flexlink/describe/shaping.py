"""Input shapers as data: impulses whose delayed responses cancel the vibration at given frequencies.

Impulses a_i at times t_i excite a vibration exp(λt) with |Σ a_i exp(−λ t_i)| times the amplitude that a single impulse
excites. For λ = −σ ± iω_d let T = π/ω_d be half a period, and K = exp(−σT) the decay over T. Then

    t_i = h_i T,   a_i = w_i K^h_i / Σ_k w_k K^h_k:   Σ a_i exp(−λ t_i) = Σ w_i exp(∓iπ h_i) / Σ_k w_k K^h_k

so the numbers h_i, w_i define a shaper for any frequency and damping. For several vibrations, shapers are convolved.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.data import documents
from flexlink.describe import data_files
from flexlink.describe.spec import NonNegative, Positive, Spec, measured_in

Ratio = Annotated[float, msgspec.Meta(ge=0, lt=1)]

MOST_IMPULSES = 1024
"""Largest number of impulses; ZVD for six vibrations needs 3⁶ = 729 impulses, and lengthens the move by six periods."""


class ShaperRule(Spec, frozen=True):
    """A shaper of one vibration: impulses at times h T, h from `half_periods`, with weights w K^h scaled to sum 1.

    `zeros` is the number of derivatives of Σ w_i exp(iπ h_i) with respect to frequency, from the 0th on, that vanish.
    """

    about: str
    """One-sentence description of the shaper."""
    source: str
    """Publication."""
    zeros: Annotated[int, msgspec.Meta(ge=0)]
    """Number of derivatives of Σ w exp(iπh), from the 0th on, that vanish; 0 if some vibration remains."""
    half_periods: Annotated[tuple[NonNegative, ...], msgspec.Meta(min_length=1)]
    """Times of the impulses in half periods of the vibration, from 0 [1]."""
    weights: tuple[float, ...]
    """Weights w of the impulses, before multiplication by K^h and normalization [1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        h, w = np.array(self.half_periods), np.array(self.weights)
        if len(w) != len(h):
            raise SceneError(f"weights has {len(w)} numbers: expected one per impulse, {len(h)}", id="shaper-weights")
        if h[0] != 0 or np.any(np.diff(h) <= 0):
            raise self._refused("half_periods", "must start at 0 and increase", "shaper-times")
        if w.sum() <= 0:
            raise self._refused("weights", "must have a sum > 0, for normalization", "shaper-weights")
        for k in range(self.zeros):
            remainder = abs(np.sum(w * h**k * np.exp(1j * np.pi * h)))
            if remainder > 1e-12 * np.sum(np.abs(w) * h**k):  # more than the rounding of numbers written with 13 digits
                why = f"derivative {k} of the vibration is {remainder:.3g}, not 0"
                raise self._refused("zeros", why, "shaper-zeros")

    def impulses(self, pole: complex) -> tuple[Array, Array]:
        """Times [s] and weights, with sum 1, for a vibration exp(λt), Im λ > 0."""
        h, w = np.array(self.half_periods), np.array(self.weights)
        half = math.pi / pole.imag
        a = w * np.exp(pole.real * half) ** h
        return h * half, a / a.sum()


class InputShaper(Spec, frozen=True):
    """An input shaper for vibrations given by undamped `frequency_hz` and `damping` ratios, or by `poles`.

    `kind`: ZV, ZVD, …, or the path of a user's file. `poles` are [Re λ, Im λ] of each vibration [1/s].

    Examples
    --------
    >>> slow = fl.small_motion.pd_poles(chain, q, kp=(2e4, 1e4), kd=(600.0, 250.0))[:1]  # vibration to suppress
    >>> shaper = fl.InputShaper.at(slow, "ZV")
    >>> times, amplitudes = shaper.impulses
    >>> print(times.round(3), amplitudes.round(3))  # s
    [0.    0.119] [0.634 0.366]
    >>> shaped = scene.varied({"drive.reference.shaper": shaper})
    """

    kind: str
    """Shaper: a name, or the path of a shaper file."""
    frequency_hz: Annotated[tuple[Positive, ...] | None, measured_in("Hz")] = None
    """Undamped frequencies of the vibrations [Hz]."""
    damping: tuple[Ratio, ...] | None = None
    """Damping ratio of each vibration [1]. Default: no damping."""
    poles: Annotated[tuple[tuple[float, float], ...] | None, measured_in("1/s")] = None
    """Vibrations as [Re λ, Im λ] [1/s], instead of `frequency_hz`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        msgspec.structs.force_setattr(self, "kind", documents.absolute(self.kind))
        if (self.frequency_hz is None) == (self.poles is None):
            why = f"poles = {truncated(self.poles)}: specify exactly one"
            raise SceneError(f"frequency_hz = {truncated(self.frequency_hz)}, {why}", id="both-given")
        if not (self.frequency_hz or self.poles):
            raise SceneError("frequency_hz = (): no vibration to suppress; give at least one", id="frequencies-missing")
        if self.damping is not None and len(self.damping) != len(self.frequency_hz or ()):
            raise self._refused("damping", "expected one ratio per frequency_hz", "one-per-frequency")
        for k, (re, im) in enumerate(self.poles or ()):
            if im <= 0 or re > 0:
                why = "a vibration needs Re λ ≤ 0 and Im λ > 0, as from pd_poles; Hz are written frequency_hz = (1.2,)"
                raise SceneError(f"poles[{k}] = {truncated((re, im))}: {why}", id="poles-not-a-vibration")

    @classmethod
    def at(cls, poles: ArrayLike, kind: str = "ZVD") -> InputShaper:
        """Return the shaper for complex poles λ [1/s], Im λ > 0, as returned by `pd_poles`.

        Examples
        --------
        >>> print(fl.InputShaper.at([-0.2 + 12.0j], "ZVD").kind)
        ZVD
        """
        vibrations = np.atleast_1d(np.asarray(poles, dtype=np.complex128))
        return cls(kind=kind, poles=tuple((λ.real, λ.imag) for λ in vibrations.tolist()))

    @property
    def rule(self) -> ShaperRule:
        """Rule that gives the impulses of the shaper for one vibration.

        Raises
        ------
        ArgumentError
            Unknown name.
        DataFileError
            The file is not a valid shaper.
        """
        return data_files.load("shapers", "kind", self.kind, ShaperRule)

    @property
    def vibrations(self) -> list[complex]:
        """Poles λ of the vibrations [1/s]; λ = ω (−ζ + i √(1 − ζ²)) from a frequency and damping ratio."""
        if self.poles is not None:
            return [complex(*pole) for pole in self.poles]
        frequencies = self.frequency_hz or ()
        ratios = self.damping or (0.0,) * len(frequencies)
        return [
            2 * math.pi * f * complex(-ζ, math.sqrt((1 - ζ) * (1 + ζ)))
            for f, ζ in zip(frequencies, ratios, strict=True)
        ]

    @property
    def impulses(self) -> tuple[Array, Array]:
        """Increasing times [s] and weights, with sum 1, of all impulses; the errors of `rule` may also be raised.

        Raises
        ------
        ArgumentError
            There are too many impulses, or their times overflow float64.
        """
        rule, vibrations = self.rule, self.vibrations
        if len(rule.weights) ** len(vibrations) > MOST_IMPULSES:
            product = f"{len(rule.weights)} impulses for each of {len(vibrations)} vibrations multiply to more than"
            why = f"{product} {MOST_IMPULSES}; shape fewer vibrations"
            raise ArgumentError(f"kind = {truncated(self.kind)}: {why}", id="too-many-impulses")
        single = [list(zip(*rule.impulses(λ), strict=True)) for λ in vibrations]
        times, weights = np.array([
            (math.fsum(t for t, _ in one), math.prod(a for _, a in one)) for one in itertools.product(*single)
        ]).T  # fmt: skip
        if not np.isfinite([times, weights]).all():
            why = "the times of the impulses overflow float64; shape faster vibrations"
            raise ArgumentError(f"kind = {truncated(self.kind)}: {why}", id="overflow")
        order = np.argsort(times, kind="stable")
        return times[order], weights[order]
