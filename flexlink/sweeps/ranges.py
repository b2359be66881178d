"""Values that a sweep goes through: lists, ranges and random samples, as plain data.

A grid takes every combination of its axes, keys that go together count as one axis, and a sample draws points of the
unit cube, one coordinate a key, which its spreads map to values.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Literal, cast

import msgspec
import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.wording import truncated
from flexlink.describe.spec import Positive, Spec, decode
from flexlink.sweeps.sample_points import point

Spacing = Literal["linear", "log"]
Whole = Annotated[int, msgspec.Meta(ge=0)]

MAX_MEMBERS = 1_000_000_000
"""Of a sweep: two days on a core at a fifth of a millisecond each; Sobol's sequence has no more points."""


class Range(Spec, frozen=True):
    """Numbers between two ends, both counted in: `count` of them, or one every `step` from the first on.

    spacing = "log" makes neighbours differ by a factor. `whole` rounds to whole numbers, which `segments` asks for.
    """

    between: tuple[float, float]
    """First and last number."""
    count: Annotated[int, msgspec.Meta(ge=1, le=MAX_MEMBERS)] | None = None
    """How many numbers, or else `step`."""
    step: Positive | None = None
    """Distance of the numbers, or else `count`."""
    spacing: Spacing = "linear"
    """Whether neighbours differ by an amount (linear) or by a factor (log)."""
    whole: bool = False
    """Whether numbers are rounded to whole ones, as `segments` needs them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_ends(self.between, self.spacing)
        if (self.count is None) == (self.step is None):
            raise SceneError(
                "count, step: give exactly one of them, the number of values or their distance", id="range-of-values"
            )
        if self.step is not None and self.spacing == "log":
            raise SceneError(
                f"step = {self.step!r}: has no effect with spacing = 'log'; give count instead", id="range-of-values"
            )
        if self.step is not None and (self.between[1] - self.between[0]) / self.step >= MAX_MEMBERS:
            raise SceneError(
                f"step = {self.step!r}: gives more than {MAX_MEMBERS} values between {list(self.between)}; give a "
                "larger step",
                id="range-of-values",
            )

    def __len__(self) -> int:
        low, high = self.between
        if self.step is None:
            return cast("int", self.count)
        return math.floor((high - low) / self.step * (1 + 1e-12)) + 1  # 0.3/0.1 is 2.9999999999999996

    def __getitem__(self, k: int) -> float | int:
        """Number `k`: no list of them is made."""
        if not 0 <= k < len(self):
            raise IndexError(k)
        number = self._number(k)
        return round(number) if self.whole else number

    def _number(self, k: int) -> float:
        """As `np.linspace` and `np.geomspace` have it."""
        low, high = self.between
        if self.step is not None:
            return low + self.step * k
        last = cast("int", self.count) - 1
        if k in {0, last}:
            return high if k else low
        if self.spacing == "linear":
            return k * ((high - low) / last) + low
        first, end = np.log10([low, high]).tolist()
        return float(np.power(10.0, k * ((end - first) / last) + first))


class Spread(Spec, frozen=True):
    """Where a sampled key lies: anywhere `between` two ends (by its logarithm if spacing = "log"), or normal.

    `whole` draws whole numbers, both ends counted in. A normal distribution has a `mean` and a `deviation`.
    """

    between: tuple[float, float] | None = None
    """Least and largest number, all as likely; or else `mean` and `deviation`."""
    spacing: Spacing = "linear"
    """Whether all numbers are as likely (linear), or all logarithms (log)."""
    whole: bool = False
    """Whether whole numbers are drawn, both ends counted in."""
    mean: float | None = None
    """Mean of a normal distribution."""
    deviation: Positive | None = None
    """Standard deviation of a normal distribution."""

    def __post_init__(self) -> None:
        super().__post_init__()
        normal = self.mean is not None and self.deviation is not None
        if (self.between is None) != normal or (self.mean is None) != (self.deviation is None):
            raise SceneError(
                "between: a spread takes between = [least, most], or mean and deviation; give one of them",
                id="range-of-values",
            )
        if normal and (self.whole or self.spacing == "log"):
            raise SceneError(
                "mean: a normal distribution takes neither whole nor spacing; leave them out", id="range-of-values"
            )
        if self.whole and self.spacing == "log":
            raise SceneError(
                "whole = True: not defined with spacing = 'log'; leave one of them out", id="range-of-values"
            )
        if self.between is not None:
            _check_ends(self.between, self.spacing)

    def value(self, u: float) -> float | int:
        """The number at a part u of all, 0 ≤ u < 1: the inverse of the distribution."""
        if self.between is None:
            from scipy.special import ndtri  # noqa: PLC0415  only for normal distributions

            return float(cast("float", self.mean) + cast("float", self.deviation) * ndtri(max(u, 2.0**-54)))
        low, high = self.between
        if self.whole:
            return math.floor(low + u * (high - low + 1))
        return low * (high / low) ** u if self.spacing == "log" else low + u * (high - low)


class RandomDesign(Spec, frozen=True):
    """Points drawn at random: `count` of them, every key of `keys` with a list, of which one is drawn, or a spread.

    method = "latin": Latin hypercube, each key's values spread evenly by themselves, a million at most. "sobol",
    "halton": low-discrepancy sequences, scrambled. "random": independent. The same `seed` gives the same points.
    """

    keys: dict[str, Any]
    """What varies: each key with a list of values, or with a spread."""
    count: Annotated[int, msgspec.Meta(ge=1, le=MAX_MEMBERS)]
    """How many points."""
    method: Literal["latin", "random", "sobol", "halton"] = "latin"
    """Latin hypercube, independent points, or a sequence of Sobol or Halton, scrambled."""
    seed: Whole = 0
    """The same seed gives the same points."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = 1_000_000  # 8 MB for each key in every worker, drawn in a tenth of a second
        if self.method == "latin" and self.count > most:
            raise SceneError(
                f"count = {self.count}: a Latin hypercube is drawn as a whole, of {most} members at most; take "
                "method = 'sobol' or 'random', whose members are drawn one by one",
                id="range-of-values",
            )


Listed = Range | list[Any]


@dataclasses.dataclass(frozen=True)
class Axis:
    """Keys that vary together: for each of `count` numbers, a value of every key."""

    keys: tuple[str, ...]
    count: int
    at: Callable[[int], Sequence[Any]]


def grid_axis(key: str, values: Any) -> Axis:
    """The axis of one key of a grid: a list of its values, or a range.

    Raises
    ------
    SceneError
        It is neither, or empty.
    """
    listed = _listed(f"grid.{key}", values)
    return Axis((key,), len(listed), lambda k: (listed[k],))


def together_axis(table: Mapping[str, Any]) -> Axis:
    """The axis of keys whose values are taken in step; errors as above, and if the lists differ in length."""
    lists = {key: _listed(f"together.{key}", value) for key, value in table.items()}
    counts = {key: len(values) for key, values in lists.items()}
    if len(set(counts.values())) > 1:
        counted = truncated(counts)
        raise SceneError(
            f"together: lists of different length, {counted}; give every key equally many values", id="range-of-values"
        )
    columns = list(lists.values())
    return Axis(tuple(lists), len(columns[0]), lambda k: tuple(values[k] for values in columns))


def sample_axis(sample: RandomDesign) -> Axis:
    """The axis of a sample; errors as above."""
    if not sample.keys:
        raise SceneError("sample.keys: empty; name at least one key and its spread", id="empty")
    spreads = [_spread(f"sample.keys.{key}", spread) for key, spread in sample.keys.items()]

    def at(k: int) -> tuple[Any, ...]:
        place = point(sample.method, len(spreads), sample.count, sample.seed, k)
        return tuple(value(u) for value, u in zip(spreads, place, strict=True))

    return Axis(tuple(sample.keys), sample.count, at)


def _listed(path: str, values: Any) -> Listed:
    if isinstance(values, dict):
        return decode(values, Range, path)
    if not isinstance(values, list | tuple):
        got = truncated(values)
        raise SceneError(
            f"{path} = {got}: expected a list of values, or {{ between = [a, b], count = n }}", id="range-of-values"
        )
    if not values:
        raise SceneError(f"{path} = []: empty; a sweep needs at least one value of every key", id="empty")
    return list(values)


def _spread(path: str, spread: Any) -> Callable[[float], Any]:
    if isinstance(spread, dict):
        return decode(spread, Spread, path).value
    values = _listed(path, spread)
    return lambda u: values[int(u * len(values))]


def _check_ends(between: tuple[float, float], spacing: Spacing) -> None:
    low, high = between
    if not low <= high:
        raise SceneError(
            f"between = {list(between)}: the range is empty; the first end must not be larger", id="range-order"
        )
    if spacing == "log" and low <= 0:
        raise SceneError(f"between = {list(between)}: with spacing = 'log' both ends must be > 0", id="range-of-values")
