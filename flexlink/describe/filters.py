"""Linear filters of sensors: low-pass, notch, and transfer functions by coefficients."""

from fractions import Fraction
from typing import Annotated

import msgspec

from flexlink.common.errors import SceneError
from flexlink.common.wording import both_given, missing
from flexlink.describe.spec import LARGE, SMALL, Deviation, Spec, measured_in

Frequency = Annotated[float, msgspec.Meta(gt=0, le=LARGE)]
MOST = 8  # largest order of one filter; poles are sensitive to the coefficients of polynomials of higher order
Coefficients = Annotated[
    tuple[Annotated[float, msgspec.Meta(ge=-LARGE, le=LARGE)], ...], msgspec.Meta(min_length=1, max_length=MOST + 1)
]


class Filter(Spec, frozen=True):
    """A linear filter with the transfer function H(s), which starts in the steady state of its initial input.

    Give one of `low_pass`, `notch`, and `numerator` with `denominator`.

    Examples
    --------
    >>> recorder = fl.details.Filter(low_pass=2.0, damping=0.9)  # Hz
    >>> hum = fl.details.Filter(notch=50.0, damping=0.1)  # Hz; 10 Hz wide
    >>> lag = fl.details.Filter(numerator=(1.0,), denominator=(0.08, 1.0))  # time constant 0.08 s
    >>> encoder = fl.Sensor(name="encoder", kind="joint", link="upper", filter=(recorder, hum, lag))
    """

    low_pass: Annotated[Frequency | None, measured_in("Hz")] = None
    """Low-pass filter: with `damping`, ω²/(s² + 2ζωs + ω²), ω = 2π `low_pass`, ζ = `damping`; without it, a Butterworth
    filter, whose amplitude at this frequency is 71 % [Hz]."""
    order: Annotated[int, msgspec.Meta(ge=1, le=MOST)] | None = None
    """Order of the low-pass filter. Default: 2 with `damping`, which allows no other, and 1 without."""
    notch: Annotated[Frequency | None, measured_in("Hz")] = None
    """Notch filter (s² + ω²)/(s² + 2ζωs + ω²), ω = 2π `notch`, ζ = `damping`: it removes this frequency [Hz], and more
    than half of the power in a band of width 2ζ `notch`."""
    damping: Deviation | None = None
    """Damping ratio ζ of a low-pass filter of order 2 or of a notch filter [1]."""
    numerator: Coefficients | None = None
    """Coefficients of the numerator of H(s) in descending powers of s; the static gain H(0) may differ from 1."""
    denominator: Coefficients | None = None
    """Coefficients of the denominator of H(s) in descending powers of s; its roots must have negative real parts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        kinds = {"low_pass": ("order", "damping"), "notch": ("damping",), "numerator": ("denominator",)}
        given = [key for key in kinds if getattr(self, key) is not None]
        if not given:
            raise missing("low_pass", "a filter needs low_pass, notch or numerator")
        if len(given) > 1:
            raise both_given(given[1], getattr(self, given[1]), given[0], "write two filters, one after the other")
        for key in ("order", "damping", "denominator"):
            if getattr(self, key) is not None and key not in kinds[given[0]]:
                takes = f"a filter by {given[0]} takes {' and '.join(kinds[given[0]])}"
                raise self._refused(key, takes, "key-of-another-kind")
        needed = {"notch": "damping", "numerator": "denominator"}.get(given[0])
        if needed and getattr(self, needed) is None:
            raise missing(needed, f"a filter by {given[0]} needs it")
        if self.damping is not None and self.order not in {None, 2}:
            why = f"with damping = {self.damping!r} the order is 2; leave one of them out"
            raise self._refused("order", why, "both-given")
        if self.numerator is not None and self.denominator is not None:
            self._check_transfer(self.numerator, self.denominator)

    def _check_transfer(self, numerator: tuple[float, ...], denominator: tuple[float, ...]) -> None:
        """Check that a transfer function is proper and stable, and has a finite static gain."""
        if abs(denominator[0]) < SMALL:
            remedy = f"leave out leading zeros, and give at least {SMALL:g}"
            raise SceneError(f"denominator[0] = {denominator[0]!r}: must not be 0; {remedy}", id="filter-improper")
        zeros = next((k for k, b in enumerate(numerator) if b), len(numerator) - 1)
        order, highest = len(denominator) - 1, len(numerator) - 1 - zeros
        if highest > order:
            why = f"improper: of degree {highest}, above the {order} of the denominator"
            raise self._refused("numerator", f"{why}; give a denominator of at least this degree", "filter-improper")
        if abs(denominator[-1]) < SMALL:
            why = "has a root at s = 0, so the static gain is not finite; the last coefficient must be at least"
            raise self._refused("denominator", f"{why} {SMALL:g}", "filter-static-gain")
        if not is_stable(denominator):
            why = "unstable; all its roots must have negative real parts"
            raise self._refused("denominator", why, "filter-unstable")


def is_stable(polynomial: tuple[float, ...]) -> bool:
    """Whether all roots of a polynomial have negative real parts, by the Routh scheme in exact arithmetic."""
    row = [Fraction(a) / Fraction(polynomial[0]) for a in polynomial]
    upper, lower = row[::2], row[1::2]
    while lower:
        if lower[0] <= 0:
            return False
        ratio = upper[0] / lower[0]
        below = [*lower[1:], *[Fraction(0)] * (len(upper) - len(lower))]
        upper, lower = lower, [a - ratio * b for a, b in zip(upper[1:], below, strict=True)]
    return True
