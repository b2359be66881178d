"""Plausible ranges of quantities, from `data/plausibility/ranges.toml`, and the hint on a value outside its range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.common.errors import Diagnostic
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
    """Conversion factor to SI of each unit that may have been used by mistake."""
    of: str = ""
    """Quantity and unit that the range applies to, if this is not the given number itself."""
    inverse: str = ""
    """If the inverse may have been given: both names for the hint, such as 'a sampling period in s, the rate'."""
    remedy: str = "check its unit"
    """End of the hint if no unit fits."""

    def holds(self, value: float) -> bool:
        """Whether a value is plausible."""
        return self.range[0] <= value <= self.range[1]

    def likely(self, value: float, power: float = 1.0) -> dict[str, float]:
        """Units in which the number was probably given, and factors to SI; the quantity varies as number**power."""
        found = {u: f for u, f in self.mistaken.items() if self.usual[0] <= value * f**power <= self.usual[1]}
        # catalogues of profiles use several units
        return found if self.unit in {"m²", "m⁴"} else dict(list(found.items())[:1])


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
    start = f"{path} = {shown(value)}{unit}: {known.reason}{detail}"
    if not (found := known.likely(at, power)):
        remedy = known.remedy
        if known.inverse and at > 0 and known.usual[0] <= 1 / at <= known.usual[1]:
            remedy = f"if this is {known.inverse} is {1 / at:.6g}{unit}"
        yield Diagnostic(f"{start}; {remedy}", "likely-unit")
        return
    values = " or ".join(shown(value, factor) for factor in found.values())
    yield Diagnostic(f"{start}; likely given in {' or '.join(found)}: in SI {values}{unit}", "likely-unit")


def shown(value: float | Sequence[float], factor: float = 1.0) -> str:
    """A number or vector times a factor, with six digits."""
    if isinstance(value, int | float):
        return f"{value * factor:.6g}"
    return f"[{', '.join(f'{item * factor:.6g}' for item in value)}]"
