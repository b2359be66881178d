"""Search for the parameters: fit single measurements first, then runs in growing windows, from several guesses."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.block import Block, colour_of, outlying, unlikelihood
from flexlink.identification.coordinates import Coordinate, guess_of
from flexlink.identification.likelihood import LOSSES, Likelihood, Row, likelihood, white
from flexlink.identification.problem import Loss
from flexlink.identification.signals import Signals

ROUNDS = 2  # number of times that unstated noise is re-estimated from the residuals


class Found(NamedTuple):
    """Solution of a search."""

    x: Array  # coordinates of the solution
    cost: float  # half the sum of squares, with the noise assumed at the start
    blocks: list[list[Block]]  # blocks of every source, with the final estimate of the noise


class Search:
    """Search for the maximum of the likelihood; `coloured`: the noise of runs may be autocorrelated.

    The loss is one of `scipy.optimize.least_squares`; `watch` is called with "" after each Jacobian (`watch_with`).
    """

    def __init__(
        self, signals: Signals, loss: Loss, *, coloured: bool = False, watch: Callable[[str], None] | None = None
    ) -> None:
        self.signals, self.loss, self.coloured = signals, loss, coloured
        self.watch = watch or watch_with(None, 1)
        self.coordinates: Sequence[Coordinate] = signals.coordinates

    def at(self, x: Array, blocks: Sequence[Sequence[Block]]) -> Likelihood:
        """Likelihood at a point, with Jacobians."""
        return likelihood(self.signals, x, blocks, self.signals.slopes(x))

    def cost(self, x: Array, blocks: Sequence[Sequence[Block]]) -> float:
        """Half the sum of the losses of all residuals; half the sum of squares for least squares."""
        return 0.5 * float(np.sum(LOSSES[self.loss].rho(self._residual(x, blocks))))

    def unlikelihood(self, x: Array, blocks: Sequence[Sequence[Block]]) -> float:
        """−2 ln of the posterior at a point, up to a constant; the noise of runs is estimated from the residuals there.

        The AR coefficients are penalized, so that a higher order alone does not make a point more likely.
        """
        at = likelihood(self.signals, x, [[white(block) for block in part] for part in blocks])
        total = float(at.of_priors @ at.of_priors)
        for row in at.every:
            if row.block.t is None:
                total += float(row.residual @ row.residual)
            else:
                total += unlikelihood(LOSSES[self.loss].psi(row.residual))
        return total

    def weighed(self, x: Array, blocks: Sequence[Sequence[Block]], *, coloured: bool = False) -> list[list[Block]]:
        """The blocks, with the AR model and any unstated deviation of the noise estimated from residuals at a point."""
        plain = [[dataclasses.replace(white(block), left_out=None) for block in part] for part in blocks]
        rows = likelihood(self.signals, x, plain).rows
        return [[_with(row, self.loss, coloured=coloured) for row in part] for part in rows]

    def least(
        self, x: Array, blocks: Sequence[Sequence[Block]], *, rough: bool = False, held: int | None = None,
        most: int = 30,
    ) -> Array:  # fmt: skip
        """Minimum of the cost near a point; the coordinate `held` is fixed; a rough search has `most` evaluations."""
        free = np.arange(len(x)) != held
        if not free.any():
            return x
        bounds = np.array([one.bounds for one in self.coordinates]).T[:, free]
        trimmed = any(block.left_out is not None for part in blocks for block in part)
        loss = self.loss if self.loss != "trimmed" else "linear" if trimmed else "soft_l1"
        change = 1e-4 if rough else 1e-12  # tolerance of an intermediate, and of the final search
        smallest = 1e-8  # step of x: the cost of runs is accurate to 1e-11, which makes smaller steps meaningless

        def whole(part: Array) -> Array:
            point = x.copy()
            point[free] = part
            return point

        found = scipy.optimize.least_squares(
            lambda part: self._residual(whole(part), blocks), np.clip(x[free], *bounds),
            lambda part: self._jacobian(whole(part), blocks)[:, free], bounds=bounds, loss=loss, x_scale=1.0,
            max_nfev=most if rough else 100, ftol=change, xtol=max(smallest, change), gtol=change,
        )  # fmt: skip
        return whole(np.asarray(found.x))

    def from_start(self, x: Array) -> Found:
        """Search from an initial guess."""
        sources = self.signals.sources
        self.signals.model(x)
        blocks, runs = [list(source.blocks) for source in sources], any(source.is_run for source in sources)
        x = self.grown(x)
        every = [block for part in blocks for block in part]
        unstated = len(every) > 1 and not all(block.stated for block in every)  # noise that affects the solution
        weighs = unstated or self.loss == "trimmed"
        last = not (self.coloured or weighs) or not runs
        x = self.least(x, blocks, rough=not last)
        cost = self.cost(x, blocks)
        if not runs:
            return Found(x, cost, blocks)
        for _ in range(ROUNDS - self.coloured if weighs else 0):
            blocks = self.weighed(x, blocks)
            x = self.least(x, blocks)
        blocks = self.weighed(x, blocks)
        return self._coloured(Found(x, cost, blocks)) if self.coloured else Found(x, cost, blocks)

    def grown(self, x: Array, most: int = 30) -> Array:
        """Coordinates x after rough searches: of responses' magnitudes, single measurements, and parts of runs."""
        windows = 0.0, 0.15, 0.4  # the cost of a long run has false minima a period apart
        sources = self.signals.sources
        single, rough = [one for one in sources if not one.is_run], [one.rough for one in sources if one.rough]
        parts = [[*(one.first(end) for one in sources if one.is_run and end), *single] for end in windows]
        for known in (rough, *(parts if len(single) < len(sources) else ())):
            if known:
                part = Search(Signals(known, self.coordinates), self.loss, watch=self.watch)
                x = part.least(x, [list(one.blocks) for one in known], rough=True, most=most)
        return x

    def _coloured(self, plain: Found) -> Found:
        """Continue the search with autocorrelated noise.

        If the cost becomes clearly larger than with white noise, the residuals are a model error, not noise; the
        solution with white noise is then returned.
        """
        more = 1.1  # largest cost with autocorrelated noise, relative to the cost with white noise
        x, blocks = plain.x, plain.blocks
        for _ in range(ROUNDS):
            blocks = self.weighed(x, blocks, coloured=True)
            x = self.least(x, blocks)
        if self.cost(x, plain.blocks) > more * self.cost(plain.x, plain.blocks):
            return plain
        return Found(x, plain.cost, self.weighed(x, blocks, coloured=True))

    def _residual(self, x: Array, blocks: Sequence[Sequence[Block]]) -> Array:
        nowhere = 1e8  # residual at points where the simulation fails, from which the search turns back
        try:
            return likelihood(self.signals, x, blocks).residual
        except FlexlinkError:
            priors = sum(one.prior is not None for one in self.coordinates)
            return np.full(sum(len(b.y) for part in blocks for b in part) + priors, nowhere)

    def _jacobian(self, x: Array, blocks: Sequence[Sequence[Block]]) -> Array:
        self.watch("")
        return self.at(x, blocks).slopes


def start_points(coordinates: Sequence[Coordinate], count: int) -> list[Array]:
    """The problem's initial guess, then points spread evenly within the bounds, at most a factor of 2 away."""
    guess = guess_of(coordinates)
    low, high = np.array([_around(one) for one in coordinates]).T
    if count < 2:
        return [guess]
    return [guess, *(low + (high - low) * scipy.stats.qmc.LatinHypercube(len(guess), seed=0).random(count - 1))]


def _around(one: Coordinate) -> tuple[float, float]:
    far, x = np.log(2.0) if one.log else 1.0, one.x(one.start)
    low, high = one.bounds
    if one.prior is not None:
        x, far = one.x(one.prior[0]), min(far, 2 * one.prior[1] / one.size(one.prior[0]))
    return max(low, x - far), min(high, x + far)


def _with(row: Row, loss: Loss, *, coloured: bool) -> Block:
    block, e = row.block, row.residual * row.block.σ
    if not e.any():
        return block
    size = float(np.sqrt(np.mean(e**2)))
    if loss != "linear" and block.t is not None:
        far = outlying(e)
        e, size = np.where(far, 0.0, e), float(np.sqrt(np.mean(e[~far] ** 2)))
        block = dataclasses.replace(block, left_out=far) if loss == "trimmed" else block
    σ = block.σ if block.stated else np.full(len(e), size)
    if not coloured or block.t is None:
        return dataclasses.replace(block, σ=σ)
    colour = colour_of(e)
    return dataclasses.replace(block, σ=σ * colour.share, colour=colour)


Bar = Callable[[float, str], None]


def watch_with(bar: Bar | None, parts: int) -> Callable[[str], None]:
    """Function that updates `bar`: call it with the name of each part that begins, and with "" after each iteration."""
    if bar is None:
        return lambda part: None
    name, begun, iterations = "", 0, 0

    def watch(part: str) -> None:
        nonlocal name, begun, iterations
        name, begun, iterations = (part, begun + 1, 0) if part else (name, begun, iterations + 1)
        bar((begun - 1) / parts, f"{name}, iteration {iterations}")

    return watch
