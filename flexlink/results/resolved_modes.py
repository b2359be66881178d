"""Modes that the hinges of a chain resolve: these have two or more hinges per half-wave of curvature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.vibration.modal import Modes

HINGES_A_HALF_WAVE = 2.0


def resolved(found: Modes, chain: Chain) -> tuple[bool, ...]:
    """Whether the frequency of each mode is a property of the arm, rather than of its division into hinges.

    A link's hinge angles about an axis change sign where the beam's curvature does. A half-wave lies between two such
    sign changes and needs `HINGES_A_HALF_WAVE` hinges, so at most one mode per pair of hinges is resolved. Pendulum and
    rigid modes count as resolved, artificial ones do not. Frequencies of resolved modes are mostly accurate to a few
    per cent.
    """
    springs = int((chain.stiffness > 0).sum())
    elastic = np.cumsum([kind == "elastic" for kind in found.kinds])
    return tuple(
        kind in {"pendulum", "rigid"}
        or (kind == "elastic" and bool(rank <= springs / HINGES_A_HALF_WAVE) and _resolves(_in_phase(shape), chain))
        for kind, rank, shape in zip(found.kinds, elastic, found.shapes, strict=True)
    )


def _in_phase(shape: NDArray[np.inexact]) -> Array:
    real = np.asarray(np.real(shape), dtype=np.float64)
    return real if np.abs(real).max() > 0 else np.asarray(np.imag(shape), dtype=np.float64)


def _resolves(shape: Array, chain: Chain) -> bool:
    moments = chain.times("stiffness", shape)  # spring moments, which have the sign of the curvature
    energy = moments * shape
    for hinges in _lines(chain):
        waves = _half_waves(moments[hinges])
        # hinges with less than 5 % of a mode's elastic energy do not matter for its frequency
        if energy[hinges].sum() > 0.05 * energy.sum() and len(hinges) < HINGES_A_HALF_WAVE * waves:
            return False
    return True


def _lines(chain: Chain) -> list[list[int]]:
    """Coordinates of the hinges of each link about each axis, from the root outward, excluding gears."""
    found: dict[tuple[int, int], list[int]] = {}
    for k, coordinate in enumerate(chain.coordinates):
        if coordinate.axis and coordinate.segment and chain.stiffness[k] > 0:
            found.setdefault((coordinate.link, coordinate.axis), []).append(k)
    return list(found.values())


def _half_waves(moments: Array) -> int:
    signs = np.sign(moments[np.abs(moments) > 1e-6 * np.abs(moments).max()])
    return 1 + int(np.sum(signs[1:] != signs[:-1]))
