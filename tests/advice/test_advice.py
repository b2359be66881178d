"""Parts of advice tested separately: choice of steps, choice of models, accuracy of extrapolated limits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

import flexlink as fl
from flexlink.advice import horizon as horizons
from flexlink.advice import rigid
from flexlink.advice.allocation import Allocation
from flexlink.advice.axes import AxisScreening
from flexlink.advice.families import FAMILIES, rule_of
from flexlink.advice.goal import Goal, TipErrorNorm, goal_of
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Axes, Bend, Model, by_rule, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.refinement import Level, RefinementStudy
from flexlink.advice.release import release
from flexlink.advice.search import Search
from flexlink.advice.thresholds import Thresholds
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.results.convergence import Limit
from tests.support.words import reviewed

Array = NDArray[np.float64]
Errors = Callable[[float], float]
NORM = TipErrorNorm(Goal(1e-3), 0.01)
ALLOWED = 1e-3  # at the tip [m]


def along_x(*x: float) -> Array:
    """Tip path through the given positions on the x axis."""
    return np.array(x)[:, None] * [1.0, 0.0, 0.0]


def outcome(tip: Array, evaluations: int = 100, why: str = "") -> Outcome:
    """Outcome of a run that has only the fields which the tests read."""
    run = SimpleNamespace(steps=SimpleNamespace(evaluations=evaluations), t=0.01 * np.arange(len(tip)))
    return Outcome(tip, 1e-6 * evaluations, cast("Any", run), Stepping("Radau5"), why)


# models


class Beams:
    """Link k has the known error C_k / N² with N hinges, or 20 C_k if rigid, plus `less` for missing axes."""

    def __init__(self, *constants: float, axes: Axes | None = None, less: dict[tuple[int, str], float] | None = None):
        self.constants, self.less, self.bending = constants, less or {}, list(range(len(constants)))
        self.order, self.family = FAMILIES["gauss"].order, "gauss"
        self.refinement = SimpleNamespace(
            axes=axes or ("z",) * len(constants), family="gauss", finest=SimpleNamespace(hinges=40), travel=1.0
        )
        self.known: dict[Model, float] = {}

    def constant(self, k: int) -> float:
        return self.constants[k]

    def axes(self, k: int) -> list[str]:
        return [self.refinement.axes[k], *(flex for link, flex in self.less if link == k)]

    def error(self, model: Model) -> float:
        errors = [C / bend.hinges**2 if bend else 20 * C for C, bend in zip(self.constants, model, strict=True)]
        return sum(errors) + sum(self.less.get((k, bend.flex), 0.0) for k, bend in enumerate(model) if bend)

    def from_limit(self, tip: Array) -> float:
        return NORM(tip)


def hinges_of(model: Model | None) -> int:
    """Number of single-axis hinges of all links."""
    assert model is not None
    return sum(len(bend.flex) * bend.hinges for bend in model if bend)


def allocation(beams: Beams) -> Allocation:
    return Allocation(cast("LinkErrors", beams), hinges_of)


def cheapest_of_all(beams: Beams, allowed: float) -> int:
    counts = range(1, 41)
    models = (tuple(by_rule("z", n) for n in each) for each in itertools.product(counts, repeat=len(beams.constants)))
    return min(hinges_of(model) for model in models if beams.error(model) <= allowed)


@pytest.mark.parametrize("constants", [(1.0, 1.0), (1.0, 8.0), (3.0, 0.01), (0.2, 0.0)])
@pytest.mark.parametrize("allowed", [1e-1, 1e-2])
def test_allocation_uses_the_fewest_hinges_that_meet_the_error_limit(
    constants: tuple[float, ...], allowed: float
) -> None:
    beams = Beams(*constants)
    model = allocation(beams).cheapest(allowed)
    assert model is not None
    assert beams.error(model) <= allowed
    assert hinges_of(model) <= cheapest_of_all(beams, allowed) + 1


def test_hinge_counts_scale_with_the_cube_root_of_the_link_errors() -> None:
    model = allocation(Beams(1.0, 8.0)).cheapest(0.02)
    assert model is not None
    first, second = (bend.hinges for bend in model if bend)
    assert second / first == pytest.approx(2.0, rel=0.1)


def test_links_become_rigid_and_axes_are_dropped_if_the_error_limit_allows_it() -> None:
    assert allocation(Beams(1.0, 1e-6)).cheapest(1.1e-2) == (by_rule("z", 10), None)
    less = {(0, "z"): 2e-3, (0, "yz"): 1e-3}
    spatial = Beams(1e-2, axes=("xyz",), less=less)
    assert allocation(spatial).cheapest(5e-3) == (by_rule("z", 2),)
    assert allocation(spatial).cheapest(2.2e-3) == (by_rule("yz", 3),)


def test_a_link_that_bends_about_two_axes_gets_fewer_hinges() -> None:
    """One of two equal links bends about two axes and gets N ∝ (1/2)^(1/3) hinges per axis."""
    model = allocation(Beams(10.0, 10.0, axes=("z", "yz"))).cheapest(0.1)
    assert model is not None
    first, second = (bend.hinges for bend in model if bend)
    assert second / first == pytest.approx(0.5 ** (1 / 3), rel=0.05)


def test_error_predictions_are_corrected_by_the_measured_error_of_a_model() -> None:
    beams, allowed = Beams(1.0, 1.0), 1e-2
    models = allocation(beams)
    first = models.cheapest(allowed)
    assert first is not None
    models.learn(first, 2 * beams.error(first))
    second = models.cheapest(allowed)
    assert second is not None
    assert np.sqrt(2) * beams.error(second) <= allowed
    assert hinges_of(second) == pytest.approx(2**0.25 * hinges_of(first), rel=0.1)
    beams.known[first] = 1.1 * allowed  # measured; the predicted error was smaller
    assert allocation(beams).cheapest(allowed) != first


def test_no_model_is_proposed_with_far_more_hinges_than_were_run() -> None:
    beams = Beams(1.0, 1.0)
    assert allocation(beams).cheapest(1e-5) is None
    assert allocation(Beams(1.0, np.inf)).cheapest(1e-2) is None  # the error is unknown after a failed run


def bars(*, skew: float = 0.0) -> Scene:
    """Two soft bars that fall; the second joint is tilted out of the plane by `skew` [deg]."""
    links = tuple(
        fl.Link(
            name=f"bar{k}",
            length=1.0,
            material="steel",
            section="square",
            mount=fl.Mount(rpy_deg=(k * skew, 0, 0)),
        )
        for k in range(2)
    )
    square = fl.Section(shape="rectangle", height=0.006, width=0.006)
    return fl.Scene(
        name="bars", arm=fl.Arm(links=links, materials={"steel": fl.Material(young=210e9, density=7850.0)},
                                sections={"square": square}),
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(0.0, 0.0)),
        run=fl.RunSettings(duration=0.2, sample=0.01, step=0.01),
    )  # fmt: skip


@pytest.fixture(scope="module", params=[(0.0, ("z", "z")), (60.0, ("yz", "yz"))], ids=["plane", "space"])
def measured(request: pytest.FixtureRequest) -> tuple[ModelRunner, LinkErrors]:
    skew, axes = request.param
    scene = bars(skew=skew)
    runner, goal = ModelRunner(scene, 1.0), goal_of(1e-3, deflection=False, band=None, run=scene.run)
    refinement = RefinementStudy(runner, NORM, goal, axes, Stepping("Radau5", tolerance=1e-5))
    refinement.refine()
    return runner, LinkErrors(runner, NORM, refinement)


def test_measured_link_errors_add_up_to_the_model_error(measured: tuple[ModelRunner, LinkErrors]) -> None:
    runner, link_errors = measured
    axes, stepping = link_errors.refinement.axes, link_errors.refinement.stepping
    for counts in [(2, 4), (1, 4), (4, 1), (8, 4), (8, 8)]:
        model = tuple(by_rule(flex, n, link_errors.family) for flex, n in zip(axes, counts, strict=True))
        error = link_errors.from_limit(runner.run(model, stepping).tip)
        assert link_errors.error(model) == pytest.approx(error, rel=0.3, abs=0.2 * link_errors.refinement.tolerance)
    coarse, fine = (link_errors.error(uniform(axes, n, link_errors.family)) for n in (8, 16))
    assert coarse == pytest.approx(2**link_errors.order * fine)
    for model, error in link_errors.known.items():
        assert error == link_errors.from_limit(runner.run(model, stepping).tip)


def test_dropping_a_bending_axis_adds_the_measured_error(measured: tuple[ModelRunner, LinkErrors]) -> None:
    runner, link_errors = measured
    axes, stepping = link_errors.refinement.axes, link_errors.refinement.stepping
    for k in link_errors.bending:
        for flex in link_errors.axes(k)[1:]:
            fewer = (*axes[:k], flex, *axes[k + 1 :])
            model = uniform(fewer, link_errors.base, link_errors.family)
            error = link_errors.from_limit(runner.run(model, stepping).tip)
            assert link_errors.error(model) == pytest.approx(error, rel=0.05)


# steps


class Oracle:
    """A substitute runner for one link; errors and costs are known from the factor `tolerance / allowed error`.

    The error is C / N² plus `of_steps` times the allowed error; the cost is N times `evaluations`. Fixed
    steps have factor 0, no step error, and the cost `fixed` [s]. Those with DOP853 cost `explicit` times as much.
    """

    def __init__(self, of_steps: Errors, evaluations: Errors, fixed: float, explicit: float) -> None:
        self.explicit, self.methods, self.chosen = explicit, set[str](), ""
        self.beams, self.of_steps, self.evaluations, self.fixed = Beams(14.4 * ALLOWED), of_steps, evaluations, fixed
        links = [SimpleNamespace(joint=SimpleNamespace(locked=False))]
        self.scene = SimpleNamespace(arm=SimpleNamespace(links=links), run=SimpleNamespace(sample=0.01))
        self.budget, self.factors = 1.0, set[float]()

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        factor = (stepping.tolerance or 0.0) / ALLOWED
        self.factors.add(round(factor, 9))
        self.methods.add(stepping.method)
        error = self.beams.error(model) + self.of_steps(factor) * ALLOWED
        cost = hinges_of(model) * self.evaluations(factor) if factor else self.fixed
        cost *= self.explicit if stepping.method == "DOP853" else 1.0
        return outcome(along_x(0.0, error))._replace(stepping=stepping, seconds=cost)

    def evaluation_cost(self, model: Model, *, explicit: bool) -> float:
        return hinges_of(model)

    def least_explicit_cost(self, model: Model) -> float:
        return self.explicit * hinges_of(model) / 20

    def estimated_step(self, k: int, bend: Bend) -> float:
        return 1e-3

    def stable_step(self, model: Model) -> float:
        return 1e-3

    def fixed_steps(self, largest: float) -> Stepping | None:
        return Stepping("RK4", step=largest)

    def fixed_steps_cost(self, model: Model, stepping: Stepping) -> float:
        return self.fixed


def searched(
    of_steps: Errors, evaluations: Errors, fixed: float = 9.0, explicit: float = math.inf
) -> tuple[Oracle, int, float]:
    """The substitute runner, and the hinge count and tolerance factor found by the search."""
    oracle = Oracle(of_steps, evaluations, fixed, explicit)
    best = Search(cast("ModelRunner", oracle), cast("LinkErrors", oracle.beams), ALLOWED).best()
    assert best is not None
    assert best.error <= ALLOWED
    oracle.chosen = best.outcome.stepping.method
    return oracle, hinges_of(best.model), round((best.outcome.stepping.tolerance or 0.0) / ALLOWED, 9)


def test_tolerances_are_loosened_by_2_then_by_the_root_of_2_while_the_error_stays_within_its_limit() -> None:
    """With four hinges a tenth of the allowed error remains for the steps."""
    oracle, hinges, factor = searched(lambda x: 0.008 * x, lambda x: 0.1 * x**-0.1)
    assert (hinges, factor) == (4, round(8 * 2**0.5, 9))
    assert {1.0, 2.0, 4.0, 8.0, 16.0, factor} <= oracle.factors


def test_a_finer_model_is_chosen_if_a_looser_tolerance_makes_it_cheaper() -> None:
    _, hinges, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 / x)
    assert (hinges, factor) == (5, 32.0)


def test_fewer_hinges_are_chosen_if_errors_cancel() -> None:
    """Steps with eight times the allowed error make the model with three hinges accurate."""
    _, hinges, factor = searched(lambda x: -0.7 if x == 8.0 else 0.01 * x, lambda x: 0.1 * x**-0.1)
    assert (hinges, factor) == (3, 8.0)


@pytest.mark.parametrize(("explicit", "tried", "chosen"), [(0.5, True, True), (1.5, True, False), (9.0, False, False)])
def test_explicit_steps_are_tried_if_stability_allows_and_chosen_if_cheaper(
    explicit: float, tried: bool, chosen: bool
) -> None:
    runner, _, _ = searched(lambda x: 0.01 * x, lambda x: 0.1 * x**-0.1, explicit=explicit)
    assert ("DOP853" in runner.methods) == tried
    assert (runner.chosen == "DOP853") == chosen


def test_the_cheapest_tolerance_is_chosen() -> None:
    _, hinges, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 * max(1 / x, x / 16))
    assert (hinges, factor) == (4, 4.0)


def test_the_tolerance_is_tightened_if_the_step_error_is_too_large() -> None:
    _, hinges, factor = searched(lambda x: 2.0 * x, lambda x: 0.1 * x**-0.25)
    assert (hinges, factor) == (6, 0.25)


@pytest.mark.parametrize(("fixed", "taken"), [(0.01, True), (9.0, False)])
def test_fixed_steps_are_chosen_if_they_are_predicted_to_be_cheaper(fixed: float, taken: bool) -> None:
    oracle, _, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 * x**-0.25, fixed)
    assert (0.0 in oracle.factors) == taken
    assert (factor == 0.0) == taken


# limits


def study_of_levels(family: str = "gauss", **paths: Array) -> RefinementStudy:
    """A refinement with given tip paths for its levels n1, n2 … (the number is the hinge count)."""
    refinement = RefinementStudy(cast("ModelRunner", None), NORM, Goal(1e-3, metres=True), ("z",), Stepping("Radau5"))
    refinement.tolerance = 1e-3
    for name, path in paths.items():
        refinement.levels[family].append(Level(int(name[1:]), outcome(path)))
        if len(refinement.levels[family]) > 1:
            refinement.limit = refinement._estimate(family)
    return refinement


def test_second_order_levels_are_extrapolated_to_their_exact_limit() -> None:
    paths = {f"n{n}": along_x(0.0, 0.1 + 1e-3 / n**2, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    limit = study_of_levels(**paths).limit
    assert limit is not None
    assert limit.tip == pytest.approx(along_x(0.0, 0.1, 0.2), abs=1e-15)


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("levels", [(4, 8, 12), (8, 12, 16), (12, 16, 24), (24, 32, 48)])
def test_cell_levels_are_extrapolated_to_their_exact_limit_with_the_order_that_they_show(
    levels: tuple[int, ...], order: int
) -> None:
    """Large bending in space reduces the order of cells to 2."""
    paths = {f"n{n}": along_x(0.0, 0.1 + 1e-3 / n**order, 0.2 + 4e-3 / n**order) for n in levels}
    limit = study_of_levels("lobatto", **paths).limit
    assert limit is not None
    assert limit.tip == pytest.approx(along_x(0.0, 0.1, 0.2), abs=1e-15)


@pytest.mark.parametrize(
    ("family", "hinges", "rules"),
    [
        ("gauss", (1, 2, 3, 6, 8), ("midpoint", "gauss", "legendre", "gauss", "gauss")),
        ("legendre", (1, 2, 3, 6, 8), ("midpoint", "legendre", "legendre", "legendre", "legendre")),
        ("lobatto", (1, 2, 4, 8, 12), ("midpoint", "lobatto2", "lobatto4", "lobatto4", "lobatto4")),
    ],
)
def test_every_hinge_count_of_a_family_has_a_lumping_rule(
    family: str, hinges: tuple[int, ...], rules: tuple[str, ...]
) -> None:
    assert [rule_of(family, count) for count in hinges] == list(rules)
    for count in range(1, 40):
        taken = FAMILIES[family].rounded_up(count)
        assert taken >= count
        assert lumping_rule(rule_of(family, taken)).takes(taken)
        for fewer in FAMILIES[family].fewer(taken):
            assert 0 <= fewer < taken
            assert not fewer or lumping_rule(rule_of(family, fewer)).takes(fewer)


def test_limits_that_agree_by_chance_do_not_lower_the_error_estimate_too_far() -> None:
    first = {"n1": along_x(0.0, 0.03, 0.03), "n2": along_x(0.0, 0.02, 0.02), "n4": along_x(0.0, 0.012, 0.01)}
    before = study_of_levels(**first).limit
    assert before is not None
    chance = first["n4"] + (before.tip - first["n4"]) * (1 - (4 / 6) ** 2)  # gives the same limit
    limit = study_of_levels(**first, n6=chance).limit
    assert limit is not None
    assert limit.tip == pytest.approx(before.tip)
    assert limit.errors == pytest.approx(before.errors * (4 / 6) ** (2 + Thresholds.limit_fall))
    assert limit.errors[1] < limit.errors[2]  # the error is estimated at each time separately


def test_the_error_of_a_limit_is_estimated_from_its_change() -> None:
    paths = {"n1": along_x(0.0, 0.03), "n2": along_x(0.0, 0.02), "n4": along_x(0.0, 0.012)}
    limit = study_of_levels(**paths).limit
    assert limit is not None
    coarse, fine = (b + (b - a) / 3 for a, b in itertools.pairwise((0.03, 0.02, 0.012)))
    assert limit.error == pytest.approx(abs(fine - coarse) / FAMILIES["gauss"].safe)


def test_a_released_static_deflection_moves_the_joint_and_the_remainder_vibrates() -> None:
    """A bar with a heavy load sags by m g L³ / 3EI; on release the load stays in place, and the joint turns."""
    load, two = 1000.0, bars()
    arm = replace(two.arm, links=two.arm.links[:1], tip=fl.RigidBody(mass=load))
    initial = fl.InitialState(joint_deg=(0.0,), passive="static")
    scene = replace(two, arm=arm, gravity=(0.0, -0.001, 0.0), initial=initial)
    runner, model = ModelRunner(scene, 1.0), uniform(("z",), 2)
    strict = runner.run((None,), Stepping("Radau5", tolerance=1e-9))
    start, drift = release(runner, strict, model, np.zeros(runner.chain(model).n))
    sag = load * 0.001 / (3 * 210e9 * 0.006**4 / 12)
    assert start == pytest.approx([0.0, -sag, 0.0], abs=0.01 * sag)
    assert drift[0] == pytest.approx([0.0, -sag, 0.0], abs=0.01 * sag)
    straight = ModelRunner(replace(scene, initial=fl.InitialState(joint_deg=(0.0,))), 1.0)
    assert not release(straight, strict, model, np.zeros(3))[1].any()


class Strict:
    """A runner with known tip paths for stricter steps, one for each hinge count of the link."""

    def __init__(self, paths: dict[int, Array]) -> None:
        self.paths = paths

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        assert stepping.tolerance == pytest.approx(1e-5)  # a tenth of the tolerance of the study
        assert model[0] is not None
        return outcome(self.paths[model[0].hinges])


def with_strict_steps(off: dict[int, float], **strict: Array) -> RefinementStudy:
    """A refinement with known step errors in x at the last sample of each level, and known stricter runs."""
    refinement = study_of_levels(**{f"n{n}": strict[f"n{n}"] + along_x(0.0, x) for n, x in off.items()})
    refinement.stepping = Stepping("Radau5", tolerance=1e-4)
    refinement.runner = cast("ModelRunner", Strict({int(name[1:]): path for name, path in strict.items()}))
    return refinement


def test_step_errors_of_the_levels_are_removed_from_the_limit() -> None:
    exact = {f"n{n}": along_x(0.0, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    off = {1: 0.0, 2: 1e-6, 4: -7e-6}
    refinement = with_strict_steps(off, **exact)
    left = refinement.remove_step_errors()
    assert refinement.limit is not None
    assert refinement.limit.tip == pytest.approx(along_x(0.0, 0.2), abs=1e-15)
    assert left == pytest.approx([0.0, 0.1**0.5 * (off[2] + 4 * -off[4]) / 3])  # the limit is (4 x₄ − x₂) / 3


def test_if_the_last_strict_run_fails_a_coarser_level_estimates_the_step_error() -> None:
    exact = {f"n{n}": along_x(0.0, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    refinement = with_strict_steps({1: 0.0, 2: 1e-6, 4: 0.0}, **{**exact, "n4": along_x(0.0, 0.2)})
    before = refinement.limit
    refinement.runner = cast("ModelRunner", Strict({2: exact["n2"], 4: along_x(0.0, np.nan)}))
    assert refinement.remove_step_errors() == pytest.approx([0.0, Thresholds.scatter * 1e-6])
    assert refinement.limit is before


# horizons


@pytest.mark.parametrize(
    ("off", "known", "holds"),
    [
        ([0.0, 0.2, 0.4, 0.6, 0.8], [0.0] * 5, 0.04),  # the tolerance is met to the end
        ([0.0, 0.2, 0.4, 2.0, 0.1], [0.0] * 5, 0.02),  # the last sample before the tolerance is exceeded
        ([0.0, 0.2, 0.4, 0.6, 0.8], [0.0, 0.0, 0.5, 0.5, 0.5], 0.02),  # the known uncertainty counts as error
        ([0.0, 0.2, 0.4, 0.6, np.nan], [0.0] * 5, 0.03),  # the run ends before the last sample
        ([0.0, 0.2, 0.4, 0.6, 0.8], [2.0] * 5, 0.0),  # the tolerance is exceeded from the start
    ],
)
def test_the_horizon_is_the_last_sample_before_the_tolerance_is_exceeded(
    off: list[float], known: list[float], holds: float
) -> None:
    refinement = study_of_levels(n2=ALLOWED * along_x(*off))
    refinement.limit = Limit(along_x(*[0.0] * 5), np.zeros(5))
    assert horizons.horizon(refinement, NORM, ALLOWED * np.array(known)) == pytest.approx(holds)


# axes


def test_errors_of_all_dropped_axes_are_limited_together() -> None:
    """Dropping the axis of one link causes 0.6 of the error allowed for all dropped axes, so only one is dropped."""
    moved = {("yz", "yz"): 0.0, ("z", "z"): 1.2, ("z", "yz"): 0.6, ("yz", "z"): 0.6}
    links = [SimpleNamespace(name=name) for name in "ab"]

    def run(model: Model, stepping: Stepping) -> Outcome:
        axes = tuple(bend.flex if bend else "rigid" for bend in model)
        return outcome(along_x(0.0, moved[axes] * Thresholds.allowed_share * ALLOWED))

    runner = SimpleNamespace(scene=SimpleNamespace(arm=SimpleNamespace(links=links)), run=run)
    screening = AxisScreening(cast("ModelRunner", runner), NORM, ("yz", "yz"), Stepping("Radau5"), ALLOWED)
    assert screening.axes == ("z", "yz")
    assert ["too much" in trial for trial in screening.trials] == [True, False, True]


# growth


def test_error_growth_is_the_largest_tip_error_over_the_initial_tip_error() -> None:
    """Turning a 4 m arm by an angle moves its tip by 4 m · angle at first, later by up to three times as much."""
    reach, base = 4.0, along_x(0.0, 0.1, 0.2, 0.3)
    finest = outcome(base)._replace(stepping=Stepping("Radau5", tolerance=1e-9))

    def perturbed_run(model: Model, stepping: Stepping, angle: float) -> Outcome:
        return outcome(base + angle * reach * along_x(1.0, 2.0, 3.0, 2.0))

    runner = SimpleNamespace(chain=lambda _: SimpleNamespace(size=reach), perturbed_run=perturbed_run)
    refinement = SimpleNamespace(finest=SimpleNamespace(outcome=finest), model=(None,), travel=1.0)
    factor, e_fold = horizons.growth(cast("ModelRunner", runner), cast("RefinementStudy", refinement), ALLOWED)
    assert factor == pytest.approx(3.0)
    assert e_fold == np.inf


def test_the_time_constant_of_exponential_error_growth_is_found() -> None:
    t = 0.01 * np.arange(101)
    finest = outcome(along_x(*t))._replace(stepping=Stepping("Radau5", tolerance=1e-9))
    off = np.exp(t / 0.2)[:, None] * [0.0, 1.0, 0.0]
    runner = SimpleNamespace(
        chain=lambda _: SimpleNamespace(size=1.0),
        perturbed_run=lambda model, stepping, angle: outcome(finest.tip + angle * off),
    )
    refinement = SimpleNamespace(finest=SimpleNamespace(outcome=finest), model=(None,), travel=1.0)
    factor, e_fold = horizons.growth(cast("ModelRunner", runner), cast("RefinementStudy", refinement), ALLOWED)
    assert (factor, e_fold) == pytest.approx((np.exp(5.0), 0.2))


# deflections and budgets


def test_the_rigid_link_estimate_gives_the_sag_of_a_cantilever_beam() -> None:
    """The tip of a steel rod, 1 m by 1 cm, sags by −ρ A g L⁴ / 8 E I; two hinges reproduce this sag to within a tenth.

    Its vibration in 0.02 s, a sixth of a period, is smaller than the sag. The estimate is 2.5 times the sag.
    """
    bar = fl.Link(name="bar", length=1.0, material="steel", section="square")
    steel, square = fl.Material(young=210e9, density=7850.0), fl.Section(shape="rectangle", height=0.01, width=0.01)
    still = fl.PrescribedMotion(link="bar", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
    scene = fl.Scene(
        name="bar", arm=fl.Arm(links=(bar,), materials={"steel": steel}, sections={"square": square}),
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(0.0,)), motion=(still,),
        run=fl.RunSettings(duration=0.02, sample=0.01, step=0.01),
    )  # fmt: skip
    runner, seen = ModelRunner(scene, 1.0), []

    def norm(difference: Array) -> float:
        seen.append(difference)
        return 0.0

    strict = runner.run((None,), Stepping("RK4", step=0.01))
    rigid.estimate(runner, strict, ("z",), cast("TipErrorNorm", norm))
    beam = -7850.0 * 1e-4 * 9.81 / (8 * 210e9 * 1e-8 / 12)
    assert seen[0][:, 1] == pytest.approx(beam, rel=0.1)
    error, hertz = rigid.estimate(runner, strict, ("z",), NORM)
    assert error == pytest.approx(2.5 * abs(beam), rel=0.1)
    assert hertz == pytest.approx(3.516 / (2 * np.pi) * np.sqrt(210e9 * 1e-8 / 12 / (7850.0 * 1e-4)), rel=0.1)


def test_a_run_ends_when_its_time_budget_is_used_up() -> None:
    """The budget is a tenth of the measured time of the whole run."""
    scene, model, steps = bars().varied({"run.duration": 2.0}), (None, None), Stepping("RK4", step=1e-3)
    whole = ModelRunner(scene, 60.0).run(model, steps)
    assert whole.completed
    short = ModelRunner(scene, 0.1 * whole.seconds).run(model, steps)
    assert short.over_budget
    reviewed("advice: over budget", short.reason, values=False)
