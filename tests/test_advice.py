"""Pieces of advice, each by itself: what steps do, which models are thought of, how far a limit is known."""

from __future__ import annotations

import itertools
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
from tests.words import reviewed

Array = NDArray[np.float64]
Errors = Callable[[float], float]
NORM = TipErrorNorm(Goal(1e-3), 0.01)
ALLOWED = 1e-3  # at the tip [m]


def along_x(*x: float) -> Array:
    """A path of the tip that stays on the x axis."""
    return np.array(x)[:, None] * [1.0, 0.0, 0.0]


def outcome(tip: Array, evaluations: int = 100, why: str = "") -> Outcome:
    """A run as far as it is looked at."""
    run = SimpleNamespace(steps=SimpleNamespace(evaluations=evaluations), t=0.01 * np.arange(len(tip)))
    return Outcome(tip, 1e-6 * evaluations, cast("Any", run), Stepping("Radau5"), why)


# models


class Beams:
    """Links with known errors: C_k / N², rigid 20 C_k, and an additional error if axes are missing."""

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
    """Number of hinges of all links, one for each axis."""
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
def test_hinges_are_the_fewest_of_which_the_error_is_allowed(constants: tuple[float, ...], allowed: float) -> None:
    beams = Beams(*constants)
    model = allocation(beams).cheapest(allowed)
    assert model is not None
    assert beams.error(model) <= allowed
    assert hinges_of(model) <= cheapest_of_all(beams, allowed) + 1


def test_hinges_of_many_are_as_the_cube_root_of_the_errors() -> None:
    model = allocation(Beams(1.0, 8.0)).cheapest(0.02)
    assert model is not None
    first, second = (bend.hinges for bend in model if bend)
    assert second / first == pytest.approx(2.0, rel=0.1)


def test_a_link_is_rigid_and_axes_are_left_out_where_their_errors_are_allowed() -> None:
    assert allocation(Beams(1.0, 1e-6)).cheapest(1.1e-2) == (by_rule("z", 10), None)
    less = {(0, "z"): 2e-3, (0, "yz"): 1e-3}
    spatial = Beams(1e-2, axes=("xyz",), less=less)
    assert allocation(spatial).cheapest(5e-3) == (by_rule("z", 2),)
    assert allocation(spatial).cheapest(2.2e-3) == (by_rule("yz", 3),)


def test_hinges_about_two_axes_cost_twice() -> None:
    """Of links alike, of which one bends about two axes: N ∝ (1/2)^(1/3) there."""
    model = allocation(Beams(10.0, 10.0, axes=("z", "yz"))).cheapest(0.1)
    assert model is not None
    first, second = (bend.hinges for bend in model if bend)
    assert second / first == pytest.approx(0.5 ** (1 / 3), rel=0.05)


def test_predictions_are_corrected_by_a_model_that_was_run() -> None:
    beams, allowed = Beams(1.0, 1.0), 1e-2
    models = allocation(beams)
    first = models.cheapest(allowed)
    assert first is not None
    models.learn(first, 2 * beams.error(first))
    second = models.cheapest(allowed)
    assert second is not None
    assert np.sqrt(2) * beams.error(second) <= allowed
    assert hinges_of(second) == pytest.approx(2**0.25 * hinges_of(first), rel=0.1)
    beams.known[first] = 1.1 * allowed  # whatever is predicted
    assert allocation(beams).cheapest(allowed) != first


def test_no_model_has_an_error_that_no_convergence_was_seen_for() -> None:
    beams = Beams(1.0, 1.0)
    assert allocation(beams).cheapest(1e-5) is None
    assert allocation(Beams(1.0, np.inf)).cheapest(1e-2) is None  # a run failed


def bars(*, skew: float = 0.0) -> Scene:
    """Two soft bars that fall, the joint of the second one turned out of the plane [deg]."""
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


def test_errors_of_links_that_are_measured_add_up_to_those_of_models(measured: tuple[ModelRunner, LinkErrors]) -> None:
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


def test_fewer_axes_have_the_error_that_they_are_measured_with(measured: tuple[ModelRunner, LinkErrors]) -> None:
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
    """A runner of one link whose runs are known, by the factor of their tolerance over the allowed error.

    The error is C / N² and that of the steps, `of_steps` over the allowed one; the cost is N times `evaluations`. Fixed
    steps, of factor 0, have no error and the cost `fixed` [s].
    """

    def __init__(self, of_steps: Errors, evaluations: Errors, fixed: float) -> None:
        self.beams, self.of_steps, self.evaluations, self.fixed = Beams(14.4 * ALLOWED), of_steps, evaluations, fixed
        links = [SimpleNamespace(joint=SimpleNamespace(locked=False))]
        self.scene = SimpleNamespace(arm=SimpleNamespace(links=links), run=SimpleNamespace(sample=0.01))
        self.budget, self.asked = 1.0, set[float]()

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        factor = (stepping.tolerance or 0.0) / ALLOWED
        self.asked.add(factor)
        error = self.beams.error(model) + self.of_steps(factor) * ALLOWED
        cost = hinges_of(model) * self.evaluations(factor) if factor else self.fixed
        return outcome(along_x(0.0, error))._replace(stepping=stepping, seconds=cost)

    def evaluation_cost(self, model: Model, *, explicit: bool) -> float:
        return hinges_of(model)

    def estimated_step(self, k: int, bend: Bend) -> float:
        return 1e-3

    def stable_step(self, model: Model) -> float:
        return 1e-3

    def fixed_steps(self, largest: float) -> Stepping | None:
        return Stepping("RK4", step=largest)

    def fixed_steps_cost(self, model: Model, stepping: Stepping) -> float:
        return self.fixed


def searched(of_steps: Errors, evaluations: Errors, fixed: float = 9.0) -> tuple[Oracle, int, float]:
    """The oracle, and hinges and factor of the solution."""
    oracle = Oracle(of_steps, evaluations, fixed)
    best = Search(cast("ModelRunner", oracle), cast("LinkErrors", oracle.beams), ALLOWED).best()
    assert best is not None
    assert best.error <= ALLOWED
    return oracle, hinges_of(best.model), round((best.outcome.stepping.tolerance or 0.0) / ALLOWED, 9)


def test_tolerances_are_loosened_while_the_error_is_allowed() -> None:
    """Four hinges leave a tenth to the steps."""
    oracle, hinges, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 * x**-0.25)
    assert (hinges, factor) == (4, 8.0)
    assert {1.0, 2.0, 4.0, 8.0, 16.0} == oracle.asked


def test_a_finer_model_is_taken_where_the_looser_steps_that_it_allows_save_more() -> None:
    _, hinges, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 / x)
    assert (hinges, factor) == (5, 32.0)


def test_of_all_tolerances_the_cheapest_is_taken() -> None:
    _, hinges, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 * max(1 / x, x / 16))
    assert (hinges, factor) == (4, 4.0)


def test_steps_whose_error_is_not_allowed_are_made_stricter() -> None:
    _, hinges, factor = searched(lambda x: 2.0 * x, lambda x: 0.1 * x**-0.25)
    assert (hinges, factor) == (6, 0.25)


@pytest.mark.parametrize(("fixed", "taken"), [(0.01, True), (9.0, False)])
def test_fixed_steps_are_taken_where_they_promise_to_be_cheaper(fixed: float, taken: bool) -> None:
    oracle, _, factor = searched(lambda x: 0.01 * x, lambda x: 0.1 * x**-0.25, fixed)
    assert (0.0 in oracle.asked) == taken
    assert (factor == 0.0) == taken


# limits


def study_of_levels(family: str = "gauss", **paths: Array) -> RefinementStudy:
    """A refinement whose levels, named n1, n2 …, have these paths of the tip."""
    refinement = RefinementStudy(cast("ModelRunner", None), NORM, Goal(1e-3, metres=True), ("z",), Stepping("Radau5"))
    refinement.tolerance = 1e-3
    for name, path in paths.items():
        refinement.levels[family].append(Level(int(name[1:]), outcome(path)))
        if len(refinement.levels[family]) > 1:
            refinement.limit = refinement._estimate(family)
    return refinement


def test_levels_of_the_second_order_have_the_limit_that_they_have() -> None:
    paths = {f"n{n}": along_x(0.0, 0.1 + 1e-3 / n**2, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    limit = study_of_levels(**paths).limit
    assert limit is not None
    assert limit.tip == pytest.approx(along_x(0.0, 0.1, 0.2), abs=1e-15)


def test_levels_of_cells_have_the_limit_of_the_fourth_order() -> None:
    paths = {f"n{n}": along_x(0.0, 0.1 + 1e-3 / n**4, 0.2 + 4e-3 / n**4) for n in (4, 8, 12)}
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
def test_a_family_has_a_rule_for_each_of_its_numbers_of_hinges(
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


def test_two_limits_that_agree_by_chance_are_believed_no_better_than_a_fast_order_allows() -> None:
    first = {"n1": along_x(0.0, 0.03, 0.03), "n2": along_x(0.0, 0.02, 0.02), "n4": along_x(0.0, 0.012, 0.01)}
    before = study_of_levels(**first).limit
    assert before is not None
    chance = first["n4"] + (before.tip - first["n4"]) * (1 - (4 / 6) ** 2)  # whose limit with n4 is the one before
    limit = study_of_levels(**first, n6=chance).limit
    assert limit is not None
    assert limit.tip == pytest.approx(before.tip)
    assert limit.errors == pytest.approx(before.errors * (4 / 6) ** (2 + Thresholds.limit_fall))
    assert limit.errors[1] < limit.errors[2]  # of each time by itself


def test_the_error_of_a_limit_follows_from_its_change() -> None:
    paths = {"n1": along_x(0.0, 0.03), "n2": along_x(0.0, 0.02), "n4": along_x(0.0, 0.012)}
    limit = study_of_levels(**paths).limit
    assert limit is not None
    coarse, fine = (b + (b - a) / 3 for a, b in itertools.pairwise((0.03, 0.02, 0.012)))
    assert limit.error == pytest.approx(abs(fine - coarse) / FAMILIES["gauss"].safe)


def test_a_bend_that_is_let_go_goes_to_the_joint_and_the_rest_of_it_swings() -> None:
    """A bar with a heavy load sags by m g L³ / 3EI while it is held; let go, its load stays, and the joint turns."""
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
    """A runner whose runs with stricter steps are known, by the hinges of the link."""

    def __init__(self, paths: dict[int, Array]) -> None:
        self.paths = paths

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        assert stepping.tolerance == pytest.approx(1e-5)  # a tenth
        assert model[0] is not None
        return outcome(self.paths[model[0].hinges])


def with_strict_steps(off: dict[int, float], **strict: Array) -> RefinementStudy:
    """A refinement whose levels have these step errors in x at the last sample, and stricter runs."""
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
    assert left == pytest.approx([0.0, 0.1**0.5 * (off[2] + 4 * -off[4]) / 3])  # x* = (4 x₄ − x₂) / 3


def test_without_stricter_steps_at_the_last_level_a_coarser_one_counts_with_a_margin() -> None:
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
        ([0.0, 0.2, 0.4, 0.6, 0.8], [0.0] * 5, 0.04),  # to the end
        ([0.0, 0.2, 0.4, 2.0, 0.1], [0.0] * 5, 0.02),  # the last sample before it does not
        ([0.0, 0.2, 0.4, 0.6, 0.8], [0.0, 0.0, 0.5, 0.5, 0.5], 0.02),  # what is not known counts
        ([0.0, 0.2, 0.4, 0.6, np.nan], [0.0] * 5, 0.03),  # beyond the end of a run nothing holds
        ([0.0, 0.2, 0.4, 0.6, 0.8], [2.0] * 5, 0.0),  # not even the start: no time before it
    ],
)
def test_a_tolerance_holds_up_to_the_last_sample_before_it_is_exceeded(
    off: list[float], known: list[float], holds: float
) -> None:
    refinement = study_of_levels(n2=ALLOWED * along_x(*off))
    refinement.limit = Limit(along_x(*[0.0] * 5), np.zeros(5))
    assert horizons.horizon(refinement, NORM, ALLOWED * np.array(known)) == pytest.approx(holds)


# axes


def test_axes_that_are_left_out_count_together() -> None:
    """Two links, each of which may lose an axis by itself, 0.6 of what all may do together; the first one does."""
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


def test_the_growth_of_an_error_is_how_much_farther_the_tip_is_off_than_the_start_was() -> None:
    """An arm of 4 m, turned by an angle: 4 m · angle off at first, three times as much in the end."""
    reach, base = 4.0, along_x(0.0, 0.1, 0.2, 0.3)
    finest = outcome(base)._replace(stepping=Stepping("Radau5", tolerance=1e-9))

    def perturbed_run(model: Model, stepping: Stepping, angle: float) -> Outcome:
        return outcome(base + angle * reach * along_x(1.0, 2.0, 3.0, 2.0))

    runner = SimpleNamespace(chain=lambda _: SimpleNamespace(size=reach), perturbed_run=perturbed_run)
    refinement = SimpleNamespace(finest=SimpleNamespace(outcome=finest), model=(None,), travel=1.0)
    factor, e_fold = horizons.growth(cast("ModelRunner", runner), cast("RefinementStudy", refinement), ALLOWED)
    assert factor == pytest.approx(3.0)
    assert e_fold == np.inf


def test_an_exponentially_growing_error_has_its_time_constant() -> None:
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


def test_a_rod_that_is_held_bends_by_its_weight_downwards_as_a_beam_does() -> None:
    """−ρ A g L⁴ / 8 E I at the tip of 1 m of steel, 1 cm thick: two hinges are off by less than a tenth.

    It does not swing as far in 0.02 s, a sixth of a period. The estimate is 2.5 times the largest of the two.
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


def test_a_run_ends_where_it_has_used_up_its_budget() -> None:
    """A tenth of what the whole run takes."""
    scene, model, steps = bars().varied({"run.duration": 2.0}), (None, None), Stepping("RK4", step=1e-3)
    whole = ModelRunner(scene, 60.0).run(model, steps)
    assert whole.completed
    short = ModelRunner(scene, 0.1 * whole.seconds).run(model, steps)
    assert short.over_budget
    reviewed("advice: over budget", short.reason, values=False)
