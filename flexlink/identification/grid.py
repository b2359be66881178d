"""Grid error of a fit: the change of every parameter when the model gets twice the hinges.

    x' = argmin cost of the refined model, from x     u = 4/3 |x' − x|

The factor is that of an error of order 2 (Richardson): the limit of infinitely many hinges differs from x by
(x' − x) / (1 − 2⁻²). Steps of the refined model are controlled by a tolerance, so u contains the error of fixed steps.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.variants import refined, segments_in_words
from flexlink.identification.data import Source
from flexlink.identification.estimate import Estimate
from flexlink.identification.identifiability import WIDE, Check
from flexlink.identification.likelihood import Likelihood, likelihood
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Found, Search

Grid = Literal["check", "auto", "ignore"]
"""Treatment of the grid error: estimate it; take enough segments; or ignore it, for data from the same chain."""
REFINED = 2.0
"""Factor between the numbers of hinges of the two models."""
RICHARDSON = 1 / (1 - REFINED**-2)
"""Ratio of the error of order 2 to the change by refinement."""
ENOUGH = 0.25
"""Grid error at which the number of segments is sufficient, relative to half the 95 % interval."""


class GridError(NamedTuple):
    """Change of all parameters between the model of a fit and the refined model.

    Attributes
    ----------
    change
        Change of every search coordinate, then of every gain and bias; empty if it is unknown, or is not estimated.
    doubt
        Why the change is unknown; None if it is known.
    refined
        Search on the refined model, and its solution; None if there is none.
    """

    change: Array
    doubt: Diagnostic | None = None
    refined: tuple[Search, Found] | None = None

    @property
    def errors(self) -> Array:
        """Error u of every parameter due to the grid."""
        return RICHARDSON * np.abs(self.change)


def refined_sources(sources: Sequence[Source], tolerance: float) -> list[Source]:
    """The same data, predicted by models with twice the hinges and with steps by a tolerance."""
    return [dataclasses.replace(one, scene=_refined(one.scene, tolerance)) for one in sources]


def _refined(scene: Scene, tolerance: float) -> Scene:
    finer = refined(scene, REFINED)
    return finer if finer.run.controlled else finer.varied({"run.relative_tolerance": tolerance})


def grid_error(search: Search, best: Found, at: Likelihood, tolerance: float) -> GridError:
    """Fit the refined model, from the solution of the model, with its likelihood and noise."""
    try:
        signals = Signals(refined_sources(search.signals.sources, tolerance), search.coordinates)
        finer = Search(signals, search.loss, coloured=search.coloured, watch=search.watch)
        signals.model(best.x)
        x = finer.least(best.x, best.blocks, rough=True)
        after = likelihood(signals, x, best.blocks)
    except FlexlinkError as error:
        return GridError(np.empty(0), _unknown(error))
    change = np.append(x - best.x, after.linear - at.linear)
    return GridError(change, None, (finer, Found(x, best.cost, best.blocks)))


def bends(scene: Scene) -> bool:
    """Whether a link of the scene bends, so that there is a grid error."""
    return any(link.flex != "rigid" for link in scene.arm.links)


def factor_needed(errors: Array, halves: Array) -> float:
    """Factor of the hinges that likely makes every grid error small against half its interval; 1 if all are.

    The factor is that of an error of order 4, as of most rules in small bending; the next fit checks it.
    """
    known = np.isfinite(halves) & (halves > 0)
    worst = (errors[known] / (ENOUGH * halves[known])).max(initial=0.0)
    return float(np.clip(worst**0.25, 1.5, 8.0)) if worst > 1 else 1.0


def warnings_of_grid(scene: Scene, numbers: Sequence[Estimate], grid: GridError) -> list[Diagnostic]:
    """Warnings about grid errors that exceed half of an interval, or that are unknown."""
    if grid.doubt is not None:
        return [grid.doubt]
    large = [one for one in numbers if one.u_num > one.statistical]
    if not large:
        return []
    factor = factor_needed(*np.array([(one.u_num, one.statistical) for one in numbers]).T)
    return [_warning(scene, [one.shifted(one.u_num) for one in large], factor)]


def grid_ahead(at: Likelihood, check: Check, tolerance: float) -> tuple[Array, tuple[Diagnostic, ...]]:
    """Expected grid error of every parameter at a point, and notes: one Gauss-Newton step on the refined model.

    x' − x = −J⁺ (y' − y) / σ, with the predictions y of the model and y' of the refined model.
    """
    try:
        finer = Signals(refined_sources(at.sources, tolerance), at.coordinates).model(at.x)
    except FlexlinkError as error:
        return np.empty(0), (_unknown(error),)
    predicted = [y for part in finer for y in part]
    apart = [(new - row.y) / row.block.σ for row, new in zip(at.every, predicted, strict=True)]
    changes = np.linalg.lstsq(at.scaled, np.concatenate([0 * at.of_priors, *apart]), rcond=None)[0]
    u = RICHARDSON * np.abs(changes[: len(at.x)])
    halves = WIDE * check.expected[: len(u)]
    large = np.flatnonzero(u > ENOUGH * halves)
    if not len(large):
        return u, ()
    shifts = [f"{check.names[k]} by {100 * u[k]:.2g} %" for k in large.tolist()]
    return u, (_warning(at.sources[0].scene, shifts, factor_needed(u, halves)),)


def _warning(scene: Scene, shifts: Sequence[str], factor: float) -> Diagnostic:
    enough = segments_in_words(refined(scene, factor))
    text = f"grid error: {segments_in_words(scene)} shift {' and '.join(shifts)}; take {enough} (--grid auto)"
    return Diagnostic(text, "grid-error")


def _unknown(error: FlexlinkError) -> Diagnostic:
    return Diagnostic(f"grid error not estimated: with twice the hinges, {error}", "grid-error-unknown")
