"""Noise of each column from other sources than the model's residual, and whether the residual is no more than noise.

    F = mean r² / σ²        r the residual, n / Σ ρ² independent samples; σ the noise, from as many as its source has

The noise is the first of these: as stated; the difference of two runs of one scene, over √2; the rest before the model
moves; the upper part of the spectrum, if it is white there. White noise is as strong at low frequencies, where models
err, so F is also computed for the lower parts of the residual's spectrum. Each is compared with Fisher's distribution.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array
from flexlink.identification.block import Block, colour_of, noise_in, outlying
from flexlink.identification.data import Source
from flexlink.identification.fitted import FittedColumn
from flexlink.identification.likelihood import Likelihood
from flexlink.identification.problem import FitRun

LEVEL = 0.001
"""Probability that noise alone of one fit is called unexplained, by Bonferroni's inequality over columns and parts."""
LINES = 2 / 1.5  # independent values per line of a spectrum: two, over the equivalent bandwidth of a Hann window


class Floor(NamedTuple):
    """Noise of a column: standard deviation, number of independent samples behind it, and where it comes from."""

    σ: float
    freedom: float
    words: str
    white: bool = False


def floor_of(block: Block, y: Array, repeats: Sequence[Block]) -> Floor | None:
    """Noise of a run's column with the prediction y, (n,); None if nothing but the residual shows it."""
    known = 50  # independent samples that a stated number is worth: it is known to 10 %
    moves, enough = 1e-3, 30  # motion that ends the rest, relative to its range; fewest samples of a rest
    if block.stated:
        return Floor(float(np.sqrt(np.mean(block.σ**2))), known, "as stated")
    for other in repeats:
        if other.name == block.name and np.array_equal(np.asarray(other.t), np.asarray(block.t)):
            return _of_samples((other.y - block.y) / np.sqrt(2), "from a repeated run")
    still = int(np.argmax(np.abs(y - y[0]) > moves * np.ptp(y)))
    if still >= enough:
        return _of_samples(block.y[:still], "from the rest before the move")
    σ, n = noise_in(block, fewest=15), 0.6 * len(block.y) / 2  # n: lines above 0.4 of the Nyquist frequency
    return None if σ is None else Floor(σ, LINES * n, "from high frequencies", white=True)


def _of_samples(e: Array, words: str) -> Floor | None:
    e = e - e.mean()
    return Floor(float(e.std()), len(e) / colour_of(e).correlation_length, words) if e.any() else None


def excess(residual: Array, floor: Floor) -> Iterator[tuple[float, float]]:
    """Ratio of the mean square of a residual, (n,), to the noise, and the samples behind it: of all, then of parts."""
    yield float(np.mean(residual**2)) / floor.σ**2, len(residual) / colour_of(residual).correlation_length
    window = np.hanning(len(residual))
    power = np.abs(np.fft.rfft(window * residual)) ** 2 / float(window @ window)
    parts = (int(part * len(power)) for part in (0.4, 0.16, 0.064) if floor.white)
    yield from ((float(power[:n].mean()) / floor.σ**2, LINES * n) for n in parts if n >= 4)


def with_floors(
    columns: Sequence[FittedColumn], at: Likelihood, runs: Sequence[FitRun], checks: Sequence[Source]
) -> tuple[FittedColumn, ...]:
    """The columns, with the noise of the fitted ones, and whether their residuals are no more than that."""
    rounding = 1e-5  # smallest noise, relative to the range
    found, of_run = {(one.source, one.name): one for one in columns}, {run.name: run for run in runs}
    level = LEVEL / max(sum(row.block.t is not None for row in at.every), 1)
    for source, row in ((source, row) for source, part in zip(at.sources, at.rows, strict=True) for row in part):
        if source.name not in of_run:  # single measurements
            continue
        own, key = of_run[source.name], (source.name, row.block.name)
        again = [one for one in (*at.sources, *checks) if one is not source and one.name in of_run]
        again = [one for one in again if of_run[one.name].set == own.set and not own.parameter]
        residual = (row.shown - row.block.y) * row.block.used
        residual = np.where(outlying(residual), 0.0, residual)  # other warnings name outliers
        floor = floor_of(row.block, row.y, [block for one in again for block in one.blocks])
        if np.sqrt(np.mean(residual**2)) <= rounding * np.ptp(row.block.y):
            found[key] = dataclasses.replace(found[key], within=True)
        elif floor is not None:
            tests = [*excess(residual, floor)]
            within = all(scipy.special.fdtri(n, floor.freedom, 1 - level / len(tests)) >= F for F, n in tests)
            found[key] = dataclasses.replace(found[key], floor=floor.σ, floor_from=floor.words, within=within)
    return tuple(found.values())


def warnings_of_floors(columns: Sequence[FittedColumn], named: Sequence[Diagnostic]) -> Iterator[Diagnostic]:
    """Warnings about columns that the model does not explain, and about those whose noise nothing shows."""
    beyond, lacks = "parameters may be off by more than their intervals", "the model does not explain"
    above = [one for one in columns if one.within is False]
    for one in above:
        text = f"{lacks} {one.source}, {one.name}: {one.unexplained:.2g} % of the signal is left, "
        times = one.off(one.after) / (one.floor or 1.0)
        yield Diagnostic(f"{text}{times:.2g} times its noise ({one.floor_from}); {beyond}", "not-explained")
    if named and not above:
        yield Diagnostic(f"{lacks} the data, which are {named[0]}; {beyond}", "not-explained")
    fitted = [one for one in columns if one.use == "fit" and one.t is not None]
    unknown = " and ".join(f"{one.source}, {one.name}" for one in fitted if one.within is None)
    if unknown and not above and not named:
        text = f"noise of {unknown} is not known, so only known causes and faults were looked for in the residuals"
        yield Diagnostic(f"{text}; state noise, or fit a repeated run as well", "noise-not-known")
