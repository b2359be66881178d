"""One number fitted to one reading predicts others, with what soft clamps leave open: closed forms, a steel bar."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.optimize import brentq

import flexlink as fl
from flexlink.cli.fit import _predict
from flexlink.cli.main import main
from flexlink.identification.prediction import predictions
from flexlink.motion.intervals import Intervals
from tests.support.words import line, refused, refused_line

pytestmark = pytest.mark.slow
E, RHO, LENGTH, WIDTH, HEIGHT = 200e9, 7850.0, 0.759, 0.05066, 0.00514
MEDIAN, HIGH = 0.6745 * 0.02, 2.2414 * 0.02  # quantiles of EI / (k L) of a clamp that is uncertain by default


def beam(height: float = HEIGHT, tip: float = 0.0) -> fl.Scene:
    """A steel cantilever with 24 hinges, without gravity."""
    link = fl.Link(
        name="beam", length=LENGTH, flex="z", segments=25, lumping="gauss", material="steel", section="bar",
        joint=fl.Joint(locked=True),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), materials={"steel": fl.Material(young=E, density=RHO)}, tip=fl.RigidBody(mass=tip),
        sections={"bar": fl.Section(shape="rectangle", width=WIDTH, height=height)},
    )  # fmt: skip
    return fl.Scene(name="beam", arm=arm, gravity=(0.0, 0.0, 0.0))


def problem(scene: fl.Scene, hertz: tuple[float, ...], deviation: float) -> fl.fits.FitProblem:
    """The first frequency is fitted by the thickness, the others check the prediction."""
    numbers = tuple(range(2, len(hertz) + 1))
    kept = fl.fits.FitModes(hertz=hertz[1:], numbers=numbers, deviation=(deviation,), use="check")
    first = fl.fits.FitModes(hertz=hertz[:1], deviation=(deviation,))
    sought = fl.fits.FitParameter(path="section.bar.height")
    return fl.fits.FitProblem(scene=scene, parameter=(sought,), modes=(first, kept))


def root(mode: int, ε: float) -> float:
    """β L of a cantilever whose root has a spring, ε = EI / (k L)."""
    equation = lambda β: 1 + np.cos(β) * np.cosh(β) + ε * β * (np.cos(β) * np.sinh(β) - np.sin(β) * np.cosh(β))  # noqa: E731
    return float(brentq(equation, (mode - 1) * np.pi + 0.6, mode * np.pi - 0.6))


def thicker(ε: float) -> float:
    """h(ε) / h(0) with which the first frequency stays; so does the spring, hence EI / (k L) = ε (h(ε) / h(0))³."""
    return float(brentq(lambda ratio: ratio * (root(1, ε * ratio**3) / root(1, 0.0)) ** 2 - 1, 0.9, 1.2))


def test_intervals_are_those_of_a_beam_whose_thickness_makes_up_for_a_soft_clamp() -> None:
    """f ~ h β²(ε) / L²: with f₁ known exactly, f₂ = f₁ β₂²(ε) / β₁²(ε)."""
    first = 6.6
    names, ((second, _),), found = predictions(fl.fit(problem(beam(), (first, 41.4), 1e-4)))
    assert second == 41.4
    at, shares = names.index("mode 2 [Hz]"), found.shares[found.inputs.index("link.beam.root_stiffness")]
    soft = [ε * thicker(ε) ** 3 for ε in (0.0, MEDIAN, HIGH)]
    expected = np.array([first * (root(2, ε) / root(1, ε)) ** 2 for ε in soft])
    assert found.value[at] == pytest.approx(expected[0], rel=1e-3)
    assert found.median[at] / found.value[at] == pytest.approx(expected[1] / expected[0], rel=2e-4)
    assert found.high[at] / found.value[at] - 1 == pytest.approx(expected[2] / expected[0] - 1, rel=0.05)
    assert found.high[0] / found.value[0] - 1 == pytest.approx(thicker(HIGH) - 1, rel=0.05)
    assert shares[[0, at]].min() > 0.99


def test_a_sag_predicts_frequencies() -> None:
    """w = m g L³ / (3 EI) determines EI, and with it all frequencies; the clamp changes both alike."""
    young = 0.9 * E
    scene = beam(tip=0.2).varied({"gravity.y": -9.81, "uncertain": {"link.beam.root_stiffness": 0.0}})
    sag = -0.1 * 9.81 * LENGTH**3 / (3 * young * WIDTH * HEIGHT**3 / 12)
    kept = fl.fits.FitModes(hertz=(4.0,), deviation=(0.1,), use="check")
    read = fl.fits.FitStatic(
        axis="y", value=sag, deviation=0.01 * abs(sag), set={"tip.mass": 0.3}, before={"tip.mass": 0.2}
    )
    sought = fl.fits.FitParameter(path="material.steel.young")
    names, _, found = predictions(
        fl.fit(fl.fits.FitProblem(scene=scene, parameter=(sought,), static=(read,), modes=(kept,)))
    )
    assert found.value[0] == pytest.approx(young, rel=2e-3)
    first = names.index("mode 1 [Hz]")
    assert found.value[1] == found.value[first]
    width = (found.high - found.low)[[0, first]] / found.value[[0, first]]
    assert width == pytest.approx([2 * 1.96 * 0.01, 1.96 * 0.01], rel=0.05)


def test_one_reading_of_a_steel_bar_predicts_seven_others(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Measured frequencies of a bar 8 % thinner than stated (validation/measured/steel_cantilever)."""
    measured = (6.599, 41.45, 117.932, 230.011, 380.346, 569.214, 797.428, 1057.231)
    scene = beam(tip=0.0058).varied({"link.beam.shear": True})
    _, readings, found = predictions(fl.fit(problem(scene, measured, 0.025)))
    assert [value for value, _ in readings] == list(measured[1:])
    inside = (found.low[1:8] < measured[1:]) & (measured[1:] < found.high[1:8])
    assert inside.all()
    assert np.abs(found.median[1:8] / measured[1:] - 1).max() < 0.02
    scene.save(tmp_path / "bar.toml")
    path = tmp_path / "reading.toml"
    path.write_text(
        'scene = "bar.toml"\nparameter = [{ path = "section.bar.height" }]\n'
        "[[modes]]\nhertz = [6.599]\ndeviation = [0.025]\n"
        '[[modes]]\nhertz = [41.45, 100.0]\nnumbers = [2, 3]\ndeviation = [0.025]\nuse = "check"\n', "utf-8",
    )  # fmt: skip
    assert main(["fit", str(path), "--predict"]) == 0
    printed = capsys.readouterr().out
    line(printed, "modes 2, frequency [Hz], 1: measured", "inside")
    line(printed, "modes 2, frequency [Hz], 2: measured", "OUTSIDE")
    path.write_text(path.read_text("utf-8").replace("[6.599]", "[6.599, 41.4]"), "utf-8")
    assert main(["fit", str(path), "--predict"]) == 2
    refused_line(capsys.readouterr().err, "needs-another-argument")


@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize(("end", "σ", "half"), [(8.0, 0.0, 2.0), (13.0, 0.0, 3.0), (8.0, 1.0, 2.80), (13.0, 1.0, 3.58)])
def test_a_reading_is_outside_if_its_own_uncertainty_does_not_explain_it(end, σ, half, outside, monkeypatch, capsys):
    """The interval is 8 … 13 about 10, widened by 1.96 σ of the reading: √(2² + 1.96²) = 2.80, √(3² + 1.96²) = 3.58."""
    y, (ten, low, high) = 10 + np.sign(end - 10) * half * (1.01 if outside else 0.99), np.full((2, 3), (10, 8, 13.0)).T
    found = ["x", "y"], [(y, σ)], Intervals((), ten, ten, low, high, np.empty((0, 2)), ten > 0)
    monkeypatch.setattr("flexlink.cli.fit.predictions", lambda _: found)
    _predict(cast("Any", None), cast("Any", SimpleNamespace(document={})))
    where, off = "OUTSIDE" if outside else "inside", f" {100 * (10 / y - 1):+.2g} %"
    line(capsys.readouterr().out, f"y: measured {y:.4g}", off, where)


def test_a_number_that_cannot_make_up_for_the_other_inputs_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = fl.fit(problem(beam(), (6.6, 41.4), 0.01))
    monkeypatch.setattr("flexlink.identification.prediction.math.exp", lambda _: 1.0)  # the number stays as it is
    with refused(fl.errors.IdentifiabilityError, "not-identifiable"):
        predictions(fitted)
