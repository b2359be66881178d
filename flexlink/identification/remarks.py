"""Notes on the data before a fit, and warnings about the estimates after a fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source
from flexlink.identification.estimate import Estimate
from flexlink.identification.fitted import FittedColumn
from flexlink.identification.identifiability import Check
from flexlink.identification.likelihood import Likelihood
from flexlink.identification.noise import noise_in
from flexlink.identification.solve import Found


def notes(sources: Sequence[Source]) -> list[Diagnostic]:
    """Notes on the data that were read, and on assumed noise."""
    found = []
    for source in sources:
        several = len({len(block.y) for block in source.blocks}) > 1 and source.is_run
        names = ", ".join(f"{block.name} ({len(block.y)})" if several else block.name for block in source.blocks)
        use, count = f" ({source.use})" if source.use != "fit" else "", max(len(block.y) for block in source.blocks)
        if source.is_run:
            text = f"{source.name}{use}: {names}; {count} samples at {source.rate:.4g} Hz, {source.shows}"
            found.append(Diagnostic(text, "data-read"))
            found += _doubts(source)
        else:
            found.append(Diagnostic(f"{source.name}{use}: {names}; {plural(count, 'number')}", "data-read"))
        uneven = [block.name for block in source.blocks if block.t is not None and _uneven(block.t)]
        if uneven:
            text = (
                f"{source.name}: samples of {', '.join(uneven)} are unevenly spaced, as after an empty cell or a lost "
            )
            text += "row; intervals assume even spacing"
            found.append(Diagnostic(text, "uneven-samples"))
        found += _of_noise(source) if source.use == "fit" else []
    return found


def _of_noise(source: Source) -> list[Diagnostic]:
    """Notes on noise that is not stated: its estimate from the data, or that it is assumed."""
    unknown = [(block, noise_in(block)) for block in source.blocks if not block.stated]
    found = [
        Diagnostic(
            f"{source.name}: noise of {block.name} is not stated; estimated from the data: {σ:.2g}", "estimated-noise"
        )
        for block, σ in unknown if σ is not None
    ]  # fmt: skip
    assumed = ", ".join(block.name for block, σ in unknown if σ is None)
    text = f"{source.name}: noise of {assumed} is not stated; 1 % of the range is assumed"
    return [*found, *([Diagnostic(text, "assumed-noise")] if assumed else [])]


def _doubts(source: Source) -> list[Diagnostic]:
    return [Diagnostic(f"{source.name}: {doubt}", doubt.id) for doubt in source.doubts]


def ranges_apart(at: Likelihood) -> list[Diagnostic]:
    """Warnings about columns whose range differs from the prediction by a large factor, so the unit may be wrong."""
    rounded = 1e-9  # a predicted range is rounding error if, relative to the values, it is smaller than this
    apart = 100.0  # factor between measured and predicted range above which the unit may be wrong
    found = []
    for source, part in zip(at.sources, at.rows, strict=True):
        for block, y, *_ in part:
            measured, ours = float(np.ptp(block.y)), float(np.ptp(y))
            moves = ours > rounded * max(measured, float(np.abs(y).max()))
            if block.t is not None and not block.gain and moves and not 1 / apart < measured / ours < apart:
                text = f"{source.name}: {block.name} ranges over {measured:.3g} {block.unit}, its prediction at the "
                text += f"initial guess over {ours:.3g} {block.unit}; check the unit of the column"
                found.append(Diagnostic(text, "likely-unit"))
    return found


def _too_far(one: FittedColumn) -> Diagnostic:
    return Diagnostic(
        f"{one.source}, {one.name}: the residual is {one.times_noise:.2g} times the stated noise; the noise is larger, "
        "or the model is incomplete",
        "residual-above-noise",
    )


def _times_fitted(one: FittedColumn, columns: Sequence[FittedColumn]) -> float:
    """Ratio of the RMS residuals of a column in a check run and in fitted runs; 0 if it was not fitted."""
    residuals = [other.residual(other.after) for other in columns if other.use == "fit" and other.name == one.name]
    return one.off(one.after) / max(residuals) if one.use == "check" and residuals and max(residuals) > 0 else 0.0


def _worse_than_fitted(one: FittedColumn, columns: Sequence[FittedColumn]) -> Diagnostic:
    return Diagnostic(
        f"{one.source}, {one.name}: the residual is {_times_fitted(one, columns):.2g} times as large as in the "
        "fitted runs; the estimates are too inaccurate for this run (fit it as well), or the model is incomplete",
        "worse-than-fitted-runs",
    )


def _uneven(t: Array) -> bool:
    even = 0.1  # allowed variation of the sampling interval, relative to its mean
    between = np.diff(t)
    return bool(np.ptp(between) > even * between.mean())


def _times(one: Estimate) -> float:
    """Factor between the initial guess and the estimate of a positive parameter."""
    return max(one.value / one.start, one.start / one.value)


def _ran_away(one: Estimate, *, settled: bool) -> Diagnostic:
    doubt = "there may be a better solution near the initial guess: try --starts, or set between"
    remedy = "check the units of the measurements if this is unexpected" if settled else doubt
    text = f"{one.name} moved from {one.start:.4g} to {one.value:.4g}; {remedy}"
    return Diagnostic(text, "far-from-initial-guess")


def _agreeing(found: Sequence[Found]) -> int:
    """Number of initial guesses that led to the best solution."""
    return sum(bool(np.allclose(end.x, found[0].x, rtol=0, atol=1e-4)) for end in found)


def hertz_in_rad_per_s(at: Likelihood) -> list[Diagnostic]:
    """Warnings about measured frequencies that are 2π times the predictions at the initial guess."""
    found = []
    for source, part in zip(at.sources, at.rows, strict=True):
        for block, y, *_ in part:
            if block.t is None and block.unit == "Hz" and np.allclose(block.y, 2 * np.pi * y, rtol=0.05, atol=0):
                given, true = (", ".join(f"{f:.4g}" for f in row) for row in (block.y, block.y / (2 * np.pi)))
                text = f"{source.name}: hertz = [{given}]: 2π times the predictions at the initial guess; likely "
                found.append(Diagnostic(f"{text}given in rad/s: in Hz [{true}]", "likely-unit"))
    return found


def _leaves_prior(one: Estimate, known: Coordinate) -> bool:
    """Whether the data move a parameter far from its prior."""
    far = 3.0  # distance from the prior's mean that counts as far, in standard deviations of the prior
    return known.prior is not None and abs(one.value - known.prior[0]) > far * known.prior[1]


def _far_from_prior(one: Estimate, known: Coordinate) -> Diagnostic:
    mean, deviation = known.prior or (0.0, 1.0)
    far = abs(one.value - mean) / deviation
    return Diagnostic(
        f"{one.name} = {one.value:.4g} is {far:.2g} standard deviations from its prior, {mean:.4g} ± {deviation:.2g}; "
        "the prior is wrong, or the parameter compensates for something that the model lacks",
        "far-from-prior",
    )


def _not_identifiable(one: Estimate) -> Diagnostic:
    return Diagnostic(f"{one.name} is {one.verdict}", one.doubt.id if one.doubt is not None else "")


def warnings(
    numbers: Sequence[Estimate],
    coordinates: Sequence[Coordinate],
    check: Check,
    found: Sequence[Found],
    columns: Sequence[FittedColumn],
    sources: Sequence[Source],
) -> tuple[Diagnostic, ...]:
    """Warnings about the estimates of a fit and its model."""
    wider = "its interval is wider than the linear estimate: it ends where the likelihood ratio rejects a value"
    away = 10.0  # factor between estimate and initial guess of a positive parameter above which to warn
    far = 2.0  # ratio of residual to stated noise, or to the residual of the fitted runs, above which to warn
    # ids of doubts that other warnings already report
    stated = {"estimate-at-bound", "unbounded-interval", "grid-error", "input-error"}
    pairs = list(zip(numbers, coordinates, strict=False))
    found_warnings = [
        Diagnostic(f"{one.name} ended at its bound, {one.value:.6g}", "estimate-at-bound")
        for one in numbers if one.at_bound
    ]  # fmt: skip
    found_warnings += [
        _not_identifiable(one) for one in numbers if one.doubt is not None and one.doubt.id not in stated
    ]
    fitted = [one for one in columns if one.use == "fit"]
    at_noise = bool(fitted) and all(one.stated and one.times_noise <= far for one in fitted)
    settled = at_noise or 1 < len(found) == _agreeing(found)
    found_warnings += [_ran_away(one, settled=settled) for one, by in pairs if by.log and _times(one) > away]
    found_warnings += [Diagnostic(f"{one.name}: {wider}", "interval-widened") for one in numbers if one.widened]
    found_warnings += [_far_from_prior(one, known) for one, known in pairs if _leaves_prior(one, known)]
    found_warnings += [one.text for one in check.directions]
    found_warnings += [_too_far(one) for one in columns if one.stated and one.use == "fit" and one.times_noise > far]
    found_warnings += [doubt for source in sources for doubt in _doubts(source)]
    found_warnings += [_worse_than_fitted(one, columns) for one in columns if _times_fitted(one, columns) > far]
    if len(found) > 1:
        same = _agreeing(found)
        if same < len(found):
            text = f"{same} of {len(found)} initial guesses led to the best solution; others end at a higher cost"
            found_warnings.append(Diagnostic(text, "several-minima"))
    return tuple(found_warnings)
