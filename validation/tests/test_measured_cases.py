"""Cases against measurements: grids, uncertainties, verdicts, and the models compared with the measurements."""

from __future__ import annotations

import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.describe.scene_file import load_scene
from reports.measurements import groups_of
from reports.measurements import table as table_of
from tests.support.words import refused
from validation.case import Measured, load_cases, scene_file
from validation.kinds import measured as kind
from validation.kinds import measurements
from validation.measured import rotating_beam, strip_on_flange, two_link, wing_spar
from validation.measured.measurements import MEASUREMENTS
from validation.measured.readings import Derived, FittedInputs, Reading
from validation.measured.uncertainty import Comparison, Convergence, grid_convergence, standard
from validation.measuring import kind_of
from validation.oracles import tensioned_beam

CASES = {case.name: case for case in load_cases("measured_*")}


# --- grids -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1.0, 1.7, 2.0])
def test_the_order_of_a_power_law_is_found_and_the_index_is_125_percent_of_the_error(order):
    exact, error = 3.0, 0.4
    found = grid_convergence(*(exact + error / n**order for n in (1, 2, 4)), formal=2.0)
    assert found.order == pytest.approx(order, rel=1e-12)
    assert found.grid_index == pytest.approx(1.25 * error / 4**order, rel=1e-12)


def test_an_observed_order_above_the_formal_one_does_not_reduce_the_index():
    lucky = grid_convergence(*(1.0 + 1.0 / n**4 for n in (1, 2, 4)), formal=2.0)
    assert lucky.order == pytest.approx(4.0)
    assert lucky.grid_index == pytest.approx(1.25 * abs(1 / 256 - 1 / 16) / 3)


@pytest.mark.parametrize("values", [(1.0, 1.1, 1.05), (1.0, 1.1, 1.3), (1.0, 1.0, 1.02)])
def test_without_convergence_the_index_is_three_times_the_largest_difference(values):
    found = grid_convergence(*values, formal=2.0)
    assert math.isnan(found.order)
    assert found.grid_index == pytest.approx(3.0 * np.abs(np.diff(values)).max())


def test_no_grid_convergence_index_is_smaller_than_rounding():
    assert grid_convergence(1.0, 1.0, 1.0, 2.0, rounding=1e-9).grid_index == 1e-9


# --- uncertainties and verdicts --------------------------------------------------------------------------------------


def test_bounds_have_the_standard_uncertainty_of_a_rectangular_distribution():
    samples = np.linspace(-2.0, 2.0, 100_001)
    assert standard(2.0) == pytest.approx(samples.std(), rel=1e-4)


def compared(error: float, u: float = 1.0, wanted: float = 3.0) -> Comparison:
    return Comparison(10.0 + error, 10.0, Convergence(2.0, 0.0), 0.6 * u, 0.8 * u, wanted)


@pytest.mark.parametrize(
    ("error", "wanted", "verdict"),
    [
        (1.9, 3.0, "validated to u_val"), (-1.9, 3.0, "validated to u_val"),
        (2.1, 3.0, "not validated"), (-2.1, 3.0, "not validated"), (2.1, 1.0, "not validated"),
        (0.0, 1.0, "cannot be told"), (math.nan, 3.0, "not validated"),
    ],
)  # fmt: skip
def test_the_verdict_follows_the_standard(error, wanted, verdict):
    assert compared(error, wanted=wanted).u_val == pytest.approx(1.0)
    assert compared(error, wanted=wanted).verdict == verdict


def test_uncertainties_of_derived_readings_agree_with_random_samples():
    readings = {"a": Reading(3.0, 0.03, "Hz", ""), "b": Reading(2.0, 0.05, "Hz", "")}
    random = np.random.default_rng(1)
    a, b = (random.normal(r.value, r.u, 200_000) for r in readings.values())
    for how, values in (("ratio", a / b), ("difference", a - b)):
        derived = Derived("", "", how, "a", "b")
        found = derived.reading(readings)
        assert derived.of({"a": 3.0, "b": 2.0}) == found.value
        assert found.value == pytest.approx(values.mean(), rel=2e-3)
        assert found.u == pytest.approx(values.std(), rel=2e-2)


# --- models: closed forms and other programs' numbers --------------------------------------------------------------


def test_the_rotating_beam_at_rest_has_the_frequencies_of_a_clamped_beam():
    scene = load_scene(scene_file("swept_beam")).varied({"link.straight.segments": 9, "link.tip.segments": 3})
    found = rotating_beam.predicted(scene)
    length, young, density, thickness = 37.5 * 0.0254, 10.6e6 * 6894.757, 2.51e-4 * 1.06869e7, 0.063 * 0.0254
    for mode, root in (("flap 1", 1.875104), ("flap 2", 4.694091), ("flap 3", 7.854757)):
        exact = (root / length) ** 2 * math.sqrt(young * thickness**2 / 12 / density) / (2 * math.pi)
        assert found[f"{mode}, 0 rpm, 0°"] == pytest.approx(exact, rel=1e-3)


def test_a_hanging_or_standing_strip_has_the_frequencies_of_a_beam_under_its_weight():
    found = strip_on_flange.predicted(load_scene(scene_file("strip_on_flange")).varied({"link.strip.segments": 17}))
    length, young, density, thickness = 0.52, 190e9, 7870.0, 0.001
    weight = 12 * density * 9.81 * length**3 / (young * thickness**2)  # ρA g L³ / EI
    unit = math.sqrt(young * thickness**2 / 12 / density) / (2 * math.pi * length**2)
    for attitude, sign in (("down", 1), ("up", -1)):
        exact = unit * float(tensioned_beam.frequencies(tensioned_beam.Beam(gravity=sign * weight), 1)[0])
        assert found[f"{attitude}, {strip_on_flange.MEAN}"] == pytest.approx(exact, rel=1e-3)


def test_the_spar_under_a_small_mass_deflects_like_a_linear_beam():
    light = load_scene(scene_file("wing_spar")).varied({"section.spar.area": 1e-12, "gravity": [0.0, 0.0, -0.0981]})
    expected = 100 * 0.2 * 0.0981 * 0.55**2 / (3 * 4.426)
    assert wing_spar.predicted(light)["0.2 kg"] == pytest.approx(expected, rel=1e-4)


def test_the_files_contain_36_frequencies_54_runs_and_ten_masses():
    assert len(rotating_beam.readings()) == 36
    assert sum(len(runs) for moves in strip_on_flange._moves().values() for runs in moves.values()) == 54
    assert len(wing_spar.readings()) == 10
    for measurement in MEASUREMENTS.values():
        assert all(reading.u > 0 for reading in measurement.all_readings().values())


# --- the cases -------------------------------------------------------------------------------------------------------


def results(name: str, **changes):
    """Results of a case by quantity and situation, and its table."""
    case = CASES[name]
    settings = msgspec.structs.replace(kind_of(case)[1], **changes)
    found, tables = {}, []
    for each in measurements(kind, case, settings):
        if isinstance(each, Measured):
            found[each.quantity, each.varied.get("situation")] = each
        else:
            tables.append(each)
    return found, tables[0]


@pytest.mark.slow
def test_the_error_e_is_printed_next_to_u_val_and_its_components():
    found, series = results("measured_strip_on_flange", draws=0, one_number=None)
    note = found["|E| / |D|, frequency", "level, mean of the runs"].note
    assert all(f"{symbol} = " in note for symbol in ("S", "D", "E", "u_num", "u_input", "u_D", "u_val"))
    assert "order" in note and kind.VERDICTS[0] in note
    c = series.columns
    assert np.allclose(c["u_val"] ** 2, c["u_num"] ** 2 + c["u_input"] ** 2 + c["u_D"] ** 2)
    assert np.allclose(c["E"], c["S"] - c["D"])
    assert np.allclose(c["order"][:2], 2.0, atol=0.1)  # order of the rule, for the hanging and the upright strip


def test_a_missing_measurement_is_named():
    case = CASES["measured_wing_spar"]
    settings = kind_of(case)[1]
    with refused(ArgumentError, "unknown-name"):
        list(kind.run(case, msgspec.structs.replace(settings, measurement="wing")))


@pytest.mark.slow
def test_the_first_screen_shows_the_results_of_the_cases():
    _, series = results("measured_wing_spar", draws=0, one_number=None)
    (group,) = groups_of("measured_wing_spar", "Spar: bent", series)
    assert group.title == "Spar"
    assert np.allclose(group.error, 100 * series.columns["E"] / series.columns["D"])

    stored = SimpleNamespace(
        cases={"measured_wing_spar": [SimpleNamespace(title="Spar: bent")]},
        showing=lambda what: [("measured_wing_spar", series)],
    )
    (line,) = table_of(stored).lines
    assert line[0] == "Spar: deflection"
    assert line[1] == 10.0
    assert line[4:] == tuple(float((series.columns["verdict"] == v).sum()) for v in kind.VERDICTS)
    assert sum(line[4:]) == 10.0


# --- a laboratory's arm ----------------------------------------------------------------------------------------------

RECORDER = two_link.Recorder(2.0, 0.9, 0.01)


def test_the_recorder_filters_like_the_scenes_sensors():
    t = np.arange(400) * RECORDER.h
    wave, ω, ζ = 2 * np.pi * 1.8, 2 * np.pi * RECORDER.hertz, RECORDER.ratio
    gain = ω**2 / (ω**2 - wave**2 + 2j * ζ * ω * wave)
    found = RECORDER.filtered(np.sin(wave * t))
    assert np.allclose(found[200:], np.imag(gain * np.exp(1j * wave * t))[200:], atol=2e-3)
    (scene,) = CASES["measured_two_link"].load_scenes()
    assert two_link.Recorder.of(scene, RECORDER.h) == RECORDER


def test_the_linear_model_recovers_modes_and_weights_from_its_own_strains():
    t = np.arange(1500) * RECORDER.h
    u = np.column_stack([np.sin(t + 0.3 * t**2 / 8), np.cos(2 * t) * (t > 3)])
    true = two_link.LinearModel(
        np.array([math.log(11.0), 0.02, math.log(33.0), 0.01]), np.arange(8.0).reshape(4, 2) - 3
    )
    seen = true.strains(u, RECORDER)
    found = two_link.linear_model(u, list(seen.T), RECORDER, t > 1.0, (1.8, 5.4))
    assert np.allclose(found.poles, true.poles, atol=1e-6)
    assert np.allclose(found.strains(u, RECORDER), seen, atol=1e-6 * np.abs(seen).max())


def test_no_window_of_a_fit_is_held_out_and_every_recording_covers_its_windows():
    for split in laboratory().split:
        for window in split.windows:
            t = two_link.recorded(window.recording)["t [s]"]
            assert np.allclose(np.diff(t), 0.01) and window.of(t).sum() > 800
            others = [one for one in split.held_out if one.recording == split.fitted.recording]
            assert all(one.start >= split.fitted.end for one in others)


def test_both_recordings_are_identified_on_and_held_out():
    fitted = [split.fitted.recording for split in laboratory().split]
    assert len(set(fitted)) == len(fitted) == 2
    for split in laboratory().split:
        assert {window.recording for window in split.held_out} == set(fitted)


def test_the_recorder_sets_strains_to_zero_in_the_first_second():
    for recording in {window.recording for split in laboratory().split for window in split.windows}:
        columns = two_link.recorded(recording)
        first = columns["t [s]"] < 1.0
        assert not columns[two_link.STRAINS[0]][first].any() and columns[two_link.STRAINS[0]].any()
    assert all(window.start > 1.0 for split in laboratory().split for window in split.windows)


def laboratory():
    """Settings of the case with recordings in the project."""
    return kind_of(CASES["measured_two_link"])[1]


def test_a_missing_recording_is_named():
    with refused(DataFileError, "test-measured-cases"):
        two_link.recorded("validation/measured/data/two_link_none.csv")


def fitted_inputs(scale: float = 1.0) -> FittedInputs:
    half = scale * np.array([[0.3, 0.0], [0.29, 0.02]])
    return FittedInputs(("a", "b"), np.array([2.0, 3.0]), half @ half.T)


def test_effects_of_correlated_inputs_combine_to_the_uncertainty_of_a_linear_quantity():
    inputs = fitted_inputs()
    found = inputs.effects(lambda v: {"difference": v["a"] - v["b"], "sum": v["a"] + v["b"]})
    for name, J in (("difference", [1.0, -1.0]), ("sum", [1.0, 1.0])):
        u = math.hypot(*(effect[name] for effect in found.values()))
        assert u == pytest.approx(math.sqrt(np.array(J) @ inputs.covariance @ J), rel=1e-6)
    assert math.hypot(*(effect["difference"] for effect in found.values())) < 0.03  # 0.42 without the correlation


def test_random_fitted_inputs_have_the_covariance():
    inputs = fitted_inputs()
    drawn = np.array([list(each.values()) for each in inputs.drawn(40_000, 0.5, seed=1)])
    assert np.allclose(np.cov(drawn.T), 0.25 * inputs.covariance, rtol=0.03)
    assert np.allclose(drawn.mean(axis=0), inputs.values, atol=3e-3)


@pytest.mark.slow
def test_the_covariance_at_the_solution_is_that_of_the_fit():
    scene, path = load_scene(scene_file("two_link_laboratory")), "link.one.root_stiffness.z"
    split = msgspec.structs.replace(
        laboratory().split[0],
        fitted=two_link.Window(
            name="short", recording="validation/measured/data/two_link_psf.csv", start=1.2, end=4.0
        ),
    )  # fmt: skip
    sought = [one for one in laboratory().sought if one.path == path]
    found = split.identified(scene, sought)
    inputs = split.uncertain(two_link.with_sensors(scene, found), sought)
    assert inputs.values[0] == pytest.approx(found[path].value, rel=1e-9)
    assert inputs.covariance[0, 0] == pytest.approx(found.covariance[0, 0], rel=1e-3)


@pytest.mark.slow
def test_the_covariance_of_the_fit_is_an_uncertainty_of_the_ringing():
    found, series = results("measured_laboratory_ringing")
    assert (series.columns["u_input"] > 0).all()
    assert [found[verdict, "ringing"].value for verdict in kind.VERDICTS] == [0, 0, 2]
    assert max(each.value for (quantity, _), each in found.items() if quantity == "second way") < 0.2
