"""Cost versus accuracy: stored references belong to their scenes, and independent solvers agree."""

import math

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.spec import decode
from flexlink.results.tip_motion import tip_travel
from tests.support.words import reviewed
from validation.kinds import speed_trade
from validation.reference_values import reference_array
from validation.trade import native_ladder, witness_ladder
from validation.trade import references as trade_references
from validation.trade import scenes as trade
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

    monkeypatch.setattr(witness_ladder, "points", points)
    monkeypatch.setattr(speed_trade.native_ladder, "by_step", lambda *_: [])
    settings = {"errors": [1e-4], "methods": [], "budget": 1.0, "witnesses": ["drake", "exudyn"]}
    chosen = decode(settings | {"scenes": ["p2p5"], "witness_scenes": ["p2p5"]}, speed_trade.Settings)
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
    monkeypatch.setattr(native_ladder, "_point", lambda _name, _scene, setting, *_: point(setting))
    found = [each.setting for each in native_ladder.by_tolerance("kick11", "Radau5", 1.0, 1e-8)]
    return [each / found[0] for each in found]


def test_tolerance_refinement_ends_at_small_errors_or_at_the_budget(monkeypatch):
    first = native_ladder.COARSEST * tip_travel(trade.reference("kick11").tip)
    both = tolerances(monkeypatch, lambda tol: Point(tol, 1e-9, 0.1, 3e-8 * tol / first, int(1e6 / tol)))
    assert both == pytest.approx([1.0, 10**-0.25, 10**-0.5])
    assert tolerances(monkeypatch, lambda tol: Point(tol, 1e-3, 1.0, 1e-3, 1)) == [1.0]

    def dear(setting):
        raise native_ladder.TooDearError("too dear")

    monkeypatch.setattr(native_ladder, "_point", lambda *_: dear(0.0))
    assert native_ladder.by_tolerance("kick11", "Radau5", 1.0, 1e-8) == []


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
