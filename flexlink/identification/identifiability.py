"""Identifiability before a fit, from the Jacobian at the initial guess and the stated noise.

    J = ∂(data / noise)/∂x = U S Vᵀ

A direction v with singular value s is not identifiable if its expected standard deviation 1/s is 1 or more (a factor of
e), or if s is within the error of J. Such a direction is a parameter, or a combination, without a measurable effect.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array

WIDE = 1.96  # half-width of a 95 % interval in standard deviations
COUNTS = 0.2
"""A parameter is part of a direction if its effect is more than this share of the direction's largest effect."""
EQUAL = 1e-6
"""Relative difference below which sizes count as equal, due to the Jacobian's error; the first of them is used."""


class Direction(NamedTuple):
    """A combination of parameters that is poorly identifiable, or not identifiable at all.

    Attributes
    ----------
    names
        Parameters in the combination; the parameter with the largest component comes first.
    parts
        Component of each parameter.
    deviation
        Expected standard deviation along the direction, relative to the parameters or their units.
    lost
        Whether the direction is not identifiable at all.
    why
        What the parameter affects instead, if that is known; otherwise "".
    """

    names: tuple[str, ...]
    parts: tuple[float, ...]
    deviation: float
    lost: bool
    why: str = ""

    @property
    def text(self) -> Diagnostic:
        """Text of the finding."""
        if len(self.names) == 1:
            name, expected = self.names[0], f"expected ± {WIDE * 100 * self.deviation:.2g} % (95 %){self.why}"
            if not np.isfinite(self.deviation):
                return Diagnostic(f"{name} has no effect on the data{self.why}", "no-effect")
            if self.lost:
                return Diagnostic(f"{name} has too weak an effect on the data: {expected}", "weak-effect")
            return Diagnostic(f"{name} is poorly identifiable: {expected}", "poorly-identifiable")
        pairs = zip(self.names, self.parts, strict=True)
        changes = " and ".join(f"{name} by {10 * part / self.parts[0]:+.2g} %" for name, part in pairs)
        both = " and ".join(self.names)
        if self.lost:
            text = f"{both} are not separately identifiable: changing {changes} has no measurable effect"
            return Diagnostic(text, "not-separable")
        text = f"{both} are poorly separable: changing {changes} has hardly any measurable effect"
        return Diagnostic(text, "poorly-separable")


class Check(NamedTuple):
    """Result of an identifiability check.

    Attributes
    ----------
    names
        Parameters of the scene, then gains and biases.
    singular_values
        Singular values of the Jacobian divided by the noise, largest first.
    directions
        Combinations that are not, or poorly, identifiable, the worst first.
    expected
        Expected standard deviation of each parameter, relative to its value or unit; inf if it is not identifiable.
    notes
        Notes on columns, sampling rates and noise.
    error
        Norm of the error of the Jacobian.
    grid
        Expected error of each parameter due to the number of segments, relative to its value or unit; empty if unknown.
    """

    names: tuple[str, ...]
    singular_values: Array
    directions: tuple[Direction, ...]
    expected: Array
    notes: tuple[Diagnostic, ...] = ()
    error: float = 0.0
    grid: Array = np.empty(0)

    @property
    def lost(self) -> tuple[Direction, ...]:
        """Combinations that are not identifiable; if there are any, the fit is refused."""
        return tuple(one for one in self.directions if one.lost)

    @property
    def passed(self) -> bool:
        """Whether every parameter is identifiable."""
        return not self.lost

    @property
    def coarse(self) -> bool:
        """Whether the expected grid error of a parameter exceeds half its expected 95 % interval."""
        return bool(len(self.grid)) and bool((self.grid > WIDE * self.expected[: len(self.grid)]).any())


def document(check: Check) -> dict[str, object]:
    """The check as plain numbers and texts; None replaces non-finite numbers."""
    return {
        "passed": check.passed,
        "expected": {
            name: float(WIDE * part) if np.isfinite(part) else None
            for name, part in zip(check.names, check.expected, strict=True)
        },
        "grid_errors": dict(zip(check.names, check.grid.tolist(), strict=False)),
        "singular_values": check.singular_values.tolist(),
        "directions": [{"id": one.text.id, "text": one.text, "lost": one.lost} for one in check.directions],
        "notes": [{"id": note.id, "text": note} for note in check.notes],
    }


def checked(J: Array, error: float, names: Sequence[str], notes: Sequence[Diagnostic] = ()) -> Check:
    """Check the Jacobian J of all residuals, shape (data, parameters), with respect to typical large changes.

    `error` is the norm of the error of J. A parameter without effect is a direction by itself; combinations of the
    others contain as few parameters as possible. If several directions have equal effects, rounding errors decide
    their basis, order and signs in the decomposition; the result does not depend on these.
    """
    nothing_from = 100.0  # half-width of an interval that counts as no effect; rounding alone gives 1e5, a search ± 6.9
    weak_from = 0.1  # expected standard deviation of a direction above which it is poorly identifiable
    free = 1.0  # expected standard deviation of a direction above which it is not identifiable
    unknown = 10 * error
    least, nothing = max(1 / free, unknown), max(WIDE / nothing_from, unknown)

    def deviation(effect: float) -> float:
        return 1 / effect if effect > nothing else np.inf

    size = np.linalg.norm(J, axis=0)
    moved = np.flatnonzero(size > least)
    still = np.flatnonzero(size <= least).tolist()
    directions = [Direction((names[k],), (1.0,), deviation(float(size[k])), True) for k in still]
    effective = J[:, moved]
    _, s, V = np.linalg.svd(np.vstack([effective, np.zeros((len(moved),) * 2)]), full_matrices=False)
    lost = s <= least
    effective_names = [names[k] for k in moved.tolist()]
    for v in _short(V[lost]):
        along = float(np.linalg.norm(effective @ v))
        directions.append(_direction(effective_names, v, size[moved], deviation(along), lost=True))
    weak = np.flatnonzero(~lost & (s < 1 / weak_from))[::-1]
    for equal in np.split(weak, np.flatnonzero(np.diff(s[weak]) > EQUAL * s[weak[1:]]) + 1):
        for v in _short(V[equal]):
            directions.append(_direction(effective_names, v, size[moved], 1 / float(s[equal[0]]), lost=False))
    expected = np.full(len(names), np.inf)
    unknown_part = (V[lost] ** 2).sum(axis=0) > COUNTS**2 / 10
    expected[moved] = np.where(unknown_part, np.inf, np.sqrt((V[~lost].T ** 2 / s[~lost] ** 2).sum(axis=1)))
    s = np.append(s, np.zeros(len(names) - len(s)))
    return Check(tuple(names), s, tuple(directions), expected, tuple(notes), error)


def _largest(sizes: Array) -> int:
    """Index of the largest size, or of the first if several are equal."""
    return int(np.flatnonzero(sizes >= (1 - EQUAL) * sizes.max())[0])


def _short(basis: Array) -> Array:
    """Unit vectors that span the same space, sparse by elimination, whose pivots do not depend on the basis."""
    remainder, pivots = basis.copy(), []
    for _ in basis:
        pivots.append(_largest(np.linalg.norm(remainder, axis=0)))
        along = remainder[:, pivots[-1]] / np.linalg.norm(remainder[:, pivots[-1]])
        remainder -= np.outer(along, along @ remainder)
    rows = np.linalg.solve(basis[:, sorted(pivots)], basis)
    return np.asarray(rows / np.linalg.norm(rows, axis=1)[:, None])


def _direction(names: Sequence[str], v: Array, effects: Array, deviation: float, lost: bool) -> Direction:
    """Direction with only those parameters whose effects matter, sorted by component; the first is positive."""
    effect = np.abs(v) * effects
    rest, order = np.where(effect > COUNTS * effect.max(), np.abs(v), 0.0), []
    while rest.any():
        order.append(_largest(rest))
        rest[order[-1]] = 0.0
    v = v * np.sign(v[order[0]])
    return Direction(tuple(names[k] for k in order), tuple(float(v[k]) for k in order), float(deviation), lost)
