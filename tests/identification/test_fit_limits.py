"""Impossible standard deviations are refused by name; extreme allowed ones give a result or a one-line error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import flexible, make_scene
from tests.support.words import refused

TOO_SMALL, TOO_LARGE = r"expected float >= 1e-30", r"expected float <= 1e\+30"


@pytest.mark.parametrize(("value", "allowed"), [(5e-324, TOO_SMALL), (1e-308, TOO_SMALL), (1e308, TOO_LARGE)])
@pytest.mark.parametrize(
    ("key", "build"),
    [
        (r"prior\[1\]", lambda d: fl.fits.FitParameter(path="tip.mass", prior=(1.0, d))),
        (r"deviation\[0\]", lambda d: fl.fits.FitModes(hertz=(5.0,), deviation=(d,))),
        ("ratio_deviation", lambda d: fl.fits.FitModes(hertz=(5.0,), deviation=(0.1,), ratio_deviation=d)),
        ("deviation", lambda d: fl.fits.FitStatic(axis="x", value=0.0, deviation=d)),
        ("noise.*", lambda d: fl.fits.FitRun(name="a", file="a.csv", noise={"tip x [m]": d})),
    ],
)
def test_a_standard_deviation_whose_square_overflows_or_underflows_is_refused(
    key: str, build: Callable[[float], object], value: float, allowed: str
) -> None:
    with refused(fl.errors.SceneError, "wrong-value"):
        build(value)


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [1e-30, 1e30])
def test_extreme_allowed_deviations_give_a_result_or_a_one_line_error(deviation: float) -> None:
    arm = make_scene(
        flexible("a", segments=3, joint=fl.Joint(locked=True)), flexible("b", segments=3), gravity=(0, -9.81, 0)
    )
    problem = fl.fits.FitProblem(
        scene=arm,
        parameter=(fl.fits.FitParameter(path="material.aluminium.young", prior=(7e10, deviation)),),
        modes=(fl.fits.FitModes(hertz=(5.0,), deviation=(deviation,)),),
        static=(fl.fits.FitStatic(axis="y", value=-0.01, deviation=deviation),),
    )
    assert np.isfinite(fl.fits.check_fit(problem).singular_values).all()
    try:
        assert fl.fit(problem).numbers[0].value > 0
    except fl.errors.IdentifiabilityError as error:
        assert deviation > 1 and "\n" not in str(error)
