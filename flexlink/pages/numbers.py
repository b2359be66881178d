"""Numbers in a readable form."""

import math

JOIN = "\N{NO-BREAK SPACE}"


def number(value: float | None, digits: int = 3) -> str:
    """Format `value` with `digits` significant digits, and a power of ten if it is very small or large; None is "–"."""
    return "–" if value is None else _digits(value, digits).replace("-", "−")


def percent(share: float) -> str:
    """Format a share with three significant digits, in percent."""
    return f"{number(100 * share)} %"


def _digits(value: float, digits: int) -> str:
    if not math.isfinite(value):
        return str(value)
    if value == int(value) and abs(value) < 1e4:
        return str(int(value))
    if not 1e-3 <= abs(value) < 1e4:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        superscripts = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
        power = "10" + str(int(exponent)).translate(superscripts)
        return power if mantissa == "1" else f"{mantissa}{JOIN}×{JOIN}{power}"
    short = f"{value:.{digits}g}"
    return f"{value:.0f}" if "e" in short else short  # 999.7 is rounded to 1e+03


def amount(value: float | None, unit: str, digits: int = 3) -> str:
    """Number and unit; the unit 1 is omitted."""
    return number(value, digits) if unit in ("", "1") else f"{number(value, digits)}{JOIN}{unit}"
