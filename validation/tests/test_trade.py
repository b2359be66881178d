"""Cost versus accuracy: references belong to their scenes, the cheapest run counts, an error is split into parts."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.errors import DataFileError
from flexlink.describe.scene_file import load_scene
from flexlink.describe.spec import decode
from flexlink.results.tip_motion import tip_travel
from reports.figures import checks as figure
from reports.findings import errors as finding
from reports.results import Results
from tests.support.words import refused, reviewed
from validation.case import CASES, MODELS, STUDY_SCENES, load_case
from validation.kinds import speed_rules, speed_trade
from validation.physics.variant import Rule
from validation.reference_values import reference_array
from validation.store import Series, Store, table
from validation.tests.studies import row, stored
from validation.trade import contestants, with_flexlink
from validation.trade import references as trade_references
from validation.trade import scenes as trade
from validation.trade.error_parts import Fine, Setup, Splitter
from validation.trade.rule_ladder import Reference, Tried, cut
from validation.trade.work_precision import Point, cost, ladder

NAMES = list(trade.scenes())


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_reference_belongs_to_the_current_scene_and_two_methods_agree(name):
    assert trade.is_of(trade.trade_scene(name), name)
    assert reference_array(trade.reference_name(name), "agree") <= trade_references.AGREE
    assert {part.shape for part in trade.reference(name)} == {(trade.OUTPUTS + 1, 3)}


def test_a_scene_with_another_stiffness_does_not_match_the_reference():
    scene = trade.trade_scene("pulse11")
    young = scene.arm.materials["thin"].young
    assert trade.is_of(scene, "pulse11")
    stiffer = scene.varied({"material.thin.young": young * (1 + 1e-6)})
    assert not trade.is_of(stiffer, "pulse11")


def test_errors_are_relative_to_the_motion_and_infinite_without_a_run():
    exact = trade.reference("paper")
    assert trade.errors("paper", exact) == (0.0, 0.0)
    moved = trade.errors("paper", exact._replace(tip=exact.tip + np.array([0.0, 0.0, 0.01])))
    assert moved == (pytest.approx(0.01 / tip_travel(exact.tip)), 0.0)
    assert trade.errors("paper", exact._replace(bend=1.25 * exact.bend)) == (0.0, pytest.approx(0.25))
    assert trade.errors("paper", exact._replace(tip=np.full_like(exact.tip, np.nan))) == (math.inf, 0.0)


def test_a_missing_engine_is_omitted_and_the_others_run_their_scenes(monkeypatch):
    def points(engine, *_):
        if engine == "drake":
            raise fl.errors.MissingDependencyError("Drake cannot be imported")
        return {"RK44": [Point(1e-3, 1e-5, 1.0)]}

    monkeypatch.setattr(contestants, "witnessed", points)
    monkeypatch.setattr(speed_trade.with_flexlink, "by_step", lambda *_: [])
    settings = {"errors": [1e-4], "methods": [], "budget": 1.0, "witnesses": ["drake", "exudyn"]}
    chosen = decode(settings | {"scenes": ["p2p5"], "witness_scenes": ["p2p5"]}, speed_trade.SpeedTradeSettings)
    assert speed_trade._others("p2p5", chosen)["Exudyn"] == points("exudyn")
    assert "Drake" not in speed_trade._others("p2p5", chosen)
    assert "Exudyn" not in speed_trade._others("p2p", chosen)


def test_step_refinement_ends_at_small_errors_or_before_the_time_budget():
    def run(steps: int) -> Point:
        return Point(1 / steps, 0.1 / steps**2, 1e-3 * steps, bend=1 / steps**2)

    assert [point.setting for point in ladder(run, 1, 1.0, 1e-2)] == [1, 1 / 2, 1 / 4, 1 / 8, 1 / 16]
    assert [point.setting for point in ladder(run, 1, 4e-3, 1e-9)] == [1, 1 / 2, 1 / 4]


def tolerances(monkeypatch, point):
    """Tolerances of a refinement whose runs give these points, relative to the first tolerance."""
    monkeypatch.setattr(with_flexlink, "attempt", lambda _name, _contestant, _method, setting: point(setting))
    found = [each.setting for each in with_flexlink.by_tolerance("kick11", "Radau5", 1.0, 1e-8)]
    return [each / found[0] for each in found]


def test_tolerance_refinement_ends_at_small_errors_or_at_the_budget(monkeypatch):
    first = with_flexlink.COARSEST * tip_travel(trade.reference("kick11").tip)
    both = tolerances(monkeypatch, lambda tol: Point(tol, 1e-9, 0.1, 3e-8 * tol / first, int(1e6 / tol)))
    assert both == pytest.approx([1.0, 10**-0.25, 10**-0.5])
    assert tolerances(monkeypatch, lambda tol: Point(tol, 1e-3, 1.0, 1e-3, 1)) == [1.0]

    def dear(setting):
        raise contestants.TooDearError("too dear")

    monkeypatch.setattr(with_flexlink, "attempt", lambda *_: dear(0.0))
    assert with_flexlink.by_tolerance("kick11", "Radau5", 1.0, 1e-8) == []


def test_tolerances_are_skipped_by_decades_if_stability_limits_the_steps(monkeypatch):
    found = tolerances(monkeypatch, lambda setting: Point(setting, 1e-3, 0.1, 1e-3, 16320))
    assert found[:4] == pytest.approx([1.0, 10**-0.25, 10**-1.25, 10**-2.25])
    grows = tolerances(monkeypatch, lambda setting: Point(setting, 1e-3, 0.1, 1e-3, int(100 * setting**-0.2)))
    assert grows[:4] == pytest.approx([1.0, 10**-0.25, 10**-0.5, 10**-0.75])


def test_the_cost_of_an_error_is_interpolated_and_extrapolated_by_the_order():
    points = [Point(1.0, math.inf, 0.1), Point(0.5, 1e-2, 1.0), Point(0.25, 1e-4, 2.0)]
    assert cost(points, 1e-1, 1.0) == (1.0, "measured")
    assert cost(points, 1e-3, 1.0) == (pytest.approx(math.sqrt(2)), "measured")
    assert cost(points[:2], 1e-4, 2.0) == (pytest.approx(10.0), "order")
    assert cost(points[:1], 1e-4, 2.0) is None


def test_only_costs_of_other_programs_are_extrapolated():
    ours = {"Radau5": [Point(1e-2, 1e-3, 1.0), Point(1e-3, 1e-5, 2.0)]}
    others = {
        "RK4": {"RK4 at its limit": [Point(1e-6, math.nan, 100.0)]},
        "MuJoCo": {"Euler": [Point(0.1, 1e-2, 1.0), Point(0.05, 5e-3, 2.0)]},
        "solvers": {},
    }
    rows = {row.quantity: row for row in speed_trade._rows("t3", speed_trade.Aim("error", 1e-4), ours, others)}
    ratio = "/ flexlink, error"
    assert rows[f"RK4 {ratio} 0.0001"].value == 50
    assert rows[f"t3, MuJoCo {ratio} 0.0001"].value == pytest.approx(2.0 * 50 / 2.0)
    reviewed("trade: error by the order of a method", rows[f"MuJoCo {ratio} 0.0001"].note)
    note = rows[f"RK4 {ratio} 0.0001"].note
    reviewed("trade: measured error", note)
    for part in ("Radau5", " 0.001", "2000 ms"):
        assert part in note
    assert rows[f"RK4 {ratio} 0.0001{speed_trade.HARD_SCENE}"].value == 50
    rows = {row.quantity: row for row in speed_trade._rows("t3", speed_trade.Aim("error", 1e-6), ours, others)}
    assert rows[f"RK4 {ratio} 1e-06"].value == 0  # flexlink does not reach the error, so no limit is met


REFERENCE = Reference(rule="lobatto4", hinges=8, checked=4, method="Radau5", tolerance=1e-6)
RUN = {
    "gravity": [0.0, -8.0, 0.0], "material.unit.loss_time": 1e-2, "run.method": "Radau5", "run.step": None,
    "run.tolerance": 1e-4, "run.duration": 0.2, "run.sample": 0.05,
}  # fmt: skip


@pytest.fixture(scope="module")
def falling() -> fl.Scene:
    """A cantilever that falls for a short while."""
    return fl.load_scene(STUDY_SCENES / "unit_beam.toml").varied(RUN)


def tried(rule: str, hinges: int, error: float, seconds: float) -> Tried:
    return Tried(Rule(rule=rule, hinges=hinges), "Radau5", Point(1e-3, error, seconds), 2 * seconds)


def test_the_gain_compares_the_cheapest_runs_that_meet_the_error():
    settings = decode(load_case(CASES / "speed_axial.toml").settings, speed_rules.SpeedRulesSettings)
    race = settings.race[0]
    runs = [
        tried("gauss", 4, 2e-3, 1e-3), tried("gauss", 32, 5e-4, 8e-3), tried("gauss", 64, 1e-4, 9e-3),
        tried("lobatto2", 4, 9e-4, 3e-3), tried("lobatto4", 8, 1e-5, 2e-3),
    ]  # fmt: skip
    rows = list(speed_rules._rows(settings, race, "Radau5", 1e-3, runs))
    gains = {row.quantity: row.value for row in rows if "/" in row.quantity}
    assert gains == pytest.approx(dict.fromkeys(gains, 4.0))
    name = f"{race.name}: gauss / lobatto, Radau5, tip error 0.001 m"
    assert name in gains
    assert all(row.timed for row in rows)
    assert not any("/" in row.quantity for row in speed_rules._rows(settings, race, "Radau5", 1e-4, runs[3:]))


def test_an_advised_family_is_represented_by_its_cheapest_chain():
    case = load_case(CASES / "advice_axial.toml")
    settings = decode(case.settings, speed_rules.AdviceFamiliesSettings)
    met = [tried("gauss", 8, 1e-5, 3.0), tried("lobatto2", 4, 1e-5, 2.0), tried("lobatto4", 8, 1e-5, 1.5)]
    costs = [run.point.seconds for run in met]
    assert speed_rules._over_cheapest(settings, "gauss", met, costs)[0] == 2.0
    assert speed_rules._over_cheapest(settings, "lobatto", met, costs)[0] == 1.0


def test_the_family_of_an_advice_follows_from_the_rules_of_its_links(falling):
    case = load_case(CASES / "advice_axial.toml")
    settings = decode(case.settings, speed_rules.AdviceFamiliesSettings)
    assert speed_rules._family(settings, case, falling) == "gauss"  # the midpoint rule is in the gauss family
    assert speed_rules._family(settings, case, cut(falling, Rule(rule="lobatto4", hinges=4))) == "lobatto"
    stiff = fl.load_scene(STUDY_SCENES / "triple_pendulum_rods.toml")
    assert all(link.flex == "rigid" for link in stiff.arm.links)
    with refused(DataFileError, "test-rule-ladder"):
        speed_rules._family(settings, case, stiff)


@pytest.mark.slow
def test_the_kinds_run_completely_on_a_small_grid():
    case, finer = load_case(CASES / "speed_axial.toml"), replace(REFERENCE, hinges=16, checked=12)
    settings = decode(case.settings, speed_rules.SpeedRulesSettings)
    race = replace(settings.race[3], errors=(1e-2,), hinges={"Radau5": {"gauss": (8, 12), "lobatto2": (8,)}})
    small = replace(settings, reference=finer, tolerances=(1e-3, 1e-4), race=(race,))
    ratios = [row.quantity for row in speed_rules.speed_rules(case, small) if "/" in getattr(row, "quantity", "")]
    assert any("Radau5" in name and " 0.01 m" in name for name in ratios)
    case = load_case(CASES / "advice_axial.toml")
    defaults = decode(case.settings, speed_rules.AdviceFamiliesSettings)
    one = replace(defaults.asked[3], error=1e-2)
    hinges = {"gauss": (8, 12), "lobatto2": (8,)}
    small = replace(defaults, reference=finer, hinges=hinges, of_error=(1.0, 0.1), methods=("Radau5",), asked=(one,))
    rows = {row.quantity: row.value for row in speed_rules.advice_families(case, small)}
    within, cost = "advised within the allowed error", "advised family / cheapest, listed costs"
    assert rows[within] == 1.0
    assert rows[cost] >= 1.0


COARSE = {
    "model": Setup(flex="rigid", method="DOP853", tolerance=1e-10),
    "space": Setup(flex="z", hinges=1, method="DOP853", tolerance=1e-10),
    "time": Setup(flex="z", rule="gauss", hinges=8, method="Radau5", tolerance=1e-2),
}


@pytest.fixture(scope="module")
def scene():
    """A short fall of the paper's arm."""
    return load_scene(MODELS / "paper_fig5.toml").varied({"run.duration": 0.1, "run.sample": 0.01})


@pytest.fixture(scope="module")
def splits(scene):
    """Error parts of the same fall with soft links, for runs that are each coarse in one setting only."""
    exact = Fine(method="DOP853", tolerances=(1e-11, 1e-10), hinges=(10, 8))
    splitter = Splitter(scene.varied({"material.aluminium.young": 7e8}), "z", exact, exact)
    return {coarse: splitter.split(setup) for coarse, setup in COARSE.items()}


@pytest.mark.parametrize("coarse", COARSE)
def test_the_largest_error_part_belongs_to_the_coarse_setting(splits, coarse):
    parts = splits[coarse].parts
    assert max(parts, key=lambda name: parts[name].size) == coarse
    assert parts[coarse].own < 0.1 * parts[coarse].size


def test_a_rigid_arm_has_no_hinge_error_and_an_exact_model_no_model_error(splits):
    assert splits["model"].parts["space"].size == 0.0
    assert splits["space"].parts["model"].size == splits["time"].parts["model"].size == 0.0


LINES = (("coarse", 0.0, 2e-3, 1e-6, 1e-14, 2e-3), ("slack", 0.0, 1e-5, 1e-3, 1e-14, 1e-3))


@pytest.fixture
def results(tmp_path):
    where = stored(tmp_path / "results", row("split", kind="errors_split"))
    columns = table(("run", *finding.PARTS, "total"), LINES)
    Store(where).add_series("split", Series("errors", "title", columns, "run", "run", "error [m]", scene="arm"))
    return Results.read(where)


def test_the_error_table_names_the_largest_part_and_leaves_zeros_empty(results):
    (found,) = finding.errors_split(results)
    assert [(*line[:3], line[-1]) for line in found.lines] == [
        ("arm: coarse", None, "2", "space"), ("arm: slack", None, "0.01", "time"),
    ]  # fmt: skip
    text = " ".join(found.sentences)
    assert "2 runs" in text and " 1 of " in text and " 1 %" in text
    reviewed("errors split: finding", text)


def test_an_error_part_of_zero_is_not_drawn(results):
    (picture,) = figure.errors_split(results)
    (axes,) = picture.figure.axes
    drawn = {
        line.get_label(): len(np.asarray(line.get_xdata())) for line in axes.lines if line.get_linestyle() == "None"
    }
    assert drawn == {"model": 0, "space": 2, "time": 2, "rounding": 2, "total": 2}
