"""Residuals of every measured column: before the fit, after the fit, and with a free linear model."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.identification.block import Block, whiteness
from flexlink.identification.coordinates import guess_of, run_coordinates
from flexlink.identification.data import Source
from flexlink.identification.fitted import FittedColumn
from flexlink.identification.likelihood import Likelihood, Row, likelihood, row_of, white
from flexlink.identification.linear_reference import linear_models
from flexlink.identification.problem import FitProblem
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Found, Search


def columns_of(
    problem: FitProblem,
    signals: Signals,
    best: Found,
    start: Array,
    kept: Sequence[Source],
    report: Callable[[str], None],
) -> tuple[FittedColumn, ...]:
    """All columns: first the fitted ones, then the columns of the sources `kept` to check the fit."""
    before = likelihood(signals, start, [[white(block) for block in part] for part in best.blocks])
    after = likelihood(signals, best.x, best.blocks)
    found, gains = _beside(before, after), _gains(after.every)
    noises = {row.block.name: _noise(row.block) for row in after.every}
    values = {one.path: one.value(float(x)) for one, x in zip(signals.coordinates, best.x, strict=True) if not one.run}
    fitted = [(one, signals.scene(k, best.x)) for k, one in enumerate(signals.sources) if one.is_run]
    checks: list[tuple[Source, Scene]] = []
    for source in kept:
        source.blocks = tuple(_known(block, gains, noises) for block in source.blocks)
        columns, scene = _kept(problem, source, values, gains)
        found += columns
        checks += [(source, scene)] if source.is_run else []
        report(f"checked against {source.name}")
    return tuple(_with_linear(found, fitted, checks))


def _with_linear(
    columns: Sequence[FittedColumn], fitted: Sequence[tuple[Source, Scene]], kept: Sequence[tuple[Source, Scene]]
) -> list[FittedColumn]:
    """The same columns; columns of runs also contain the predictions of a free linear model."""
    models = linear_models(fitted, kept)
    if models is None:
        return list(columns)
    runs = [source for source, _ in (*fitted, *kept)]
    given = {
        (source.name, block.name): model
        for source, several in zip(runs, models, strict=True)
        for block, model in zip(source.blocks, several, strict=True)
    }
    return [dataclasses.replace(one, linear=given.get((one.source, one.name))) for one in columns]


def _kept(
    problem: FitProblem, source: Source, values: dict[str, float], gains: dict[str, float]
) -> tuple[list[FittedColumn], Scene]:
    """Columns and scene of a source that was not fitted, after estimating only the parameters specific to this run."""
    this_run = next((run for run in problem.run if run.name == source.name), None)
    coordinates = run_coordinates(problem, this_run) if this_run is not None else []
    signals, x = Signals([source], coordinates), guess_of(coordinates)
    before = likelihood(signals, _best(signals, problem, x), [source.blocks])
    source.scene = source.scene.varied(values)
    signals = Signals([source], coordinates)
    x = _best(signals, problem, x)
    rows = [row_of(b, gains.get(b.name, 1.0) * y) for b, y in zip(source.blocks, signals.model(x)[0], strict=True)]
    columns = _beside(before, before._replace(rows=[rows]))
    columns = [dataclasses.replace(one, gain=gains.get(one.name, one.gain)) for one in columns]
    return columns, signals.scene(0, x)


def _best(signals: Signals, problem: FitProblem, x: Array) -> Array:
    return Search(signals, problem.loss).from_start(x).x if len(x) else x


def _beside(before: Likelihood, after: Likelihood) -> list[FittedColumn]:
    found = []
    for source, old, new in zip(after.sources, before.rows, after.rows, strict=True):
        for was, now in zip(old, new, strict=True):
            block, residual = now.block, now.shown - now.block.y
            found.append(
                FittedColumn(
                    source=source.name, name=block.name, use=source.use, t=block.t, measured=block.y, before=was.shown,
                    after=now.shown, linear=None, gain=now.gain, bias=now.bias, noise=_noise(block),
                    stated=block.stated, times_noise=float(np.sqrt(np.mean((residual / white(block).σ) ** 2))),
                    whiteness=whiteness(residual) if block.t is not None else float("nan"),
                )
            )  # fmt: skip
    return found


def _noise(block: Block) -> float:
    """Root mean square of the standard deviation of a block's noise."""
    return float(np.sqrt(np.mean(white(block).σ ** 2)))


def _gains(rows: Sequence[Row]) -> dict[str, float]:
    """Estimated gain of each column, averaged over the runs that contain the column."""
    found: dict[str, list[float]] = {}
    for row in rows:
        if row.block.gain:
            found.setdefault(row.block.name, []).append(row.gain)
    return {name: float(np.mean(several)) for name, several in found.items()}


def _known(block: Block, gains: dict[str, float], noises: dict[str, float]) -> Block:
    """A check block that uses the estimated gain of its column and, if its noise is not stated, the estimated noise."""
    σ = block.σ if block.stated or block.name not in noises else np.full(len(block.y), noises[block.name])
    return dataclasses.replace(block, gain=block.gain and block.name not in gains, σ=σ)
