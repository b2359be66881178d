"""Statistics of the outputs of a sweep, gathered where its members run; their rows are not stored.

A summary consists of whole numbers that are added: counts, and sums of powers of outputs, since every float64 is a
multiple of 2⁻¹⁰⁷⁴. It is exact, so it depends on no order of members, tasks and parts. An output y has

    mean, deviation, skewness, kurtosis   from Σ yᵖ, p = 1 … 4; each is rounded once
    quantiles                             from the number of values in classes, whose middle is right to 1/2048
    S_k = Var(E[y | x_k]) / Var(y)        Sobol's first-order index of each varied key x_k, from its 32 classes c

        Var(E[y | x_k]) = (Σ_c n_c (m_c − m)² − (C − 1) W) / n        W = Σ_c Σ (y − m_c)² / (n − C)

with means m_c of the members whose x_k is in class c. The term with W removes what the scatter of the m_c adds.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Annotated, Any, NamedTuple, TypeAlias

import msgspec

from flexlink.describe.spec import Spec

Plan: TypeAlias = Any  # that of `plan`, which imports this module
Row: TypeAlias = Any  # that of `worker`
DIGITS = 1074  # a float64 is a whole multiple of 2^−DIGITS
CLASSES = 32  # of a varied key; a linear influence loses 1/CLASSES² of its index
SHIFT = 42  # bits of a float64 within a class of values; sign, exponent and ten bits of the mantissa remain
Share = Annotated[float, msgspec.Meta(gt=0, lt=1)]


class Statistics(Spec, frozen=True):
    """What is stated of each output of a sweep, in place of a row for each member."""

    quantiles: tuple[Share, ...] = (0.05, 0.5, 0.95)
    """Shares of the members below each quantile, which is right to 1/2048 of its value."""


class Summary(NamedTuple):
    """What some members add to the statistics."""

    members: list[tuple[int, int]]  # ranges [first, stop) of numbers, in order
    sums: Counter[tuple[Any, ...]]  # by (output, power), (output, "class", class), (output, key, class, power)
    largest: dict[tuple[str, int], float]  # of sign · y, by (output, sign)
    failed: list[tuple[int, str]]  # number and reason of the first failed member

    def add(self, other: Summary) -> None:
        """Add the members of another summary."""
        self.members[:] = ranges([*self.members, *other.members])
        self.sums.update(other.sums)
        for key, value in other.largest.items():
            self.largest[key] = max(value, self.largest.get(key, value))
        self.failed[:] = sorted([*self.failed, *other.failed])[:1]


def empty() -> Summary:
    """The summary of no members."""
    return Summary([], Counter(), {}, [])


def kept(plan: Plan, rows: Sequence[Row]) -> Sequence[Row | Summary]:
    """What is kept of rows: their summary if the sweep has `statistics`, else the rows."""
    if plan.sweep.statistics is None or not rows:
        return rows
    failed = sorted((row.number, row.reason) for row in rows if row.status == "failed")
    sums = Counter({("failed",): len(failed), ("warned",): sum(bool(row.warnings) for row in rows)})
    members = ranges([(row.number, row.number + 1) for row in rows])
    found = Summary(members, sums, {}, failed[:1])
    places = [plan.places(row.number) for row in rows]
    for k, name in enumerate(plan.sweep.quantity):
        there = [(y, places[i]) for i, row in enumerate(rows) if (y := row.values[k]) is not None and math.isfinite(y)]
        if there:
            _add_output(name, there, found)
    return [found]


def _add_output(name: str, members: list[tuple[float, dict[str, float]]], to: Summary) -> None:
    """Add the values of an output, each with the places of the member's varied keys."""
    values = [y for y, _ in members]
    ratios = [float(y).as_integer_ratio() for y in values]
    digits = max(denominator for _, denominator in ratios).bit_length() - 1
    w = [(n << digits) // d for n, d in ratios]  # the whole numbers y · 2^digits
    scale = [p * (DIGITS - digits) for p in range(5)]
    to.sums.update({(name, p): sum(each**p for each in w) << scale[p] for p in range(5)})
    to.sums.update((name, "class", struct.unpack("<q", struct.pack("<d", y))[0] >> SHIFT) for y in values)
    for key in members[0][1]:
        classes: dict[int, list[int]] = {}
        for (_, place), each in zip(members, w, strict=True):
            classes.setdefault(int(place[key] * CLASSES), []).append(each)
        for c, own in classes.items():
            to.sums.update({(name, key, c, p): sum(each**p for each in own) << scale[p] for p in range(3)})
    to.largest.update({(name, 1): max(values), (name, -1): -min(values)})


COLUMNS = (
    "output", "members", "failed", "warned", "mean", "deviation", "skewness", "excess kurtosis", "least", "largest",
)  # fmt: skip


def table(plan: Plan, total: Summary) -> tuple[list[str], Iterator[tuple[Any, ...]]]:
    """Names of the columns, and a row for each output; None where it has too few members."""
    quantiles, keys = plan.sweep.statistics.quantiles, plan.sweep.keys
    columns = [*COLUMNS, *(f"quantile {p:g}" for p in quantiles), *(f"S {key}" for key in keys)]
    return columns, (_stated(name, total, quantiles, keys) for name in plan.sweep.quantity)


def _stated(name: str, total: Summary, quantiles: Sequence[float], keys: Sequence[str]) -> tuple[Any, ...]:
    sums, n = total.sums, total.sums[name, 0]
    counts = n, sums["failed",], sums["warned",]
    if n < 2:
        return (name, *counts, *[None] * (len(COLUMNS) - 4 + len(quantiles) + len(keys)))
    m, s2, s3, s4 = (Fraction(sums[name, p], n << DIGITS * p) for p in (1, 2, 3, 4))
    μ2, μ3, μ4 = s2 - m**2, s3 - 3 * m * s2 + 2 * m**3, s4 - 4 * m * s3 + 6 * m**2 * s2 - 3 * m**4
    shape = (math.copysign(_root(μ3**2 / μ2**3), μ3), float(μ4 / μ2**2) - 3.0) if μ2 else (None, None)
    ends = -total.largest[name, -1], total.largest[name, 1]
    moments = float(m), _root(μ2 * n / (n - 1)), *shape
    indices = [_index(name, key, sums, m, μ2 * n) for key in keys]
    return (name, *counts, *moments, *ends, *_quantiles(name, sums, quantiles, n), *indices)


def _root(x: Fraction) -> float:
    """√x, also where x is beyond float64."""
    k = 64 + max(x.denominator.bit_length() - x.numerator.bit_length(), 0)
    return float(Fraction(math.isqrt((x.numerator << 2 * k) // x.denominator), 1 << k))


def _index(name: str, key: str, sums: Counter[tuple[Any, ...]], m: Fraction, scatter: Fraction) -> float | None:
    """Sobol's first-order index of a key from Σ yᵖ of its classes, the mean m and Σ (y − m)² of all n members."""
    classes = [[sums[name, key, c, p] for p in range(3)] for c in range(CLASSES) if sums[name, key, c, 0]]
    C, n = len(classes), sums[name, 0]
    if not scatter or n <= C:
        return None
    between = sum(count * (Fraction(s, count << DIGITS) - m) ** 2 for count, s, _ in classes)
    return float((between - (C - 1) * (scatter - between) / (n - C)) / scatter)


def _quantiles(name: str, sums: Counter[tuple[Any, ...]], shares: Sequence[float], n: int) -> list[float]:
    """Middle of the class in which the member of rank ⌈p n⌉ is."""
    classes = sorted((_middle(key[2]), count) for key, count in sums.items() if key[:2] == (name, "class"))
    found, below = dict.fromkeys(sorted(shares), 0.0), 0
    for value, count in classes:
        for p in found:
            if below < math.ceil(p * n) <= below + count:
                found[p] = value
        below += count
    return [found[p] for p in shares]


def _middle(number: int) -> float:
    """Middle of a class of values."""
    return float(struct.unpack("<d", struct.pack("<q", (number << SHIFT) + (1 << SHIFT - 1)))[0])


def encode(total: Summary) -> str:
    """A summary as JSON, whole numbers as hexadecimal digits and the number of zeros (bits) after them."""
    zeros = {key: max((s & -s).bit_length() - 1, 0) for key, s in total.sums.items()}
    sums = [(*key, hex(s >> zeros[key]), zeros[key]) for key, s in total.sums.items() if s]
    largest = [(*key, value) for key, value in total.largest.items()]
    return msgspec.json.encode([total.members, sums, largest, total.failed]).decode()


def decode(text: str) -> Summary:
    """A summary from JSON."""
    members, sums, largest, failed = msgspec.json.decode(text)
    added = Counter({tuple(key): int(digits, 16) << zeros for *key, digits, zeros in sums})
    ends = {(name, sign): value for name, sign, value in largest}
    return Summary([tuple(each) for each in members], added, ends, [tuple(each) for each in failed])


def ranges(parts: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """The union of ranges [first, stop), in order."""
    found: list[tuple[int, int]] = []
    for first, stop in sorted(parts):
        if found and first <= found[-1][1]:
            found[-1] = found[-1][0], max(stop, found[-1][1])
        else:
            found.append((first, stop))
    return found
