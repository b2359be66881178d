"""What a report says of its model's error is what finer models and smaller steps show."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT

import flexlink as fl
from flexlink.advice.model import Bend
from flexlink.results.tip_motion import largest_distance
from flexlink.scene_report.refinement import Refinement, scaled
from flexlink.scene_report.study import Study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene() -> fl.Scene:
    """A damped move in space, by a method whose steps leave an error that can be seen."""
    changes = {"run.duration": 0.6, "run.method": "RK2", "run.step": 2.5e-4}
    return fl.load_scene(ROOT / "models" / "ptp_move.toml").varied(changes)


@pytest.fixture(scope="module")
def thrown() -> fl.Scene:
    return fl.load_scene(ROOT / "models" / "t3_spatial.toml").varied({"run.duration": 0.3})


@pytest.fixture(scope="module")
def about(scene: fl.Scene) -> Refinement:
    return Refinement(Study(scene))


def test_the_limit_is_as_close_as_it_says_to_a_much_finer_model(about: Refinement, scene: fl.Scene) -> None:
    finest = scene.varied({"link.*.segments": 17, "run.tolerance": 1e-6, "run.method": "Radau5"})
    assert about.limit is not None
    assert about.is_known
    assert largest_distance(fl.simulate(finest).tip, about.limit.tip) <= about.limit.error
    assert about.limit.error < 0.5 * about.error(about.cuts[1.0].tip)


def test_cuts_whose_errors_fall_by_four_tend_to_where_they_fall(scene: fl.Scene) -> None:
    about = Refinement(Study(scene))
    true, off = about.run.tip, np.array([0.0, 1e-2, 0.0])
    about.__dict__["cuts"] = {factor: SimpleNamespace(tip=true + off / factor**2) for factor in (1.0, 2.0, 4.0)}
    assert about.limit is not None
    assert about.limit.order == pytest.approx(2.0, rel=1e-9)
    np.testing.assert_allclose(about.limit.tip, true, atol=1e-14)


def test_of_one_hinge_the_scene_itself_is_among_the_cuts(thrown: fl.Scene) -> None:
    one = thrown.varied({"link.*.lumping": "legendre", "link.*.segments": 2, "run.duration": 0.05})
    assert list(Refinement(Study(one)).cuts) == [1.0, 2.0, 4.0]


@pytest.mark.parametrize(("rule", "hinges", "half"), [
    ("legendre", 6, 3), ("gauss", 8, 4), ("gauss", 6, 4), ("gauss", 2, 2), ("gregory", 7, 6), ("paper", 1, 1),
])  # fmt: skip
def test_half_the_hinges_are_the_nearest_number_that_the_rule_takes(rule: str, hinges: int, half: int) -> None:
    assert scaled(Bend("yz", rule, hinges), 0.5) == Bend("yz", rule, half)
    assert scaled(Bend("yz", rule, hinges), 2.0) == Bend("yz", rule, 2 * hinges)


def test_the_error_of_steps_is_that_beside_much_smaller_ones(about: Refinement, scene: fl.Scene) -> None:
    exact = fl.simulate(scene, method="RK4", step=1e-4)
    assert about.of_steps == pytest.approx(largest_distance(about.run.tip, exact.tip), rel=0.2)


def test_a_tolerance_is_judged_by_a_tenth_of_it(thrown: fl.Scene) -> None:
    loose = Refinement(Study(thrown.varied({"run.tolerance": 1e-3, "run.method": "auto"})))
    exact = fl.simulate(thrown, method="auto", tolerance=1e-8)
    assert (
        largest_distance(loose.run.tip, exact.tip) / 3 < loose.of_steps < 3 * largest_distance(loose.run.tip, exact.tip)
    )


def test_choices_cost_what_their_evaluations_do_and_twice_the_step_half(about: Refinement) -> None:
    own, *others = about.choices()
    seconds = {one.label: one.seconds for one in others}
    assert own.seconds == pytest.approx(2 * seconds["twice the step"], rel=1e-12)
    assert own.seconds == pytest.approx(seconds["half the step"] / 2, rel=1e-12)
    assert [one.label for one in others if not one.outcome.completed] == []
    assert "half the hinges" not in seconds  # of two, which gauss takes in pairs only, none are fewer


def test_a_scene_that_starts_from_its_own_joints_has_no_other_cut(thrown: fl.Scene) -> None:
    q = np.zeros(fl.lump(thrown).n)
    about = Refinement(Study(thrown.varied({"initial.q": q, "run.duration": 0.05})))
    assert about.limit is None
    assert [one.label for one in about.choices()][1:3] == ["twice the step", "half the step"]
    assert not any("hinges" in one.label for one in about.choices())


def test_where_changes_do_not_fall_the_limit_is_off_by_the_largest_of_them() -> None:
    """12 mm, then 10 mm, which is no order: the finest cut, and 12 mm."""
    about = object.__new__(Refinement)
    paths = {1.0: 0.0, 2.0: 0.012, 4.0: 0.022}
    about.__dict__["cuts"] = {factor: SimpleNamespace(tip=np.array([[x, 0.0, 0.0]])) for factor, x in paths.items()}
    assert about.limit is not None
    assert (about.limit.tip[0, 0], about.limit.error) == (0.022, pytest.approx(0.012))
    assert np.isnan(about.limit.order)
