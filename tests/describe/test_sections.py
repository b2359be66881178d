"""Cross-sections against independent tables and limits."""

import math
from fractions import Fraction

import pytest

from flexlink import Section
from flexlink.describe.material import rectangle

K = {  # J / (a b³) of a rectangle a × b: exact series, as tabulated by Timoshenko & Goodier, art. 109
    1.0: 0.1405770149551537155884687,
    1.5: 0.1957607088755440249914424,
    2.0: 0.228681677119570765025601,
    3.0: 0.2633169310015001064203891,
    5.0: 0.2913167541879888686375788,
    10.0: 0.312325037457205385543745,
    20.0: 0.3228291853952688844675631,
}


ROUNDING = 8 * 2.0**-52
"""Each property results from fewer than eight roundings; abs=0, because pytest's default 1e-12 is large in m⁴."""


@pytest.mark.parametrize(("ratio", "k"), K.items())
def test_the_torsion_constant_of_a_rectangle_equals_the_exact_series(ratio: float, k: float) -> None:
    assert rectangle(0.01 * ratio, 0.01).torsion == pytest.approx(k * ratio * 1e-8, rel=ROUNDING, abs=0)
    assert rectangle(0.01, 0.01 * ratio).torsion == pytest.approx(k * ratio * 1e-8, rel=ROUNDING, abs=0)


def test_a_thin_box_approaches_the_thin_tube_and_a_full_box_the_rectangle() -> None:
    box = Section(shape="box", height=0.05, width=0.03, wall=0.0149999).properties
    full = Section(shape="rectangle", height=0.05, width=0.03).properties
    assert box.area == pytest.approx(full.area, rel=1e-4, abs=0)
    assert box.i_y == pytest.approx(full.i_y, rel=1e-4, abs=0)
    assert box.i_z == pytest.approx(full.i_z, rel=1e-4, abs=0)


def test_circle_is_a_tube_without_a_hole_and_twists_with_its_polar_moment() -> None:
    circle = Section(shape="circle", diameter=0.02).properties
    assert circle == Section(shape="tube", outer=0.02, inner=0.0).properties
    assert circle.torsion == pytest.approx(circle.i_y + circle.i_z, rel=ROUNDING, abs=0)


def test_a_tube_has_the_moments_of_its_rings_in_closed_form() -> None:
    """Diameters 2 and 1: A = π (4 − 1)/4, I = π (16 − 1)/64, J = ∫ r² dA = 2π [r⁴/4] from 1/2 to 1 = 15π/32."""
    p = Section(shape="tube", outer=2.0, inner=1.0).properties
    assert p.area == pytest.approx(3 * math.pi / 4, rel=ROUNDING, abs=0)
    assert p.i_y == p.i_z == pytest.approx(15 * math.pi / 64, rel=ROUNDING, abs=0)
    assert p.torsion == pytest.approx(15 * math.pi / 32, rel=ROUNDING, abs=0)


def test_a_box_bends_as_a_difference_of_rectangles_and_twists_by_bredts_formula() -> None:
    """A box 5 × 3 with walls of 1/2 has a hollow of 4 × 2 and a middle line 9/2 × 5/2, so J = 4 (45/4)² ½ / 14."""
    p = Section(shape="box", height=5.0, width=3.0, wall=0.5).properties
    wanted = [
        Fraction(15 - 8), Fraction(5 * 3**3 - 4 * 2**3, 12), Fraction(3 * 5**3 - 2 * 4**3, 12),
        4 * Fraction(45, 4) ** 2 / 2 / 14,
    ]  # fmt: skip
    assert p == pytest.approx([float(value) for value in wanted], rel=ROUNDING, abs=0)


def test_a_rectangle_bends_by_its_closed_form() -> None:
    p = Section(shape="rectangle", height=3.0, width=2.0).properties
    assert p[:3] == pytest.approx((6.0, 2.0, 4.5), rel=ROUNDING, abs=0)  # 3 · 2³/12, 2 · 3³/12


def test_a_general_section_has_the_given_properties() -> None:
    assert Section(shape="general", area=1.0, i_y=2.0, i_z=3.0, torsion=4.0).properties == (1.0, 2.0, 3.0, 4.0)
