"""How read numbers differ from right ones: each shape is a question with the answer yes or no."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.engines.read_back import ReadBack, parallel_axis

Array = NDArray[np.float64]

SAME = 1e-9
"""How well a shape must fit, relative: between rounding, and the last digit of files of 6 digits."""
FEW = 1e-3
"""The most, relative, that digits lost in writing may change; with three digits, half of it."""
DIGITS = range(2, 13)


class Seen(NamedTuple):
    """One field of both records: the entries that differ, (m, …), and their numbers; then whole records."""

    ours: Array
    theirs: Array
    where: NDArray[np.intp]
    us: ReadBack
    them: ReadBack

    @property
    def factor(self) -> float | None:
        """The one number that makes theirs of ours, if there is one."""
        square = float((self.ours**2).sum())
        if square == 0 or not np.isfinite([self.ours, self.theirs]).all():
            return None
        factor = float((self.ours * self.theirs).sum()) / square
        return factor if close(self.theirs, factor * self.ours) else None

    @property
    def part(self) -> float | None:
        """Of one inertia: the factor of one of the parts that are rigid with each other, if that makes all of it.

        Theirs is ours and (f − 1) / f of what they have for the part, so that the difference is a multiple of it.
        """
        if len(self.where) > 1:
            return None
        more = self.theirs[0] - self.ours[0]
        for owner, inertia in zip(self.them.parts.owner, self.them.parts.inertias, strict=True):
            size = float((inertia**2).sum())
            share = float((more * inertia).sum()) / size if owner == self.where[0] and size else 1.0
            if share < 1 and np.abs(more - share * inertia).max() <= SAME * np.abs(self.ours).max():
                return 1 / (1 - share)
        return None


Shape = Callable[[Seen], bool]


def close(theirs: Array, ours: Array) -> bool:
    """Equal within `SAME` of the largest."""
    return bool(np.abs(theirs - ours).max(initial=0.0) <= SAME * np.abs(ours).max(initial=0.0))


def anything(_: Seen) -> bool:
    """What no other shape fits."""
    return True


def missing(seen: Seen) -> bool:
    """Zero where there should be something."""
    return not seen.theirs.any()


def extra(seen: Seen) -> bool:
    """Something where there should be nothing."""
    return not seen.ours.any()


def times(*factors: float) -> Shape:
    """All by one of these factors."""

    def shape(seen: Seen) -> bool:
        return any(_each_close(seen.theirs, factor * seen.ours) for factor in factors)

    return shape


def proportional(seen: Seen) -> bool:
    """All, or one vector, by one and the same factor."""
    return seen.factor is not None and seen.ours.size > 1


def part_times(seen: Seen) -> bool:
    """One part of a body by one factor."""
    return seen.part is not None


def lever_times(factor: float) -> Shape:
    """Centres so many times as far from the joint's point."""

    def shape(seen: Seen) -> bool:
        origins = seen.them.points[seen.where]
        return _each_close(seen.theirs - origins, factor * (seen.ours - origins))

    return shape


def products_negated(seen: Seen) -> bool:
    """The moments are right and the products have the opposite sign, in the axes of theirs, of ours, or of frame 0."""
    k = seen.where
    for R in (seen.them.frames[k], seen.us.frames[k], np.eye(3)[None]):
        I = R.mT @ seen.ours @ R
        if _each_close(R.mT @ seen.theirs @ R, 2 * I * np.eye(3) - I):
            return True
    return False


def one_sided(seen: Seen) -> bool:
    """Limits that let a torque pass in one direction only, where both are asked for."""
    return bool(((seen.theirs[:, 0] >= 0) | (seen.theirs[:, 1] <= 0)).all() and seen.ours.all())


def narrower(seen: Seen) -> bool:
    """Limits within ours."""
    return bool(((seen.theirs[:, 0] >= seen.ours[:, 0]) & (seen.theirs[:, 1] <= seen.ours[:, 1])).all())


def moved(seen: Seen) -> bool:
    """The right numbers at the wrong places."""
    if np.ndim(seen.ours[0]) or len(seen.where) < 2:
        return False
    return _each_close(np.sort(seen.theirs), np.sort(seen.ours))


def larger(seen: Seen) -> bool:
    """All larger; of inertias the smallest moments."""
    return bool((_smallest(seen.theirs) > _smallest(seen.ours)).all())


def fewer_digits(seen: Seen) -> bool:
    """Single numbers are ours with fewer digits, significant ones or decimals; what frames turn is nearly right."""
    if not np.isfinite([seen.ours, seen.theirs]).all():
        return False
    if np.ndim(seen.ours[0]):
        return bool(np.abs(seen.theirs - seen.ours).max() <= FEW * np.abs(seen.ours).max())
    pairs = list(zip(seen.ours.tolist(), seen.theirs.tolist(), strict=True))
    return any(
        all(float(f"{x:.{digits}{kind}}") == y for x, y in pairs) for kind, digits in itertools.product("gf", DIGITS)
    )


def turned(seen: Seen) -> bool:
    """The principal moments are right, their axes are not."""
    return _each_close(moments(seen.theirs), moments(seen.ours))


def alike(seen: Seen) -> bool:
    """Three equal principal moments."""
    return bool((np.ptp(moments(seen.theirs), axis=1) <= SAME * _smallest(seen.theirs)).all())


def ball_of_water(seen: Seen) -> bool:
    """What Drake takes, with a warning, for inertias that no body can have: 2/5 m r², a ball of 1000 kg/m³."""
    m = seen.them.masses[seen.where]
    moment = 0.4 * m * np.cbrt(3 * m / (4000 * np.pi)) ** 2
    return close(seen.theirs, moment[:, None, None] * np.eye(3))


def about_the_joint(seen: Seen) -> bool:
    """m (r² 1 − r rᵀ) too much, r from the joint's point to the centre."""
    k = seen.where
    added = parallel_axis(seen.us.masses[k], seen.us.centers[k] - seen.us.points[k])
    return close(seen.theirs - seen.ours, added)


def less_in_one(seen: Seen) -> bool:
    """One body alone is too light."""
    return len(seen.where) == 1 and bool(0 < seen.theirs[0] < seen.ours[0])


def same_length(seen: Seen) -> bool:
    """A vector of the right size along another line."""
    return bool(np.isclose(np.linalg.norm(seen.theirs), np.linalg.norm(seen.ours), rtol=SAME, atol=0))


def _smallest(values: Array) -> Array:
    """Single numbers themselves, of matrices the smallest eigenvalue."""
    return values if np.ndim(values[0]) == 0 else moments(values)[:, 0]


def moments(inertias: Array) -> Array:
    """Principal moments, the smallest first, shape (…, 3)."""
    return np.asarray(np.linalg.eigvalsh(inertias))


def _each_close(theirs: Array, ours: Array) -> bool:
    """Equal within `SAME` of each row's largest."""
    error, size = (np.abs(part).reshape(len(part), -1).max(axis=1) for part in (theirs - ours, ours))
    return bool((error <= SAME * size).all())
