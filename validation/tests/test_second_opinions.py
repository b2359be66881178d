"""Measured cases: decays of the strip, one number fitted to half of the quantities, uncertainties derived twice."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from flexlink.common.errors import DataFileError
from tests.support.words import refused
from validation.case import Measured, load_cases
from validation.kinds import measured as kind
from validation.kinds import measurements
from validation.measured import strip_decays, strip_on_flange
from validation.measured.one_number import Candidate, Study, chosen, fit_one_number
from validation.measured.readings import Reading
from validation.measured.second_way import close_grids, deviation, disagreement, random_points, roughness
from validation.measured.uncertainty import COVERAGE, Comparison, Convergence, of_mean
from validation.measuring import kind_of
from validation.reference_values import look_up

HERTZ, ZETA, NOISE = 3.0567, 0.006, 0.02
SIZES = np.array([0.30, 0.02, 0.22, 0.1, 0.15, 0.05, 0.0])  # of the joints' torques at the end of the recording [N m]


# --- decays of the strip ---------------------------------------------------------------------------------------------


def recording(folder: Path, slipping: float = 0.0) -> Path:
    """A synthetic recording of 10 s at 1 kHz; `slipping` adds a square wave of its sign, as of dry friction."""
    t, rng = np.arange(0.0, 10.0, 1e-3), np.random.default_rng(3)
    rate = 2 * math.pi * HERTZ * ZETA
    wave = np.exp(rate * (10.0 - t)) * np.cos(2 * math.pi * HERTZ * t + 0.4)
    torques = 5.0 + np.outer(wave + slipping * np.sign(wave), SIZES) + NOISE * rng.standard_normal((len(t), 7))
    heads = ["duration", *(f" tau_J[{k}]" for k in range(7))]
    path = folder / "ocp_Xdown_35cm_0.57s_1.csv"
    rows = np.column_stack([2_000_000 + 1000 * t, torques])
    np.savetxt(path, rows, delimiter=",", header=",".join(heads), comments="", fmt="%.8g")
    return path


def test_a_decay_of_known_frequency_is_recovered_within_its_standard_error(tmp_path: Path) -> None:
    for each in strip_decays.decays_of(recording(tmp_path)):
        assert abs(each.frequency - HERTZ) < 3 * each.error < 2e-3
        assert each.damping_ratio == pytest.approx(ZETA, rel=0.05)
        assert each.residual < 1.1
    last = next(strip_decays.decays_of(recording(tmp_path)))
    growth = math.exp(2 * math.pi * HERTZ * ZETA * strip_decays.WINDOW / 2)
    assert last.amplitude == pytest.approx(np.linalg.norm(SIZES) * growth, rel=0.01)


def test_rubbing_joints_are_seen_in_the_residual(tmp_path: Path) -> None:
    residuals = [each.residual for each in strip_decays.decays_of(recording(tmp_path, slipping=0.5))]
    assert min(residuals) > strip_on_flange.STICKING


def test_a_recording_without_torques_is_refused(tmp_path: Path) -> None:
    path = recording(tmp_path)
    path.write_text(path.read_text("utf-8").replace("tau_J[3]", "torque"), encoding="utf-8")
    with refused(DataFileError, "test-strip-recording"):
        strip_decays.figures(tmp_path)
    path.unlink()
    with refused(DataFileError, "test-strip-recording"):
        strip_decays.figures(tmp_path)


def test_the_stored_figures_are_four_windows_of_each_of_54_runs() -> None:
    rows = look_up(strip_on_flange.DATA, "decays", "rows")
    assert tuple(look_up(strip_on_flange.DATA, "decays", "heads")) == strip_decays.HEADS
    runs = {run[0] for run in look_up(strip_on_flange.DATA, "runs")}
    assert {(row[0], row[1]) for row in rows} == {(run, k) for run in runs for k in range(strip_decays.WINDOWS)}


def test_the_slope_within_runs_does_not_see_that_the_runs_differ() -> None:
    """Runs with a larger amplitude have a higher frequency here, while within each run it falls."""
    windows = [
        strip_on_flange.Window(run, k, offset - 0.03 * amplitude, 1e-4, amplitude)
        for run, offset, start in (("a", 3.0, 0.2), ("b", 3.1, 0.5))
        for k, amplitude in enumerate((start, 1.2 * start, 1.5 * start))
    ]
    assert strip_on_flange.slope_within(windows) == pytest.approx(-0.03, rel=1e-9)


def test_two_u_of_a_mean_of_three_covers_95_percent() -> None:
    values = np.random.default_rng(5).standard_normal((20_000, 3))
    inside = [abs(each.mean()) <= COVERAGE * of_mean(each) for each in values]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.005)
    naive = np.abs(values.mean(axis=1)) <= COVERAGE * values.std(axis=1, ddof=1) / math.sqrt(3)
    assert np.mean(naive) < 0.85  # without Student's factor


def test_frequencies_at_amplitude_zero_are_above_those_of_the_last_windows() -> None:
    for attitude in ("down", "up", "level"):
        at_zero = strip_on_flange.at_zero(attitude)
        value, u = at_zero.reading
        assert at_zero.frequencies.mean() < value < at_zero.frequencies.mean() + 0.008
        assert 0.001 < u < 0.005
        assert u == pytest.approx(at_zero.u_by_draws(np.random.default_rng(2)), rel=0.2)


def test_the_limit_of_sticking_hardly_changes_the_frequencies_at_amplitude_zero(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usual = {attitude: strip_on_flange.at_zero(attitude).reading for attitude in ("down", "up", "level")}
    monkeypatch.setattr(strip_on_flange, "STICKING", 2.7)
    for attitude, (value, u) in usual.items():
        other, _ = strip_on_flange.at_zero(attitude).reading
        assert 0 < abs(other - value) < COVERAGE * u


# --- one number ------------------------------------------------------------------------------------------------------

NAMES = [f"mode {k}" for k in range(1, 9)]
CANDIDATE = Candidate(path="stiffness", unit="N m", tolerance=0.02)


def frequencies(stiffness: float, mass: float = 1.0) -> dict[str, float]:
    return {name: k**2 * math.sqrt(stiffness / mass) for k, name in enumerate(NAMES, 1)}


def study(measured: dict[str, float], effect: float = 0.02) -> tuple[dict[str, Reading], Study]:
    """Study of a model with stiffness 1; the input `mass` is uncertain by a standard uncertainty of `effect`."""
    readings = {name: Reading(value, 0.005 * value, "Hz", "frequency") for name, value in measured.items()}
    coarse = {name: 0.99 * value for name, value in frequencies(1.0).items()}
    mass = {name: -0.5 * effect * value for name, value in coarse.items()}
    compared = {
        name: Comparison(value, measured[name], Convergence(2.0, 0.0), abs(mass[name]), readings[name].u, 0.1 * value)
        for name, value in frequencies(1.0).items()
    }

    def predict(value: float | None) -> dict[str, float]:
        return coarse if value is None else {name: 0.99 * f for name, f in frequencies(value).items()}

    return readings, Study(compared, {"mass": mass}, predict)


def test_a_wrong_stiffness_is_found_and_the_other_quantities_are_then_validated() -> None:
    readings, start = study(frequencies(1.21))
    found = fit_one_number(CANDIDATE, 1.0, readings, ["mode [1-4]"], start)
    assert found.value == pytest.approx(1.21, rel=3e-3)
    assert abs(found.value / 1.21 - 1) < found.u_relative < 0.01
    assert found.after < 0.5 and found.before > 10
    assert found.count() == 4 == len(found.others)
    assert all(each.verdict == "not validated" for each in start.compared.values())


def test_an_error_that_no_stiffness_explains_remains() -> None:
    """The higher modes are wrong by another factor than the lower ones."""
    measured = {name: f * (1.1 if k < 4 else 1.3) for k, (name, f) in enumerate(frequencies(1.0).items())}
    readings, start = study(measured)
    found = fit_one_number(CANDIDATE, 1.0, readings, ["mode [1-4]"], start)
    assert found.value == pytest.approx(1.21, rel=3e-3)
    assert found.count("not validated") == 4


def test_an_input_that_the_number_compensates_adds_no_uncertainty() -> None:
    """Stiffness over mass is all that the frequencies show: after a fit, the tolerance of the mass has no effect."""
    sharp, loose = (
        fit_one_number(CANDIDATE, 1.0, readings, ["mode [1-4]"], start)
        for readings, start in (study(frequencies(1.21), effect) for effect in (0.0, 0.1))
    )
    for name, each in loose.others.items():
        assert each.u_input == pytest.approx(sharp.others[name].u_input, rel=1e-2)


def test_a_number_without_effect_or_at_its_limit_changes_no_verdict() -> None:
    readings, start = study(frequencies(1.21))
    deaf = Study(start.compared, start.inputs, lambda _: start.predict(None))
    found = fit_one_number(CANDIDATE, 1.0, readings, ["mode [1-4]"], deaf)
    assert math.isinf(found.u_relative) and not found.at_limit
    assert found.others == {name: start.compared[name] for name in NAMES[4:]}
    narrow = Candidate(path="stiffness", unit="N m", low=0.9, high=1.1)
    found = fit_one_number(narrow, 1.0, readings, ["mode [1-4]"], start)
    assert found.at_limit and found.value == pytest.approx(1.1, rel=1e-2)
    assert found.others == {name: start.compared[name] for name in NAMES[4:]}


def test_patterns_choose_the_fitted_quantities() -> None:
    names = ["flap 1, 0 rpm, 0°", "flap 1, 500 rpm, 0°", "flap 2, 0 rpm, 30°"]
    assert chosen(names, ["*, 0 rpm, *"]) == ([names[0], names[2]], [names[1]])


# --- a second way ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1.0, 1.7, 2.0])
def test_close_grids_find_the_order_and_125_percent_of_the_error(order: float) -> None:
    two, three, four = (3.0 + 0.4 / n**order for n in (2, 3, 4))
    found = close_grids(two, three, four, formal=2.0)
    assert found.order == pytest.approx(order, rel=1e-9)
    assert found.grid_index == pytest.approx(1.25 * 0.4 / 4**order, rel=1e-9)
    assert math.isnan(close_grids(1.0, 1.1, 1.05, formal=2.0).order)


def test_random_inputs_have_one_value_in_each_class_and_the_deviation_of_a_rectangle() -> None:
    points = random_points(64, 3)
    for column in points.T:
        assert sorted(np.floor((column + 1) * 32).astype(int)) == list(range(64))
        assert column.std() == pytest.approx(1 / math.sqrt(3), rel=0.01)


def test_the_scatter_about_a_polynomial_is_one_in_units_of_the_right_uncertainty() -> None:
    rng, x = np.random.default_rng(7), np.arange(8.0)
    fits = [roughness(2 + x - x**2 + 0.3 * rng.standard_normal(8), [0.3] * 8, x, degree=2) for _ in range(400)]
    assert deviation(fits, degree=2) == pytest.approx(1.0, rel=0.05)


def test_a_small_part_of_u_val_may_disagree() -> None:
    assert disagreement(1.0, 1.3, 1.5) == pytest.approx(0.3)
    assert disagreement(0.01, 0.02, 1.0) == pytest.approx(0.05)


# --- the cases -------------------------------------------------------------------------------------------------------


def rows(name: str, **changes: object) -> list[Measured]:
    (case,) = load_cases(name)
    settings = msgspec.structs.replace(kind_of(case)[1], **changes)
    return [each for each in measurements(kind, case, settings) if isinstance(each, Measured)]


def test_a_wrong_tolerance_of_the_readings_fails_the_second_way(monkeypatch: pytest.MonkeyPatch) -> None:
    def part() -> float:
        found = rows("measured_wing_spar", draws=4, one_number=None)
        return next(each.value for each in found if each.varied.get("part") == "u_D")

    assert part() < 0.2
    monkeypatch.setattr("validation.measured.wing_spar.READ_WITHIN", 0.4)
    assert part() > 0.2


@pytest.mark.slow
def test_a_spar_whose_root_yields_predicts_the_larger_deflections() -> None:
    (case,) = load_cases("measured_wing_spar")
    study, sought, fitted_to = kind_of(case)[1].one_number, ("root stiffness", "bending stiffness"), "up to 1 kg"
    fewer = msgspec.structs.replace(
        study,
        candidate={name: study.candidate[name] for name in sought},
        fitted_to={fitted_to: study.fitted_to[fitted_to]},
    )
    found = [each for each in rows(case.name, draws=0, one_number=fewer) if "one number" in each.quantity]
    root = next(each for each in found if each.varied == {"situation": "root stiffness", "part": "up to 1 kg"})
    assert root.value == 5
    stiffness = next(each for each in found if each.varied == {"situation": "bending stiffness", "part": "up to 1 kg"})
    assert stiffness.value < 5


def test_a_validated_quantity_is_printed_with_the_accuracy_that_was_shown() -> None:
    note = next(
        each.note for each in rows("measured_strip_on_flange", draws=0)
        if each.varied.get("situation") == "down, at amplitude zero"
    )  # fmt: skip
    assert "accuracy ± 3.6 %" in note
