"""Cases against measurements: grids, uncertainties, verdicts, and the models compared with the measurements."""

import itertools
import math
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from scipy.optimize import brentq

from docs.generators.study import rows as stored_rows
from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.describe.scene_file import load_scene
from reports.figures.checks import _figure
from reports.measurements import Group, expectation, groups_of, lines_of
from reports.measurements import table as table_of
from tests.support.words import refused, reviewed
from validation.case import Measured, load_cases, scene_file
from validation.kinds import KINDS
from validation.kinds import measured as kind
from validation.measured import (
    one_number,
    pazy_wing,
    rotating_beam,
    steel_cantilever,
    strip_decays,
    strip_on_flange,
    two_link,
)
from validation.measured.measurements import MEASUREMENTS
from validation.measured.one_number import Candidate, OneNumber, Study, choose, chosen, fit_one_number
from validation.measured.readings import Derived, FittedInputs, Reading
from validation.measured.second_way import close_grids, deviation, disagreement, random_points, roughness
from validation.measured.trends import pooled
from validation.measured.uncertainty import (
    COVERAGE,
    Comparison,
    Convergence,
    grid_convergence,
    of_mean,
    of_one,
    standard,
)
from validation.measuring import kind_of
from validation.oracles import tensioned_beam
from validation.reference_values import look_up

CASES = {case.name: case for case in load_cases("measured_*")}


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


def test_the_rotating_beam_at_rest_has_the_frequencies_of_a_clamped_beam():
    fine = {"link.straight.segments": 9, "link.tip.segments": 3, "gravity": [0.0, 0.0, 0.0]}
    scene = load_scene(scene_file("swept_beam")).varied(fine)
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


def pazy(**changes: object):
    return load_scene(scene_file("pazy_wing")).varied({"link.wing.segments": 33, **changes})


def test_the_wing_under_small_loads_deflects_and_twists_like_a_linear_beam():
    """Deflection ∫ m g (L − x)² / EI dx and twist m g e ∫ dx / GJ of the published elements; loads are 1/1000."""
    light = pazy(gravity=[0.0, 0.0, -0.00981], **{"rigidity.wing.mass_factor": 1e-6})
    of, nodes = (look_up(pazy_wing.DATA, key) for key in ("without_skin", "nodes_m"))
    found = pazy_wing.predicted(light)
    force, length = 0.2 * 0.00981, nodes[-1]
    ends = np.array(list(itertools.pairwise(nodes)))
    bent = force * np.sum(((length - ends[:, 0]) ** 3 - (length - ends[:, 1]) ** 3) / 3 / of["EI_flap_Nm2"])
    twist = math.degrees(force * 0.096 * np.sum(np.diff(ends).T / of["GJ_Nm2"]))
    loading = next(each for each in pazy_wing.loadings() if each.twists)
    assert found[loading.name("twist", 0.2)] == pytest.approx(twist, rel=1e-3)
    in_plane = 0.006 * math.radians(twist)  # the middle of the chord is 6 mm behind the axis
    down = 100 * (bent + in_plane) / length
    assert found[loading.name("displacement", 0.2)] == pytest.approx(down, rel=1e-3)


@pytest.mark.slow
def test_the_wing_bends_like_the_published_geometrically_exact_beam():
    scene, span = pazy(), look_up(pazy_wing.DATA, "span_m")
    for skin in ("without skin", "with skin"):
        wing = scene.varied({f"rigidity.wing.{name}": column for name, column in pazy_wing.columns(skin).items()})
        theirs = look_up(pazy_wing.DATA, skin.replace(" ", "_"), "published_beam_bending")
        rest = pazy_wing.tip(wing, 0.0, 0.006)[0]
        for mass, percent in zip(theirs["mass_kg"], theirs["displacement_percent"], strict=True):
            ours = 100 * (pazy_wing.tip(wing, mass, 0.006)[0] - rest) / span
            assert ours == pytest.approx(-percent, rel=3e-3)  # couplings of bending and torsion are left out


def test_the_scene_of_the_wing_has_the_published_columns_and_mass():
    scene = load_scene(scene_file("pazy_wing"))
    for name, column in pazy_wing.columns("without skin").items():
        assert np.allclose(getattr(scene.arm.rigidities["wing"], name), column, rtol=1e-5)
    of = pazy_wing.columns("with skin")
    mass = np.trapezoid(of["rho_a"], of["x"])
    published = sum(look_up(pazy_wing.DATA, "with_skin", "node_mass_kg"))
    assert mass == pytest.approx(published, rel=1e-9)


def test_two_tests_of_one_wing_differ_by_more_than_a_reading_error():
    bare, skin = (pazy_wing.reproducibility(f"{which} skin") for which in ("without", "with"))
    assert bare == pytest.approx(0.24, abs=0.01) and skin == pytest.approx(0.77, abs=0.01)
    assert min(bare, skin) > 2 * standard(0.2)  # 1 mm of the span, in which a reading could be wrong


def test_the_cantilever_has_the_frequencies_of_a_clamped_beam_with_a_mass_at_its_end():
    scene = load_scene(scene_file("steel_cantilever")).varied({"link.bar.shear": False})
    length, height = 0.759, 0.00514
    bar = 7850.0 * 0.05066 * height * length
    unit = math.sqrt(200e9 * height**2 / 12 / 7850.0) / (2 * math.pi * length**2)
    for k, hertz in enumerate(steel_cantilever.predicted(scene).values()):

        def free_end(z: float) -> float:
            cos, cosh = math.cos(z) / math.cosh(z), 1.0
            end = z * 0.0058 / bar * (math.sin(z) * cosh - math.cos(z) * math.tanh(z))
            return 1 / math.cosh(z) + cos * math.cosh(z) - end

        root = brentq(free_end, (k + 0.5) * math.pi - 1.2, (k + 0.5) * math.pi + 0.5)
        assert hertz == pytest.approx(unit * root**2, rel=2e-3)


def test_the_files_contain_48_frequencies_54_runs_8_modes_48_displacements_and_23_twists():
    groups = [each.group for each in rotating_beam.readings().values()]
    assert (groups.count("frequency"), groups.count("coupled frequency")) == (36, 12)
    assert sum(len(runs) for moves in strip_on_flange._moves().values() for runs in moves.values()) == 54
    assert len(steel_cantilever.readings()) == 8
    groups = [each.group for each in pazy_wing.readings().values()]
    assert (groups.count("displacement"), groups.count("twist")) == (48, 23)
    for measurement in MEASUREMENTS.values():
        assert all(reading.u > 0 for reading in measurement.all_readings().values())


def results(name: str, **changes):
    """Results of a case by quantity and situation, and its table."""
    case = CASES[name]
    settings = msgspec.structs.replace(kind_of(case)[1], **changes)
    found, tables = {}, []
    for each in KINDS[case.kind].measurements(case, settings):
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
    S, verdicts = (c[f"held out {name}"] for name in ("S", "verdict"))
    assert np.isnan(S).all() and not any(verdicts)
    assert np.allclose(c["order"][:2], 2.0, atol=0.1)  # order of the rule, for the hanging and the upright strip


def test_a_missing_measurement_is_named():
    case = CASES["measured_pazy_wing"]
    settings = kind_of(case)[1]
    with refused(ArgumentError, "unknown-name"):
        list(kind.measured(case, msgspec.structs.replace(settings, measurement="wing")))


@pytest.mark.slow
def test_the_first_screen_shows_the_results_of_the_cases():
    _, series = results("measured_steel_cantilever", draws=0)
    (group,) = groups_of("measured_steel_cantilever", "Bar: bent", series)
    assert group.title == "Bar" and group.predicted
    assert np.allclose(group.error, 100 * series.columns["E"] / series.columns["D"])
    assert (group.free.counts, group.held_out.counts, group.undecided) == ("0 of 8", "8 of 8", 0)
    assert group.held_out.rms < 1.0 and group.free.rms > 7.0
    (line,) = table_of([group]).lines
    assert (line[0], line[1], line[3], line[5], line[7]) == ("Bar: frequency", 8.0, "0 of 8", "8 of 8", 0.0)
    reviewed("measured arms: expectation", expectation([group]))


def group_of(name: str, E: list[float], u: float, verdicts: list[str], held_out: list[str]) -> Group:
    """A group of readings of 100, whose held-out errors are a tenth of those with nothing fitted."""
    E = np.array(E)
    columns = {
        "quantity": np.full(len(E), name),
        "S": 100 + E,
        "D": np.full(len(E), 100.0),
        "E": E,
        "u_val": np.full(len(E), u),
        "verdict": np.array(verdicts),
    }
    columns |= {
        "held out S": 100 + E / 10,
        "held out u_val": np.full(len(E), u),
        "held out verdict": np.array(held_out),
    }
    return Group("case", "title", name, columns)


def test_a_reading_that_cannot_decide_is_not_counted_and_what_is_refuted_is_not_predicted():
    good, bad, vague = kind.VERDICTS
    bent = group_of("frequency", [5.0, -7.0, 30.0], 1.0, [good, bad, vague], [good, good, vague])
    twist = group_of("twist", [150.0, 200.0], 1.0, [bad, bad], [bad, bad])
    lines = lines_of([bent, twist])
    assert (lines.free.counts, lines.held_out.counts, lines.undecided) == ("1 of 4", "2 of 4", 1)
    assert bent.free.rms == pytest.approx(math.sqrt(37.0)) and bent.held_out.rms == pytest.approx(math.sqrt(0.37))
    assert bent.predicted and not twist.predicted
    assert [lines_of([group_of("g", [1.0], 1.0, [each], [""])]).all_agree for each in (good, bad, vague)] == [
        True, False, False,
    ]  # fmt: skip
    text = expectation([bent, twist])
    reviewed("measured arms: expectation", text)


def test_a_bar_is_the_error_with_two_standard_uncertainties():
    drawn = _figure([group_of("frequency", [5.0], 1.5, [kind.VERDICTS[0]], [""])]).axes[0].lines
    assert [np.asarray(line.get_xdata()).tolist() for line in drawn] == [[2.0, 8.0], [5.0], [0.0, 0.0]]


def test_a_comparison_with_fitted_inputs_is_not_one_from_a_drawing():
    ringing = group_of("ringing", [0.0, 0.0], 1.0, [kind.VERDICTS[0]] * 2, [kind.VERDICTS[0]] * 2)
    assert len(ringing.free.error) == 0 and ringing.held_out.counts == "2 of 2" and ringing.undecided == 0


def test_limits_demand_that_84_of_the_readings_agree_when_held_out():
    wanted = [
        quantity.tolerance
        for case in CASES.values()
        for name, quantity in case.quantity.items()
        if name.startswith("agree when held out") and quantity.tolerance
    ]
    assert sum(wanted) >= 84


def test_a_pooled_trend_is_free_of_errors_that_readings_share():
    """Ratios to one wrong reading are all wrong; a regression with a level for each series has the right scatter."""
    rng, factor, u = np.random.default_rng(3), 1.1, 0.02
    names = [[f"{mode}, {k}" for k in range(4)] for mode in "abc"]
    computed = {each: float(np.exp(0.1 * k + m)) for m, series in enumerate(names) for k, each in enumerate(series)}
    trends = []
    for _ in range(400):
        readings = {
            each: Reading(value := s**factor * float(np.exp(u * rng.standard_normal())), u * value, "Hz", "")
            for each, s in computed.items()
        }
        trends.append(pooled("trend", "ratios", names, readings, computed))
    found = np.array([each.factor for each in trends])
    assert found.mean() == pytest.approx(factor, abs=3 * trends[0].u / 20)
    assert found.std() == pytest.approx(trends[0].u, rel=0.15)
    assert trends[0].freedom == 9


def test_refits_of_the_ringing_are_those_of_the_stored_study():
    refits = kind_of(CASES["measured_laboratory_ringing"])[1].refits
    for name, values in refits.items():
        (row,) = stored_rows("measured_two_link_fit", "scatter of the ringing", situation=name)
        assert row["note"] == f"Values: {', '.join(f'{value:.4g}' for value in values)}."
        assert of_one(values) == pytest.approx(1.591 * float(row["value"]), rel=5e-3)  # t / 2 for 3 degrees of freedom


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
    found, series = results("measured_laboratory_ringing", refits={})
    wide = series.columns["u_input"]
    assert [found[verdict, "ringing"].value for verdict in kind.VERDICTS] == [0, 0, 2]
    assert max(each.value for (quantity, _), each in found.items() if quantity == "second way") < 0.2
    found, series = results("measured_laboratory_ringing", draws=0)
    assert (series.columns["u_input"] < wide / 2).all()
    assert [found[verdict, "ringing"].value for verdict in kind.VERDICTS] == [2, 0, 0]
    assert found["not validated", "damping"].value == 1


HERTZ, ZETA, NOISE = 3.0567, 0.006, 0.02
SIZES = np.array([0.30, 0.02, 0.22, 0.1, 0.15, 0.05, 0.0])  # of the joints' torques at the end of the recording [N m]


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


def test_the_limit_of_sticking_hardly_changes_the_frequencies_at_amplitude_zero(monkeypatch) -> None:
    usual = {attitude: strip_on_flange.at_zero(attitude).reading for attitude in ("down", "up", "level")}
    monkeypatch.setattr(strip_on_flange, "STICKING", 2.7)
    for attitude, (value, u) in usual.items():
        other, _ = strip_on_flange.at_zero(attitude).reading
        assert 0 < abs(other - value) < COVERAGE * u


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
    found = fit_one_number(CANDIDATE, 1.0, readings, NAMES[:4], start)
    assert found.value == pytest.approx(1.21, rel=3e-3)
    assert abs(found.value / 1.21 - 1) < found.u_relative < 0.01
    assert found.after < 0.5 and found.before > 10
    assert found.count() == 4 == len(found.others)
    assert all(each.verdict == "not validated" for each in start.compared.values())


def test_an_error_that_no_stiffness_explains_remains() -> None:
    """The higher modes are wrong by another factor than the lower ones."""
    measured = {name: f * (1.1 if k < 4 else 1.3) for k, (name, f) in enumerate(frequencies(1.0).items())}
    readings, start = study(measured)
    found = fit_one_number(CANDIDATE, 1.0, readings, NAMES[:4], start)
    assert found.value == pytest.approx(1.21, rel=3e-3)
    assert found.count("not validated") == 4


def test_an_input_that_the_number_compensates_adds_no_uncertainty() -> None:
    """Stiffness over mass is all that the frequencies show: after a fit, the tolerance of the mass has no effect."""
    sharp, loose = (
        fit_one_number(CANDIDATE, 1.0, readings, NAMES[:4], start)
        for readings, start in (study(frequencies(1.21), effect) for effect in (0.0, 0.1))
    )
    for name, each in loose.others.items():
        assert each.u_input == pytest.approx(sharp.others[name].u_input, rel=1e-2)


def test_a_number_without_effect_or_at_its_limit_changes_no_verdict() -> None:
    readings, start = study(frequencies(1.21))
    deaf = Study(start.compared, start.inputs, lambda _: start.predict(None))
    found = fit_one_number(CANDIDATE, 1.0, readings, NAMES[:4], deaf)
    assert math.isinf(found.u_relative) and not found.at_limit
    assert found.others == {name: start.compared[name] for name in NAMES[4:]}
    narrow = Candidate(path="stiffness", unit="N m", low=0.9, high=1.1)
    found = fit_one_number(narrow, 1.0, readings, NAMES[:4], start)
    assert found.at_limit and found.value == pytest.approx(1.1, rel=1e-2)
    assert found.others == {name: start.compared[name] for name in NAMES[4:]}


def test_patterns_choose_the_fitted_quantities() -> None:
    names = ["flap 1, 0 rpm, 0°", "flap 1, 500 rpm, 0°", "flap 2, 0 rpm, 30°"]
    assert chosen(names, ["*, 0 rpm, *"]) == ([names[0], names[2]], [names[1]])


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


def rows(name: str, **changes: object) -> list[Measured]:
    (case,) = load_cases(name)
    settings = msgspec.structs.replace(kind_of(case)[1], **changes)
    return [each for each in KINDS[case.kind].measurements(case, settings) if isinstance(each, Measured)]


def test_a_wrong_tolerance_of_the_readings_fails_the_second_way(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene(scene_file("swept_beam")).varied({"link.straight.segments": 9, "link.tip.segments": 3})
    computed = rotating_beam.predicted(scene)

    def off() -> float:
        first, second = rotating_beam.readings(), rotating_beam.u_again(computed)
        return max(disagreement(first[name].u, u, first[name].u) for name, u in second.items())

    assert off() < 0.2
    monkeypatch.setattr(rotating_beam, "READ_WITHIN", 0.04)
    assert off() > 0.2


def test_the_interval_of_a_drawing_contains_95_percent_of_readings_of_arms_within_it() -> None:
    """True inputs are anywhere in their ranges; one of them only softens the arm, so the middle is shifted."""
    rng, slopes = np.random.default_rng(6), np.array([-6.0, 3.0, 2.0])
    every = {}
    for k in range(2000):
        D = 100.0 + slopes @ (rng.random(3) - [0.0, 0.5, 0.5]) + 0.5 * rng.standard_normal()
        every[f"arm {k}"] = Comparison(100.0, D, Convergence(2.0, 0.0), 0.0, 0.5, 10.0)
    coarse = dict.fromkeys(every, 99.0)
    ends = [[dict.fromkeys(every, 99.0 + x) for x in pair] for pair in ((-6.0, 0.0), (-1.5, 1.5), (1.0, -1.0))]
    share, width = kind._intervals(every, coarse, ends)
    assert 0.95 <= share.value < 0.995  # a sum of few rectangles has shorter tails than a normal distribution
    assert width.value == pytest.approx(2 * math.hypot(*slopes / math.sqrt(12), 0.5) / 98.5, rel=0.02)


def test_scatter_beyond_the_reading_error_widens_the_prediction_of_held_out_readings() -> None:
    """Relative errors of 2 % on readings of 0.5 %: half of the modes predict the others, 95 % of which are inside."""
    rng, inside, scatters = np.random.default_rng(4), [], []
    for _ in range(200):
        measured = {name: f * float(np.exp(0.02 * rng.standard_normal())) for name, f in frequencies(1.21).items()}
        readings, start = study(measured)
        found = fit_one_number(CANDIDATE, 1.0, readings, NAMES[::2], start)
        scatters.append(found.scatter**2)
        inside += [abs(each.error) <= COVERAGE * each.u_val for each in found.others.values()]
    assert np.mean(scatters) == pytest.approx(0.02**2, rel=0.2)
    assert 0.82 < np.mean(inside) < 0.95  # a scatter from four readings has three degrees of freedom: t = 3.18, not 2


def test_the_candidate_that_explains_a_half_is_chosen_and_its_half_does_not_see_the_other() -> None:
    readings, start = study(frequencies(1.21))
    deaf = Study(start.compared, start.inputs, lambda _: start.predict(None))
    wanted = OneNumber(
        groups=["frequency"],
        half=["mode [13]"],
        candidate={"colour": Candidate(path="colour", unit="1"), "stiffness": CANDIDATE},
    )
    first, second = wanted.halves(readings)
    assert (first, second) == (["mode 1", "mode 3"], [name for name in NAMES if name not in first])
    spoilt = readings | {name: readings[name]._replace(value=2 * readings[name].value) for name in second}
    for given in (readings, spoilt):
        found = choose(wanted, first, given, lambda each: (1.0, start if each is CANDIDATE else deaf))
        assert found.name == "stiffness" and found.fitted is not None
        assert found.fitted.value == pytest.approx(1.21, rel=3e-3)
        assert set(found.fitted.others) == set(second)
    assert choose(wanted, first, readings, lambda _: (1.0, deaf)).fitted is None


def test_the_candidate_that_is_chosen_leaves_the_smallest_misfit_after_its_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    left = {"first": 2.0, "second": 0.5, "unusable": 0.1}
    fits = iter(SimpleNamespace(before=3.0, after=after, usable=name != "unusable") for name, after in left.items())
    monkeypatch.setattr(one_number, "fit_one_number", lambda *_: next(fits))
    candidates = {name: Candidate(path=name, unit="1") for name in left}
    wanted = OneNumber(groups=["g"], half=["h"], candidate=candidates)
    readings, start = study(frequencies(1.0))
    assert choose(wanted, [], readings, lambda _: (1.0, start)).name == "second"


def test_a_validated_quantity_is_printed_with_the_accuracy_that_was_shown() -> None:
    note = next(
        each.note for each in rows("measured_strip_on_flange", draws=0, one_number=None)
        if each.varied.get("situation") == "down, at amplitude zero"
    )  # fmt: skip
    assert "accuracy ± 3.6 %" in note


def test_the_uncertainty_of_a_negative_number_is_positive() -> None:
    columns = {"E": 0.1, "D": -2.0, "u_val": 0.1}
    group = Group("case", "title", "group", {name: np.array([x]) for name, x in columns.items()})
    assert (group.error.tolist(), group.u_val.tolist()) == ([-5.0], [5.0])
