"""Values of a sweep: lists, ranges and random samples, on a grid of axes or mapped by spreads from a unit cube."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from threading import Lock
from typing import Annotated, Any, Literal, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.spec import Positive, Spec, decode

Spacing = Literal["linear", "log"]
Whole = Annotated[int, msgspec.Meta(ge=0)]

MAX_MEMBERS = 1_000_000_000
"""Largest number of members, and of points in Sobol's sequence; at 0.2 ms each, they take two days on one core."""


class Range(Spec, frozen=True):
    """Numbers between two ends, which are included: `count` numbers, or one every `step` from the first end.

    With spacing = "log", neighbours have a constant ratio. `whole` rounds to integers, for example for `segments`.
    """

    between: tuple[float, float]
    """First and last number."""
    count: Annotated[int, msgspec.Meta(ge=1, le=MAX_MEMBERS)] | None = None
    """Number of values; alternative to `step`."""
    step: Positive | None = None
    """Distance between values; alternative to `count`."""
    spacing: Spacing = "linear"
    """Whether neighbours differ by a constant amount (linear) or by a constant factor (log)."""
    whole: bool = False
    """Whether to round to integers, for example for `segments`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_ends(self.between, self.spacing)
        if (self.count is None) == (self.step is None):
            why = "count, step: specify exactly one, the number of values or their distance"
            raise SceneError(why, id="range-of-values")
        if self.step is not None and self.spacing == "log":
            why = f"step = {self.step!r}: has no effect with spacing = 'log'; use count instead"
            raise SceneError(why, id="range-of-values")
        if self.step is not None and (self.between[1] - self.between[0]) / self.step >= MAX_MEMBERS:
            why = f"step = {self.step!r}: gives more than {MAX_MEMBERS} values between {list(self.between)}"
            raise SceneError(f"{why}; use a larger step", id="range-of-values")

    def __len__(self) -> int:
        low, high = self.between
        if self.step is None:
            return cast("int", self.count)
        return math.floor((high - low) / self.step * (1 + 1e-12)) + 1  # 0.3/0.1 is 2.9999999999999996

    def __getitem__(self, k: int) -> float | int:
        """Return number `k`, without a list of all numbers."""
        if not 0 <= k < len(self):
            raise IndexError(k)
        low, high = self.between
        last = len(self) - 1
        if self.step is not None:
            number = low + self.step * k
        elif k in {0, last}:
            number = high if k else low
        elif self.spacing == "linear":  # as in `np.linspace`
            number = k * ((high - low) / last) + low
        else:  # as in `np.geomspace`
            first, end = np.log10([low, high]).tolist()
            number = float(np.power(10.0, k * ((end - first) / last) + first))
        return round(number) if self.whole else number


class Spread(Spec, frozen=True):
    """Distribution of a sampled key: normal, or uniform `between` two ends (uniform logarithm if spacing = "log").

    `whole` draws integers, including both ends. A normal distribution has a `mean` and a `deviation`.
    """

    between: tuple[float, float] | None = None
    """Ends of a uniform distribution; alternative to `mean` and `deviation`."""
    spacing: Spacing = "linear"
    """Whether the number (linear) or its logarithm (log) is uniformly distributed."""
    whole: bool = False
    """Whether to draw integers, including both ends."""
    mean: float | None = None
    """Mean of a normal distribution."""
    deviation: Positive | None = None
    """Standard deviation of a normal distribution."""

    def __post_init__(self) -> None:
        super().__post_init__()
        normal = self.mean is not None and self.deviation is not None
        if (self.between is None) != normal or (self.mean is None) != (self.deviation is None):
            why = "between: specify either between = [low, high], or mean and deviation"
            raise SceneError(why, id="range-of-values")
        if self.mean and self.deviation and self.deviation < 1e-9 * abs(self.mean):
            why = f"deviation = {self.deviation}: in the unit of the value, not relative; it is too small for mean"
            raise SceneError(f"{why} = {self.mean}", id="range-of-values")
        if normal and (self.whole or self.spacing == "log"):
            why = "mean: a normal distribution takes neither whole nor spacing; remove them"
            raise SceneError(why, id="range-of-values")
        if self.whole and self.spacing == "log":
            raise SceneError("whole = True: not defined with spacing = 'log'; remove one of them", id="range-of-values")
        if self.between is not None:
            _check_ends(self.between, self.spacing)

    def value(self, u: float) -> float | int:
        """Inverse of the distribution function: the number with cumulative probability u, 0 ≤ u < 1."""
        if self.between is None:
            from scipy.special import ndtri  # noqa: PLC0415  only for normal distributions

            return float(cast("float", self.mean) + cast("float", self.deviation) * ndtri(max(u, 2.0**-54)))
        low, high = self.between
        if self.whole:
            return math.floor(low + u * (high - low + 1))
        return low * (high / low) ** u if self.spacing == "log" else low + u * (high - low)


class RandomDesign(Spec, frozen=True):
    """Random points: `count` of them, with a list of values or a spread for each of the `keys`.

    The method "latin" is a Latin hypercube of at most a million points, with evenly spread values of each key. "sobol"
    and "halton" are scrambled low-discrepancy sequences. "random" gives independent points. The same `seed` gives the
    same points.
    """

    keys: dict[str, Any]
    """Varied keys, each with a list of values or a spread."""
    count: Annotated[int, msgspec.Meta(ge=1, le=MAX_MEMBERS)]
    """Number of points."""
    method: Literal["latin", "random", "sobol", "halton"] = "latin"
    """Latin hypercube, independent points, or a scrambled Sobol or Halton sequence."""
    seed: Whole = 0
    """Seed of the points."""

    def __post_init__(self) -> None:
        super().__post_init__()
        most = 1_000_000  # 8 MB per key in every worker, computed in a tenth of a second
        if self.method == "latin" and self.count > most:
            why = f"count = {self.count}: a Latin hypercube has at most {most} members, since all are computed together"
            raise SceneError(f"{why}; use method = 'sobol' or 'random'", id="range-of-values")


@dataclasses.dataclass(frozen=True)
class Axis:
    """Keys that vary together: `at(k)` returns a value of every key for k = 0 … `count` − 1."""

    keys: tuple[str, ...]
    count: int
    at: Callable[[int], Sequence[Any]]
    drawn: Callable[[int], Sequence[float]] | None = None

    def places(self, k: int) -> Sequence[float]:
        """Return where the value of every key is among all its values, 0 ≤ u < 1."""
        return self.drawn(k) if self.drawn else [k / self.count] * len(self.keys)


def grid_axis(key: str, values: Any) -> Axis:
    """Axis of one key of a grid: a list of its values, or a range."""
    listed = _listed(f"grid.{key}", values)
    return Axis((key,), len(listed), lambda k: (listed[k],))


def together_axis(table: Mapping[str, Any]) -> Axis:
    """Axis of keys whose values are paired."""
    lists = {key: _listed(f"together.{key}", value) for key, value in table.items()}
    counts = {key: len(values) for key, values in lists.items()}
    if len(set(counts.values())) > 1:
        why = f"together: lists of different lengths, {truncated(counts)}; every key needs the same number of values"
        raise SceneError(why, id="range-of-values")
    columns = list(lists.values())
    return Axis(tuple(lists), len(columns[0]), lambda k: tuple(values[k] for values in columns))


def sample_axis(sample: RandomDesign) -> Axis:
    """Axis of a sample."""
    if not sample.keys:
        raise SceneError("sample.keys: empty; specify at least one key and its spread", id="empty")
    spreads = [_spread(f"sample.keys.{key}", spread) for key, spread in sample.keys.items()]

    def drawn(k: int) -> list[float]:
        return point(sample.method, len(spreads), sample.count, sample.seed, k)

    def at(k: int) -> tuple[Any, ...]:
        return tuple(value(u) for value, u in zip(spreads, drawn(k), strict=True))

    return Axis(tuple(sample.keys), sample.count, at, drawn)


def _listed(path: str, values: Any) -> Range | list[Any]:
    if isinstance(values, dict):
        return decode(values, Range, path)
    if not isinstance(values, list | tuple):
        why = f"{path} = {truncated(values)}: expected a list of values, or {{ between = [a, b], count = n }}"
        raise SceneError(why, id="range-of-values")
    if not values:
        raise SceneError(f"{path} = []: empty; a sweep needs at least one value for every key", id="empty")
    return list(values)


def _spread(path: str, spread: Any) -> Callable[[float], Any]:
    if isinstance(spread, dict):
        return decode(spread, Spread, path).value
    values = _listed(path, spread)
    return lambda u: values[int(u * len(values))]


def _check_ends(between: tuple[float, float], spacing: Spacing) -> None:
    low, high = between
    if not low <= high:
        why = f"between = {list(between)}: the range is empty; the first end must not be larger"
        raise SceneError(why, id="range-order")
    if spacing == "log" and low <= 0:
        raise SceneError(f"between = {list(between)}: with spacing = 'log' both ends must be > 0", id="range-of-values")


# Points of the unit cube for the members of a sample, computed from their number and the seed without a stored list.
#
# For "random", the generator is advanced to the point. For "sobol", point n is the exclusive or of direction numbers,
# one for each digit 1 of n's binary Gray code. Direction numbers are computed from SciPy's points 0, 1, 3, 7, 15, ….
# For "halton", each point is computed from its number. For "latin", all points are computed together, because points of
# a Latin hypercube depend on each other.


BLOCK = 1024  # number of points to compute together; a power of two preserves the balance of Sobol's sequence

DIGITS = 30  # number of binary digits of Sobol's points

_halton_moves = Lock()


def point(method: str, dimensions: int, count: int, seed: int, k: int) -> list[float]:
    """Return point `k` of `count`: one number 0 ≤ u < 1 per dimension."""
    return _block(method, dimensions, count, seed, k // BLOCK)[k % BLOCK]


@functools.lru_cache(maxsize=16)
def _block(method: str, dimensions: int, count: int, seed: int, number: int) -> list[list[float]]:
    """Return `BLOCK` consecutive points."""
    first = number * BLOCK
    if method == "random":
        bits = np.random.default_rng(seed).bit_generator
        bits.advance(first * dimensions)  # type: ignore[attr-defined]
        points = np.random.Generator(bits).random((BLOCK, dimensions))
    elif method == "sobol":
        points = _sobol(dimensions, count, seed, first)
    elif method == "halton":
        with _halton_moves:  # the engine is shared by several threads
            engine = _halton(dimensions, seed)
            engine.num_generated = first  # its `fast_forward` would compute all previous points
            points = engine.random(BLOCK)
    else:
        points = _latin(dimensions, count, seed)[first : first + BLOCK]
    found: list[list[float]] = points.tolist()
    return found


@functools.lru_cache(maxsize=2)
def _latin(dimensions: int, count: int, seed: int) -> Array:
    """All points, equal to the points from SciPy's engine, whose import would take half a second."""
    (rng,) = np.random.default_rng(seed).spawn(1)
    inside = rng.uniform(size=(count, dimensions))
    cells = np.tile(np.arange(1, count + 1), (dimensions, 1))
    for row in cells:
        rng.shuffle(row)
    return np.asarray((cells.T - inside) / count)


@functools.lru_cache(maxsize=2)
def _halton(dimensions: int, seed: int) -> Any:
    return _qmc().Halton(dimensions, rng=np.random.default_rng(seed))


def _sobol(dimensions: int, count: int, seed: int, first: int) -> Array:
    start, directions = _directions(dimensions, max(count - 1, first + BLOCK - 1).bit_length(), seed)
    numbers = np.arange(first, first + BLOCK)
    gray = numbers ^ (numbers >> 1)
    digits = np.repeat(start[None], BLOCK, axis=0)
    for i, direction in enumerate(directions):
        digits ^= np.where((gray >> i & 1)[:, None], direction, 0)
    return np.ldexp(digits.astype(np.float64), -DIGITS)


@functools.lru_cache(maxsize=4)
def _directions(dimensions: int, length: int, seed: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First point as an integer, and direction numbers for Gray codes of `length` digits, shape (length, d)."""
    engine = _qmc().Sobol(dimensions, bits=DIGITS, rng=np.random.default_rng(seed))

    def next_point() -> NDArray[np.int64]:
        return np.asarray(np.ldexp(engine.random(1)[0], DIGITS), dtype=np.int64)

    start, directions = next_point(), np.zeros((length, dimensions), dtype=np.int64)
    for i in range(length):
        if ahead := 2 ** (i + 1) - 1 - engine.num_generated:
            engine.fast_forward(ahead)
        directions[i] = next_point() ^ start
    return start, directions


def _qmc() -> Any:
    from scipy.stats import qmc  # noqa: PLC0415  the import takes 0.5 s; only for Sobol and Halton

    return qmc
