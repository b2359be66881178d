"""Shapes of a discrepancy: predicates that describe how the numbers in a file differ from the expected numbers."""

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array, Indices
from flexlink.engines.read_back import ReadBack, parallel_axis

TOLERANCE = 1e-9
"""Relative tolerance of a shape: larger than rounding errors, smaller than the last digit of files with 6 digits."""


class Discrepancy(NamedTuple):
    """The m entries of a field that differ, shape (m, …), the joints of these entries, and both records."""

    ours: Array
    theirs: Array
    rows: Indices
    our_record: ReadBack
    their_record: ReadBack

    @property
    def factor(self) -> float | None:
        """Factor f if their numbers are f times ours; None if there is no such factor."""
        square = float((self.ours**2).sum())
        if square == 0 or not np.isfinite([self.ours, self.theirs]).all():
            return None
        factor = float((self.ours * self.theirs).sum()) / square
        return factor if close(self.theirs, factor * self.ours) else None

    @property
    def errors(self) -> Array:
        """Largest difference of each entry, shape (m,)."""
        return np.asarray(np.abs(self.theirs - self.ours).reshape(len(self.rows), -1).max(axis=1))

    def only(self, chosen: NDArray[Any] | list[int]) -> "Discrepancy":
        """Some of the entries, given by their numbers or a mask."""
        return self._replace(ours=self.ours[chosen], theirs=self.theirs[chosen], rows=self.rows[chosen])

    @property
    def relative_error(self) -> float:
        """Largest difference, relative to the largest expected number."""
        return float(np.abs(self.theirs - self.ours).max() / np.abs(self.ours).max())

    @property
    def part_factor(self) -> float | None:
        """For a single inertia, the factor f of one of the body's parts if it explains the difference completely.

        The part is f times too large in the file, so the difference is (f − 1) / f times the part in the file.
        """
        if len(self.rows) > 1:
            return None
        excess, parts = self.theirs[0] - self.ours[0], self.their_record.parts
        for owner, inertia in zip(parts.owner, parts.inertias, strict=True):
            square = float((inertia**2).sum())
            share = float((excess * inertia).sum()) / square if owner == self.rows[0] and square else 1.0
            if share < 1 and np.abs(excess - share * inertia).max() <= TOLERANCE * np.abs(self.ours).max():
                return 1 / (1 - share)
        return None


Shape = Callable[[Discrepancy], bool]


def close(theirs: Array, ours: Array) -> bool:
    """Whether two arrays are equal within `TOLERANCE` of the largest number."""
    return bool(np.abs(theirs - ours).max(initial=0.0) <= TOLERANCE * np.abs(ours).max(initial=0.0))


def any_difference(_: Discrepancy) -> bool:
    """Always true; used in the last row of a field in the table of mistakes."""
    return True


def all_zero(diff: Discrepancy) -> bool:
    """The numbers are zero, but the expected numbers are not."""
    return not diff.theirs.any()


def none_expected(diff: Discrepancy) -> bool:
    """The expected numbers are zero."""
    return not diff.ours.any()


def scaled_by(*factors: float) -> Shape:
    """All numbers are scaled by one of these factors."""
    return lambda diff: any(_each_close(diff.theirs, factor * diff.ours) for factor in factors)


def scaled_where_sliding(factor: float) -> Shape:
    """All numbers are scaled by a factor, and all joints are prismatic."""
    shape = scaled_by(factor)
    return lambda diff: bool(diff.our_record.slides[diff.rows].all()) and shape(diff)


def proportional(diff: Discrepancy) -> bool:
    """Several numbers, or one vector, are scaled by the same factor."""
    return diff.factor is not None and diff.ours.size > 1


def part_scaled(diff: Discrepancy) -> bool:
    """One part of a body is scaled by a factor."""
    return diff.part_factor is not None


def lever_scaled(factor: float) -> Shape:
    """Distances of centres of mass from the joint's point are scaled by a factor."""

    def shape(diff: Discrepancy) -> bool:
        origins = diff.their_record.points[diff.rows]
        return _each_close(diff.theirs - origins, factor * (diff.ours - origins))

    return shape


def products_negated(diff: Discrepancy) -> bool:
    """Moments are equal and products of inertia negated, in axes of the file's frame, our frame, or frame 0."""
    k, off = diff.rows, ~np.eye(3, dtype=bool)
    for R in (diff.their_record.frames[k], diff.our_record.frames[k], np.eye(3)[None]):
        I, other = R.mT @ diff.ours @ R, R.mT @ diff.theirs @ R
        if np.abs(I[..., off]).max() > 1e-6 * np.abs(I).max() and _each_close(other, 2 * I * np.eye(3) - I):
            return True
    return False


def one_sided(diff: Discrepancy) -> bool:
    """Limits allow torque in only one direction, but the drive needs both."""
    return bool(((diff.theirs[:, 0] >= 0) | (diff.theirs[:, 1] <= 0)).all() and diff.ours.all())


def narrower(diff: Discrepancy) -> bool:
    """The limits in the file are inside the expected limits."""
    return bool(((diff.theirs[:, 0] >= diff.ours[:, 0]) & (diff.theirs[:, 1] <= diff.ours[:, 1])).all())


def permuted(diff: Discrepancy) -> bool:
    """The file has the expected numbers, but at other joints."""
    if np.ndim(diff.ours[0]) or len(diff.rows) < 2:
        return False
    return _each_close(np.sort(diff.theirs), np.sort(diff.ours))


def all_larger(diff: Discrepancy) -> bool:
    """All numbers (for inertias, the smallest principal moments) are larger by more than rounding errors."""
    return bool((_smallest(diff.theirs) > (1 + TOLERANCE) * _smallest(diff.ours)).all())


def fewer_digits(diff: Discrepancy) -> bool:
    """Scalars are rounded to fewer digits or decimals; vectors and matrices agree to three digits."""
    if not np.isfinite([diff.ours, diff.theirs]).all():
        return False
    if np.ndim(diff.ours[0]):  # rotated numbers are not round
        return bool(np.abs(diff.theirs - diff.ours).max() <= 1e-3 * np.abs(diff.ours).max())
    pairs = list(zip(diff.ours.tolist(), diff.theirs.tolist(), strict=True))
    formats = itertools.product("gf", range(2, 13))
    last = 1e-14  # relative rounding error of numbers that the engine adds and flexlink subtracts, far below 12 digits
    return any(all(abs(float(f"{x:.{n}{form}}") - y) <= last * abs(y) for x, y in pairs) for form, n in formats)


def axes_rotated(diff: Discrepancy) -> bool:
    """Principal moments are equal, but principal axes are not."""
    return _each_close(moments(diff.theirs), moments(diff.ours))


def equal_moments(diff: Discrepancy) -> bool:
    """The three principal moments are equal."""
    return bool((np.ptp(moments(diff.theirs), axis=1) <= TOLERANCE * _smallest(diff.theirs)).all())


def water_sphere(diff: Discrepancy) -> bool:
    """The inertia is 2/5 m r² of a sphere of 1000 kg/m³, which Drake substitutes for an impossible inertia."""
    m = diff.their_record.masses[diff.rows]
    moment = 0.4 * m * np.cbrt(3 * m / (4000 * np.pi)) ** 2
    return close(diff.theirs, moment[:, None, None] * np.eye(3))


def about_joint(diff: Discrepancy) -> bool:
    """Inertias are too large by m (r² 1 − r rᵀ), with r from the joint's point to the centre of mass."""
    k, ours = diff.rows, diff.our_record
    return close(diff.theirs - diff.ours, parallel_axis(ours.masses[k], ours.centers[k] - ours.points[k]))


def one_too_light(diff: Discrepancy) -> bool:
    """The mass of a single body is too small."""
    return len(diff.rows) == 1 and bool(0 < diff.theirs[0] < diff.ours[0])


def same_length(diff: Discrepancy) -> bool:
    """A vector has the same length, but another direction."""
    return bool(np.isclose(np.linalg.norm(diff.theirs), np.linalg.norm(diff.ours), rtol=TOLERANCE, atol=0))


def _smallest(values: Array) -> Array:
    """The values if they are scalars; for matrices, the smallest eigenvalues."""
    return values if np.ndim(values[0]) == 0 else moments(values)[:, 0]


def moments(inertias: Array) -> Array:
    """Principal moments in ascending order, shape (…, 3)."""
    return np.asarray(np.linalg.eigvalsh(inertias))


def _each_close(theirs: Array, ours: Array) -> bool:
    """Whether arrays are equal within `TOLERANCE` of the largest number in each row."""
    error, size = (np.abs(part).reshape(len(part), -1).max(axis=1) for part in (theirs - ours, ours))
    return bool((error <= TOLERANCE * size).all())
