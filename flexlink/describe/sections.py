"""Cross-section properties in closed form: one formula per shape, in metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple


class SectionProperties(NamedTuple):
    """Properties of a cross section, with local y and z through the centroid.

    `i_y` = ∫z² dA resists bending about local y (in the XZ plane), `i_z` = ∫y² dA bending about local z (in the XY
    plane); `torsion` is the St Venant constant J, which equals i_y + i_z only for circles.
    """

    area: float  # m²
    i_y: float  # m⁴
    i_z: float  # m⁴
    torsion: float  # m⁴


def rectangle(height: float, width: float) -> SectionProperties:
    """Solid rectangle, `height` along local y, `width` along local z."""
    area = height * width
    return SectionProperties(area, area * width**2 / 12, area * height**2 / 12, _rectangle_torsion(height, width))


def circle(diameter: float) -> SectionProperties:
    """Solid circle."""
    return tube(diameter, 0.0)


def tube(outer: float, inner: float) -> SectionProperties:
    """Circular tube with outer and inner diameter."""
    i = math.pi * (outer**4 - inner**4) / 64
    return SectionProperties(math.pi * (outer**2 - inner**2) / 4, i, i, 2 * i)


def box(height: float, width: float, wall: float) -> SectionProperties:
    """Rectangular tube of uniform wall; torsion by Bredt's formula J = 4 A_m² t / s_m, valid for thin walls."""
    h, w = height - 2 * wall, width - 2 * wall
    middle_area, middle_length = (height - wall) * (width - wall), 2 * (height + width - 2 * wall)
    return SectionProperties(
        height * width - h * w,
        (height * width**3 - h * w**3) / 12,
        (width * height**3 - w * h**3) / 12,
        4 * middle_area**2 * wall / middle_length,
    )


def general(area: float, i_y: float, i_z: float, torsion: float) -> SectionProperties:
    """Section of unspecified shape, given by its properties."""
    return SectionProperties(area, i_y, i_z, torsion)


def _rectangle_torsion(a: float, b: float) -> float:
    """St Venant's series (Timoshenko & Goodier, art. 109), summed until its terms vanish in float64.

    J = a b³ [1/3 − (64/π⁵)(b/a) Σ tanh(mπa/2b)/m⁵, m = 1, 3, 5, …],  a ≥ b
    """
    a, b = max(a, b), min(a, b)
    # tanh = 1 − (1 − tanh): the terms 1/m⁵ sum to exactly 31ζ(5)/32; the terms of 1 − tanh decay like exp(−mπa/b), to
    # 2e-18 at m a/b = 13.
    rest = math.fsum(2 / (math.exp(m * math.pi * a / b) + 1) / m**5 for m in range(1, 13, 2) if m * a / b < 13)
    zeta_5 = 1.0369277551433699263
    return a * b**3 * (1 / 3 - 64 / math.pi**5 * (b / a) * (31 / 32 * zeta_5 - rest))


def _rectangle_factors(height: float, width: float) -> tuple[float, float]:
    """Shear correction factors of a rectangle, 5/6 in both directions."""
    return 5 / 6, 5 / 6


def _tube_factors(outer: float, inner: float = 0.0) -> tuple[float, float]:
    """Shear correction factors of a circular tube: 6/7 without a hole, 1/2 with a thin wall."""
    m = (inner / outer) ** 2
    factor = 6 * (1 + m) ** 2 / (7 * (1 + m) ** 2 + 20 * m)
    return factor, factor


def _box_factors(height: float, width: float, wall: float) -> tuple[float, float]:
    """Shear correction factors of a thin-walled box, about the shares of the walls along y and along z in its area."""
    h, w = height - wall, width - wall
    return _along(w / h), _along(h / w)


def _along(m: float) -> float:
    """Shear correction factor of a thin-walled box whose walls across the force are m times as wide as those along."""
    return 10 * (1 + 3 * m) ** 2 / (12 + 72 * m + 150 * m**2 + 90 * m**3 + 30 * m**3 * (1 + m))


SHEAR_FACTORS: dict[str, Callable[..., tuple[float, float]]] = {
    "rectangle": _rectangle_factors,
    "circle": _tube_factors,
    "tube": _tube_factors,
    "box": _box_factors,
}
"""Shear correction factors κ for forces along y and z: shear stiffness κ G A (Cowper 1966, for ν = 0)."""
BREADTHS = {
    "rectangle": ("width", "height"), "box": ("width", "height"), "circle": ("diameter", "diameter"),
    "tube": ("outer", "outer"),
}  # fmt: skip
"""Dimensions of each shape that face a flow along the section's y, and along its z."""
SHAPES: dict[str, tuple[Callable[..., SectionProperties], tuple[str, ...]]] = {
    "rectangle": (rectangle, ("height", "width")),
    "circle": (circle, ("diameter",)),
    "tube": (tube, ("outer", "inner")),
    "box": (box, ("height", "width", "wall")),
    "general": (general, ("area", "i_y", "i_z", "torsion")),
}
