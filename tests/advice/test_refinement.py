"""The model error that a report states is confirmed by finer models and smaller steps."""

from types import SimpleNamespace

import numpy as np
import pytest

import flexlink as fl
from flexlink.advice.model import Bend
from flexlink.results.tip_motion import largest_distance
from flexlink.scene_report.refinement import Refinement, scaled
from flexlink.scene_report.study import Study
from tests.conftest import ROOT
from tests.support.words import reviewed

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene() -> fl.Scene:
    """A damped move in space with a method whose steps leave a visible error."""
    changes = {"run.duration": 0.6, "run.method": "RK2", "run.step": 2.5e-4}
    return fl.load_scene(ROOT / "models" / "ptp_move.toml").varied(changes)


@pytest.fixture(scope="module")
def thrown() -> fl.Scene:
    return fl.load_scene(ROOT / "models" / "t3_spatial.toml").varied({"run.duration": 0.3})


@pytest.fixture(scope="module")
def about(scene: fl.Scene) -> Refinement:
    return Refinement(Study(scene))


def test_the_error_of_the_limit_covers_its_distance_from_a_much_finer_model(about: Refinement, scene: fl.Scene) -> None:
    finest = scene.varied({"link.*.segments": 17, "run.tolerance": 1e-6, "run.method": "Radau5"})
    assert about.limit is not None
    assert about.is_accurate
    assert largest_distance(fl.simulate(finest).tip, about.limit.tip) <= about.limit.error
    assert about.limit.error < 0.5 * about.error(about.cuts[1.0].tip)


def test_the_limit_of_models_with_errors_of_second_order_is_exact(scene: fl.Scene) -> None:
    about = Refinement(Study(scene))
    true, off = about.run.tip, np.array([0.0, 1e-2, 0.0])
    about.__dict__["cuts"] = {factor: SimpleNamespace(tip=true + off / factor**2) for factor in (1.0, 2.0, 4.0)}
    assert about.limit is not None
    assert about.limit.order == pytest.approx(2.0, rel=1e-9)
    np.testing.assert_allclose(about.limit.tip, true, atol=1e-14)


def test_a_scene_with_one_hinge_is_refined_to_two_and_four_hinges(thrown: fl.Scene) -> None:
    one = thrown.varied({"link.*.lumping": "legendre", "link.*.segments": 2, "run.duration": 0.05})
    assert list(Refinement(Study(one)).cuts) == [1.0, 2.0, 4.0]


@pytest.mark.parametrize(("rule", "hinges", "half"), [
    ("legendre", 6, 3), ("gauss", 8, 4), ("gauss", 6, 4), ("gauss", 2, 2), ("gregory", 7, 6), ("paper", 1, 1),
])  # fmt: skip
def test_half_the_hinges_are_the_nearest_number_that_the_rule_allows(rule: str, hinges: int, half: int) -> None:
    assert scaled(Bend("yz", rule, hinges), 0.5) == Bend("yz", rule, half)
    assert scaled(Bend("yz", rule, hinges), 2.0) == Bend("yz", rule, 2 * hinges)


def test_the_step_error_is_the_distance_from_a_run_with_much_smaller_steps(about: Refinement, scene: fl.Scene) -> None:
    exact = fl.simulate(scene, method="RK4", step=1e-4)
    assert about.of_steps == pytest.approx(largest_distance(about.run.tip, exact.tip), rel=0.2)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])  # [m]
def test_the_error_of_a_tolerance_is_the_distance_from_much_smaller_steps(thrown: fl.Scene, tolerance: float) -> None:
    """The run's own estimate is up to a hundred times larger, and would be taken for an error of the hinges."""
    loose = Refinement(Study(thrown.varied({"run.tolerance": tolerance, "run.method": "auto"})))
    exact = fl.simulate(thrown, method="auto", tolerance=1e-9)
    true = largest_distance(loose.run.tip, exact.tip)
    assert loose.of_steps == pytest.approx(true, rel=0.1, abs=loose.converged.error)


@pytest.mark.parametrize("changes", [{"run.tolerance": 1e-2, "run.method": "auto"}, {"run.method": "RK2"}], ids=str)
def test_errors_of_hinges_and_steps_are_those_of_converged_runs_and_their_sum_is_at_least_the_whole(
    thrown: fl.Scene, changes: dict[str, object]
) -> None:
    """The beam's motion is that of sixteen times the hinges by another rule."""
    about = Refinement(Study(thrown.varied(changes)))
    fine = {"link.*.segments": 33, "link.*.lumping": "lobatto4", "run.method": "auto", "run.tolerance": 1e-6}
    assert about.limit is not None
    beam, steady = fl.simulate(thrown.varied(fine)).tip, fl.simulate(thrown, method="auto", tolerance=1e-9).tip
    assert about.of_hinges == pytest.approx(largest_distance(steady, beam), rel=0.2, abs=2 * about.limit.error)
    assert about.error(about.run.tip) <= about.of_hinges + about.of_steps
    assert largest_distance(about.run.tip, beam) <= about.of_hinges + about.of_steps + about.limit.error


def test_the_error_of_the_hinges_does_not_depend_on_the_steps(about: Refinement, scene: fl.Scene) -> None:
    coarse = Refinement(Study(scene.varied({"run.step": 5e-4})))
    assert coarse.of_steps == pytest.approx(4 * about.of_steps, rel=0.01)  # RK2, twice the step
    assert coarse.of_hinges == pytest.approx(about.of_hinges, rel=1e-4)


@pytest.mark.parametrize("changes", [{}, {"run.step": None, "run.method": "auto", "run.tolerance": 3e-3}], ids=str)
def test_errors_of_steps_that_the_motion_amplifies_are_not_errors_of_the_hinges(changes: dict[str, object]) -> None:
    """In this fall, steps within 1e-5 of the travel move the tip by twenty times the true error of the hinges."""
    raised = fl.load_scene(ROOT / "models" / "paper_fig5_raised.toml").varied({"run.duration": 1.5, **changes})
    about = Refinement(Study(raised))
    own, fine = (fl.simulate(raised.varied({"link.*.segments": n}), tolerance=1e-7).tip for n in (5, 33))
    assert about.of_hinges == pytest.approx(largest_distance(own, fine), rel=0.2)


def test_the_cost_of_a_choice_is_proportional_to_its_evaluations(about: Refinement) -> None:
    own, *others = about.choices()
    reviewed("report: labels of choices", "\n".join(one.label for one in others))
    same = [one.seconds / own.seconds for one in others if one.n == own.n][:2]
    assert same == pytest.approx([0.5, 2.0], rel=1e-12)  # measured with double and with half the step
    assert [one.label for one in others if not one.outcome.completed] == []
    assert {one.n for one in others} - {own.n} != set()
    assert about.cut(0.5) == about.model  # two hinges: gauss allows only pairs


def test_a_scene_that_specifies_all_joints_has_no_other_discretization(thrown: fl.Scene) -> None:
    q = np.zeros(fl.lump(thrown).n)
    about = Refinement(Study(thrown.varied({"initial.q": q, "run.duration": 0.05})))
    assert about.limit is None
    own, *others = about.choices()
    reviewed("report: labels of choices", "\n".join(one.label for one in others))
    assert [one.seconds / own.seconds for one in others[:2]] == pytest.approx([0.5, 2.0], rel=1e-12)
    assert {one.n for one in others} <= {own.n, len(fl.lump(thrown).active)}


def test_without_convergence_the_error_of_the_limit_is_the_largest_change() -> None:
    """Changes of 12 mm and 10 mm show no convergence, so the limit is the finest model with an error of 12 mm."""
    about = object.__new__(Refinement)
    paths = {1.0: 0.0, 2.0: 0.012, 4.0: 0.022}
    about.__dict__["cuts"] = {factor: SimpleNamespace(tip=np.array([[x, 0.0, 0.0]])) for factor, x in paths.items()}
    assert about.limit is not None
    assert (about.limit.tip[0, 0], about.limit.error) == (0.022, pytest.approx(0.012))
    assert np.isnan(about.limit.order)
