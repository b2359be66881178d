"""Plausible ranges of quantities, from `data/plausibility/ranges.toml`, and the hint on a value outside."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.common.wording import Diagnostic
from flexlink.describe.data_files import load
from flexlink.describe.spec import Spec


class Range(Spec, frozen=True):
    """Plausible values of a quantity, and units that may have been used by mistake."""

    unit: str
    """SI unit of the number in the hint."""
    range: tuple[float, float]
    """Plausible range; a value outside triggers a hint."""
    usual: tuple[float, float]
    """Usual range: the value must be in it after the unit is corrected."""
    reason: str
    """Justification of the range."""
    mistaken: dict[str, float]
    """Factors to SI, by mistaken unit."""
    of: str = ""
    """Quantity and unit that the range applies to, if it is not the number itself."""

    def holds(self, value: float) -> bool:
        """Whether a value is plausible."""
        return self.range[0] <= value <= self.range[1]

    def likely(self, value: float, power: float = 1.0) -> tuple[str, float] | None:
        """Unit, and factor, in which the number was probably given; the quantity scales with `power` of the number."""
        fitting = ((u, f) for u, f in self.mistaken.items() if self.usual[0] <= value * f**power <= self.usual[1])
        return next(fitting, None)


def ranges() -> dict[str, Range]:
    """Plausible ranges by name of quantity."""
    return load("plausibility", "plausibility", "ranges", dict[str, dict[str, Range]])["quantity"]


def hint_if_outside(
    path: str, value: float | Sequence[float], name: str, at: float, power: float = 1.0, detail: str = ""
) -> Iterator[Diagnostic]:
    """Yield a hint if a quantity is not plausible.

    Parameters
    ----------
    path, value
        Path of a number or vector, and its value, for the hint.
    name
        Name of the quantity.
    at
        Value of the quantity: the number itself, or one derived from it.
    power
        Power of the number to which the quantity is proportional.
    detail
        Text appended to the reason.
    """
    known = ranges()[name]
    if known.holds(at):
        return
    unit = "" if known.unit == "1" else f" {known.unit}"
    start = f"{path} = {_shown(value)}{unit}: {known.reason}{detail}"
    if (found := known.likely(at, power)) is None:
        yield Diagnostic(f"{start}; check its unit", "likely-unit")
        return
    other, factor = found
    yield Diagnostic(f"{start}; likely given in {other}: in SI {_shown(value, factor)}{unit}", "likely-unit")


def _shown(value: float | Sequence[float], factor: float = 1.0) -> str:
    if isinstance(value, int | float):
        return f"{value * factor:.6g}"
    return f"[{', '.join(f'{item * factor:.6g}' for item in value)}]"
