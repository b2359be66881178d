"""What is said of data before a fit, and what is to be known of its numbers after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.common.types import Array
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source
from flexlink.identification.fitted import Estimate, FittedColumn
from flexlink.identification.identifiability import Check
from flexlink.identification.signals import Model
from flexlink.identification.solve import Found
from flexlink.pages.numbers import plural


def notes(sources: Sequence[Source]) -> list[str]:
    """What was read, and what is assumed of noise."""
    found = []
    for source in sources:
        names = ", ".join(block.name for block in source.blocks)
        use, count = f" ({source.use})" if source.use != "fit" else "", len(source.blocks[0].y)
        if source.is_run:
            found.append(f"{source.name}{use}: {names}; {count} samples at {source.rate:.4g} Hz, {source.shows}")
            found += [f"{source.name}: {doubt}" for doubt in source.doubts]
        else:
            found.append(f"{source.name}{use}: {names}; {plural(count, 'number')}")
        uneven = [block.name for block in source.blocks if block.t is not None and _uneven(block.t)]
        if uneven:
            found.append(
                f"{source.name}: samples of {', '.join(uneven)} are not evenly spaced; intervals count what is left "
                "as if they were"
            )
        unknown = [block.name for block in source.blocks if not block.stated]
        if unknown and source.use == "fit":
            found.append(f"{source.name}: noise of {', '.join(unknown)} is not stated; 1 % of the range is assumed")
    return found


def ranges_apart(sources: Sequence[Source], model: Model) -> list[str]:
    """Columns whose range is another one by far than that of the scene at its start: a unit may be wrong."""
    rounded = 1e-9  # range that is rounding's, a part of what is compared: no unit is so much larger
    apart = 100.0  # factor
    found = []
    for source, several in zip(sources, model, strict=True):
        for block, y in zip(source.blocks, several, strict=True):
            measured, ours = float(np.ptp(block.y)), float(np.ptp(y))
            moves = ours > rounded * max(measured, float(np.abs(y).max()))
            if block.t is not None and not block.gain and moves and not 1 / apart < measured / ours < apart:
                found.append(
                    f"{source.name}: {block.name} ranges over {measured:.3g} {block.unit}, the scene at its start over "
                    f"{ours:.3g} {block.unit}: is its unit right?"
                )
    return found


def _too_far(one: FittedColumn) -> str:
    return (
        f"{one.source}, {one.name}: what is left is {one.times_noise:.2g} times the noise that is stated: more noise, "
        "or something that the scene does not have"
    )


def _times_fitted(one: FittedColumn, columns: Sequence[FittedColumn]) -> float:
    """Residuals of a column that was kept to check, over those of the same one where it was fitted."""
    left = [other.left(other.after) for other in columns if other.use == "fit" and other.name == one.name]
    return one.off(one.after) / max(left) if one.use == "check" and left and max(left) > 0 else 0.0


def _worse_than_fitted(one: FittedColumn, columns: Sequence[FittedColumn]) -> str:
    return (
        f"{one.source}, {one.name}: what is left is {_times_fitted(one, columns):.2g} times that of the fitted runs: "
        "the numbers are not known well enough for this run (fit it, too), or the scene lacks something"
    )


def _uneven(t: Array) -> bool:
    even = 0.1  # part of the time between samples by which it may vary
    between = np.diff(t)
    return bool(np.ptp(between) > even * between.mean())


def _times(one: Estimate) -> float:
    """By which factor a positive number has moved."""
    return max(one.value / one.start, one.start / one.value)


def _ran_away(one: Estimate) -> str:
    return (
        f"{one.name} went from {one.start:.4g} to {one.value:.4g}: there may be a better answer near the start; "
        "see --starts, or give between"
    )


def _strays(one: Estimate, known: Coordinate) -> bool:
    """Whether the data have led a number away from what was known of it."""
    strays = 3.0  # standard deviations of the prior
    return known.prior is not None and abs(one.value - known.prior[0]) > strays * known.prior[1]


def _beside_prior(one: Estimate, known: Coordinate) -> str:
    mean, deviation = known.prior or (0.0, 1.0)
    far = abs(one.value - mean) / deviation
    return (
        f"{one.name} = {one.value:.4g}: {far:.2g} standard deviations from its prior, {mean:.4g} ± {deviation:.2g}: "
        "the prior is wrong, or the scene lacks something that this number makes up for"
    )


def warnings(
    numbers: Sequence[Estimate],
    coordinates: Sequence[Coordinate],
    check: Check,
    found: Sequence[Found],
    columns: Sequence[FittedColumn],
    sources: Sequence[Source],
) -> tuple[str, ...]:
    """Why numbers of a fit, or the scene, may not be what they seem."""
    wider = (
        "its interval is wider than slopes say: it ends where the data reject a value, other noise in time being "
        "possible there, too"
    )
    away = 10.0  # factor between a positive number and its start
    far = 2.0  # times the noise that is stated, or of that of fitted runs
    told = [f"{one.name} ended at its bound, {one.value:.6g}" for one in numbers if one.at_bound]
    told += [_ran_away(one) for one, by in zip(numbers, coordinates, strict=False) if by.log and _times(one) > away]
    told += [f"{one.name}: {wider}" for one in numbers if one.widened]
    told += [_beside_prior(one, known) for one, known in zip(numbers, coordinates, strict=False) if _strays(one, known)]
    told += [one.text for one in check.directions]
    told += [_too_far(one) for one in columns if one.stated and one.use == "fit" and one.times_noise > far]
    told += [f"{source.name}: {doubt}" for source in sources for doubt in source.doubts]
    told += [_worse_than_fitted(one, columns) for one in columns if _times_fitted(one, columns) > far]
    if len(found) > 1:
        same = sum(bool(np.allclose(end.x, found[0].x, rtol=0, atol=1e-4)) for end in found)
        if same < len(found):
            told.append(f"{same} of {len(found)} starts led to the best answer; others end higher")
    return tuple(told)
