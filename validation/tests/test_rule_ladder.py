"""Comparison of lumping rules: the grid is complete, the cheapest run counts, and advice belongs to its rule family."""

import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.errors import DataFileError
from flexlink.describe.spec import decode
from tests.support.words import refused
from validation.case import CASES, STUDY_SCENES, load_case
from validation.kinds import speed_rules
from validation.physics.variant import Rule
from validation.trade.rule_ladder import Reference, Tried, cut
from validation.trade.work_precision import Point

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
