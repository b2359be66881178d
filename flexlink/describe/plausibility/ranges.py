"""Plausible ranges of quantities, from `data/plausibility/ranges.toml`, and the hint on a number outside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.describe.data_files import load
from flexlink.describe.spec import Spec


class Range(Spec, frozen=True):
    """Which values of a quantity are plausible, and the units in which others may have been meant."""

    unit: str
    """SI unit of the number that is told."""
    range: tuple[float, float]
    """Outside it a hint is given."""
    usual: tuple[float, float]
    """Where a value lies once its unit is put right."""
    reason: str
    """What the range comes from."""
    mistaken: dict[str, float]
    """Factors to SI, by unit."""
    of: str = ""
    """What the range is of, with its unit, where that is not the number itself."""

    def holds(self, value: float) -> bool:
        """Whether a value is plausible."""
        return self.range[0] <= value <= self.range[1]

    def likely(self, value: float, power: float = 1.0) -> tuple[str, float] | None:
        """The unit, and its factor, in which the number was likely given; the value goes with this power of it."""
        fitting = ((u, f) for u, f in self.mistaken.items() if self.usual[0] <= value * f**power <= self.usual[1])
        return next(fitting, None)


def ranges() -> dict[str, Range]:
    """Plausible ranges by name of the quantity."""
    return load("plausibility", "plausibility", "ranges", dict[str, dict[str, Range]])["quantity"]


def told(
    path: str, value: float | Sequence[float], name: str, at: float, power: float = 1.0, detail: str = ""
) -> Iterator[str]:
    """A hint where a quantity is not plausible.

    Parameters
    ----------
    path, value
        The number that is told, or the numbers of a vector, and its path.
    name
        Of the quantity.
    at
        Its value: the number itself, or what follows from it.
    power
        With which power of the number the quantity goes.
    detail
        What is added to the reason.
    """
    known = ranges()[name]
    if known.holds(at):
        return
    unit = "" if known.unit == "1" else f" {known.unit}"
    start = f"{path} = {_shown(value)}{unit}: {known.reason}{detail}"
    if (found := known.likely(at, power)) is None:
        yield f"{start}; look at its unit"
        return
    other, factor = found
    yield f"{start}; likely given in {other}: in SI {_shown(value, factor)}{unit}"


def _shown(value: float | Sequence[float], factor: float = 1.0) -> str:
    if isinstance(value, int | float):
        return f"{value * factor:.6g}"
    return f"[{', '.join(f'{item * factor:.6g}' for item in value)}]"
