"""Cross-sections against tables and limits that are not the formulas themselves."""

from __future__ import annotations

import pytest

from flexlink import Section
from flexlink.sections import rectangle

K = {  # J / (a b³) of a rectangle a × b: exact series, as tabulated by Timoshenko & Goodier, art. 109
    1.0: 0.1405770149551537155884687,
    1.5: 0.1957607088755440249914424,
    2.0: 0.228681677119570765025601,
    3.0: 0.2633169310015001064203891,
    5.0: 0.2913167541879888686375788,
    10.0: 0.312325037457205385543745,
    20.0: 0.3228291853952688844675631,
}


@pytest.mark.parametrize(("ratio", "k"), K.items())
def test_torsion_constant_of_a_rectangle_is_the_exact_series(ratio: float, k: float) -> None:
    """a b³ of rounded sides, the series, its factors: under ten roundings; without abs=0 pytest lets 1e-12 pass."""
    allowed = {"rel": 10 * 2.0**-53, "abs": 0.0}
    assert rectangle(0.01 * ratio, 0.01).torsion == pytest.approx(k * ratio * 1e-8, **allowed)
    assert rectangle(0.01, 0.01 * ratio).torsion == pytest.approx(k * ratio * 1e-8, **allowed)


def test_a_thin_box_approaches_the_thin_tube_and_a_full_box_the_rectangle() -> None:
    box = Section(shape="box", height=0.05, width=0.03, wall=0.0149999).properties
    full = Section(shape="rectangle", height=0.05, width=0.03).properties
    assert box.area == pytest.approx(full.area, rel=1e-4)
    assert box.i_y == pytest.approx(full.i_y, rel=1e-4)
    assert box.i_z == pytest.approx(full.i_z, rel=1e-4)


def test_circle_is_a_tube_without_a_hole_and_twists_with_its_polar_moment() -> None:
    circle = Section(shape="circle", diameter=0.02).properties
    assert circle == Section(shape="tube", outer=0.02, inner=0.0).properties
    assert circle.torsion == pytest.approx(circle.i_y + circle.i_z)


def test_a_general_section_is_what_it_says() -> None:
    assert Section(shape="general", area=1.0, i_y=2.0, i_z=3.0, torsion=4.0).properties == (1.0, 2.0, 3.0, 4.0)
