"""Pieces of advice, each by itself: what steps do, which models are thought of, how far a limit is known."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

import flexlink as fl
from flexlink.advice import horizon as horizons
from flexlink.advice import rigid
from flexlink.advice.axes import ALLOWED_SHARE, AxisScreening
from flexlink.advice.candidates import HOPELESS_ERROR, MAX_MODELS, Candidates
from flexlink.advice.goal import Goal, TipErrorNorm, goal_of
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Axes, Model, uniform
from flexlink.advice.model_runner import STABLE_SHARE, ModelRunner, Outcome, Stepping
from flexlink.advice.refinement import LIMIT_FALL, SAFE_LIMIT, SCATTER, Level, RefinementStudy
from flexlink.advice.release import release
from flexlink.advice.step_options import (
    EXTRAPOLATED_TOLERANCE,
    PROMISING_ERROR,
    STEPS_EXPONENT,
    MeasuredSteps,
    fixed_step_options,
    step_options,
)
from flexlink.describe.scene import Scene
from flexlink.results.convergence import Limit

Array = NDArray[np.float64]
NORM = TipErrorNorm(Goal(1e-3), 0.01)
ALLOWED = 1e-3  # at the tip [m]


def along_x(*x: float) -> Array:
    """A path of the tip that stays on the x axis."""
    return np.array(x)[:, None] * [1.0, 0.0, 0.0]


def outcome(tip: Array, evaluations: int = 100, why: str = "") -> Outcome:
    """A run as far as it is looked at."""
    run = SimpleNamespace(steps=SimpleNamespace(evaluations=evaluations), t=0.01 * np.arange(len(tip)))
    return Outcome(tip, 1e-6 * evaluations, cast("Any", run), Stepping("Radau5"), why)


# steps


class Told(NamedTuple):
    """What a run with a tolerance is found to take and to do to the tip [m]; `why` it ended early."""

    evaluations: int
    size: float
    why: str = ""


class Oracle:
    """A runner whose runs are known beforehand, by tolerance over what is allowed."""

    def __init__(self, told: dict[float, Told]) -> None:
        self.told, self.asked = told, list[float]()

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        assert stepping.tolerance is not None
        factor = round(stepping.tolerance / ALLOWED, 9)
        self.asked.append(factor)
        evaluations, size, why = self.told[factor]
        return outcome(along_x(0.0, size), evaluations, why)


def probed(told: dict[float, Told], largest: float = 10.0) -> tuple[Oracle, MeasuredSteps]:
    oracle = Oracle(told)
    return oracle, MeasuredSteps(cast("ModelRunner", oracle), NORM, (None,), along_x(0.0, 0.0), ALLOWED, largest)


SMOOTH = {1.0: Told(1000, 0.01 * ALLOWED), 10.0: Told(500, 0.1 * ALLOWED), 100.0: Told(250, 1.0 * ALLOWED)}


def test_what_was_measured_of_steps_is_taken_as_it_is() -> None:
    _, probes = probed(SMOOTH)
    for factor, (evaluations, size, _) in SMOOTH.items():
        assert probes.steps["Radau5", factor] == pytest.approx((evaluations, size))


def test_between_tolerances_steps_follow_powers() -> None:
    _, probes = probed(SMOOTH)
    for factor in (2.0, 5.0, 20.0, 50.0):  # a tenth of the tolerance: twice the evaluations, a tenth of the error
        expected = 1000 * factor ** -np.log10(2), 0.01 * ALLOWED * factor
        assert probes.steps["Radau5", factor] == pytest.approx(expected)


def test_beyond_the_tolerances_that_were_measured_steps_follow_the_orders_of_the_method() -> None:
    _, probes = probed(SMOOTH)
    assert probes.steps["Radau5", 0.1] == pytest.approx((1000 * 0.1**-STEPS_EXPONENT, 0.1 * 0.01 * ALLOWED))


@pytest.mark.parametrize(
    ("told", "largest", "asked", "cheapest_run"),
    [
        (SMOOTH, 10.0, [1.0, 10.0, 100.0], 100.0),
        ({**SMOOTH, 10.0: Told(500, 2 * PROMISING_ERROR * ALLOWED)}, 10.0, [1.0, 10.0], 20.0),  # do too much to the tip
        ({**SMOOTH, 10.0: Told(1000, 0.1 * ALLOWED)}, 10.0, [1.0, 10.0], 2.0),  # are not fewer
        (SMOOTH, 50 * ALLOWED, [1.0, 10.0], 20.0),  # a tolerance beyond the motion makes no sense
        ({**SMOOTH, 10.0: Told(0, 0.0, "diverged")}, 10.0, [1.0, 10.0, 100.0], 100.0),
    ],
)
def test_tolerances_are_tried_upwards_while_that_pays(
    told: dict[float, Told], largest: float, asked: list[float], cheapest_run: float
) -> None:
    oracle, probes = probed(told, largest)
    assert oracle.asked == asked
    assert max(factor for _, factor in probes.steps) == cheapest_run <= EXTRAPOLATED_TOLERANCE * max(asked)


def test_of_steps_that_all_fail_nothing_is_thought() -> None:
    _, probes = probed(dict.fromkeys(SMOOTH, Told(0, 0.0, "diverged")))
    assert probes.steps == {}
    assert probes.runs == []


def test_ways_are_data_that_name_methods_and_probe_tolerances_that_they_have() -> None:
    for option in step_options():
        assert bool(option.of_stable) != bool(option.tolerances)
        assert {*option.probed} <= {*option.tolerances}
        assert list(option.probed) == sorted(option.probed)
    assert fixed_step_options() == sorted(fixed_step_options(), key=lambda way: -way[1])


# models


class Study(NamedTuple):
    """A scene with what was measured of it."""

    runner: ModelRunner
    link_errors: LinkErrors
    candidates: Candidates


def bars(*, skew: float = 0.0) -> Scene:
    """Two soft bars that fall, the joint of the second one turned out of the plane [deg]."""
    links = tuple(
        fl.Link(
            name=f"bar{k}", length=1.0, material="steel", section="square", mount=fl.Mount(rpy_deg=(k * skew, 0, 0))
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


def study(scene: Scene, axes: Axes, tip: float = 1e-3) -> Study:
    runner, goal = ModelRunner(scene, 1.0), goal_of(tip, deflection=False, band=None, run=scene.run)
    refinement = RefinementStudy(runner, NORM, goal, axes, Stepping("Radau5", tolerance=1e-4))
    refinement.refine()
    link_errors = LinkErrors(runner, NORM, refinement, refinement.stepping)
    base = uniform(axes, link_errors.base)
    path = runner.run(base, refinement.stepping).tip
    allowed = refinement.tolerance
    steps = MeasuredSteps(runner, NORM, base, path, allowed, refinement.travel)
    return Study(runner, link_errors, Candidates(runner, link_errors, steps, allowed))


@pytest.fixture(scope="module")
def plane() -> Study:
    return study(bars(), ("z", "z"))


@pytest.fixture(scope="module")
def space() -> Study:
    return study(bars(skew=60.0), ("yz", "yz"))


@pytest.fixture(scope="module")
def turned() -> Study:
    """About one axis each, but not in a plane."""
    return study(bars(skew=60.0), ("z", "z"))


@pytest.fixture(params=["plane", "space", "turned"])
def found(request: pytest.FixtureRequest) -> Study:
    return cast("Study", request.getfixturevalue(request.param))


def test_the_error_of_a_model_that_was_run_is_the_measured_one(found: Study) -> None:
    _, link_errors, candidates = found
    for level, run in link_errors.refinement.models().items():
        assert candidates.space[candidates.models.index(level)] == NORM(run.tip - link_errors.limit)


def test_the_errors_of_links_add_up_with_their_signs(found: Study) -> None:
    _, link_errors, candidates = found
    others = [row for row, model in enumerate(candidates.models) if model not in link_errors.known]
    assert others
    for row in others:
        paths = [link_errors.errors[k, bend] for k, bend in enumerate(candidates.models[row])]
        assert candidates.space[row] == pytest.approx(NORM(sum(paths)))


def test_by_a_tolerance_models_with_the_same_axes_take_as_many_evaluations_each_at_its_own_price(found: Study) -> None:
    runner, link_errors, candidates = found
    alike = np.flatnonzero(
        candidates.same_axes(candidates.models.index(uniform(link_errors.refinement.axes, link_errors.base)))
    )
    assert len(alike) > 5
    for column, choice in enumerate(candidates.step_choices):
        if not choice.fixed:
            for row in alike:
                one = runner.evaluation_cost(candidates.models[row], explicit=False)
                assert candidates.costs[row, column] == pytest.approx(choice.evaluations * one)


def test_fixed_steps_are_those_that_the_stiffest_link_needs(found: Study) -> None:
    runner, _, candidates = found
    fixed = [(column, choice) for column, choice in enumerate(candidates.step_choices) if choice.fixed]
    assert len(fixed) == len(fixed_step_options())
    for (column, choice), (row, model) in itertools.product(fixed, enumerate(candidates.models)):
        if any(bend and bend.hinges > 4 for bend in model):
            continue  # are told from those with fewer
        own = [runner.estimated_step(k, bend) for k, bend in enumerate(model) if bend]
        stepping = runner.fixed_steps(choice.factor * (STABLE_SHARE * min(own) if own else runner.scene.run.sample))
        assert stepping is not None
        assert candidates.costs[row, column] == pytest.approx(runner.fixed_steps_cost(model, stepping))


def test_models_that_bend_alike_are_told_from_others() -> None:
    candidates = study(bars(), ("z", "z"), 1e-2).candidates
    rigid = candidates.models.index((None, None))
    assert np.flatnonzero(candidates.same_axes(rigid)).tolist() == [rigid]


def test_what_is_thought_of_for_a_link_is_not_hopeless(found: Study) -> None:
    _, link_errors, candidates = found
    assert 1 < len(candidates.models) <= MAX_MODELS + len(link_errors.known)
    for model in set(candidates.models) - set(link_errors.known):
        for k, bend in enumerate(model):
            assert NORM(link_errors.errors[k, bend]) <= HOPELESS_ERROR * candidates.allowed


def test_no_choice_for_a_link_is_worse_and_dearer_by_either_kind_of_steps_than_another(found: Study) -> None:
    _, link_errors, candidates = found
    for k in range(2):
        bends = {bend for model in set(candidates.models) - set(link_errors.known) if (bend := model[k])}
        implicit = {bend: len(bend.flex) * bend.hinges for bend in bends}
        explicit = {bend: implicit[bend] / candidates._step(k, bend) for bend in bends}
        for a, b in itertools.permutations(bends, 2):
            dearer = implicit[a] >= implicit[b] and explicit[a] >= explicit[b]
            assert not (dearer and NORM(link_errors.errors[k, b]) < 0.98 * NORM(link_errors.errors[k, a])), (a, b)


# limits


def study_of_levels(**paths: Array) -> RefinementStudy:
    """A refinement whose levels, named n1, n2 …, have these paths of the tip."""
    refinement = RefinementStudy(cast("ModelRunner", None), NORM, Goal(1e-3, metres=True), ("z",), Stepping("Radau5"))
    refinement.tolerance = 1e-3
    for name, path in paths.items():
        refinement.levels["gauss"].append(Level(int(name[1:]), outcome(path)))
        if len(refinement.levels["gauss"]) > 1:
            refinement.limit = refinement._estimate("gauss")
    return refinement


def test_levels_of_the_second_order_have_the_limit_that_they_have() -> None:
    paths = {f"n{n}": along_x(0.0, 0.1 + 1e-3 / n**2, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    limit = study_of_levels(**paths).limit
    assert limit is not None
    assert limit.tip == pytest.approx(along_x(0.0, 0.1, 0.2), abs=1e-15)


def test_two_limits_that_agree_by_chance_are_believed_no_better_than_a_fast_order_allows() -> None:
    first = {"n1": along_x(0.0, 0.03, 0.03), "n2": along_x(0.0, 0.02, 0.02), "n4": along_x(0.0, 0.012, 0.01)}
    before = study_of_levels(**first).limit
    assert before is not None
    chance = first["n4"] + (before.tip - first["n4"]) * (1 - (4 / 6) ** 2)  # whose limit with n4 is the one before
    limit = study_of_levels(**first, n6=chance).limit
    assert limit is not None
    assert limit.tip == pytest.approx(before.tip)
    assert limit.errors == pytest.approx(before.errors * (4 / 6) ** LIMIT_FALL)
    assert limit.errors[1] < limit.errors[2]  # of each time by itself


def test_the_error_of_a_limit_is_told_by_its_change() -> None:
    paths = {"n1": along_x(0.0, 0.03), "n2": along_x(0.0, 0.02), "n4": along_x(0.0, 0.012)}
    limit = study_of_levels(**paths).limit
    assert limit is not None
    coarse, fine = (b + (b - a) / 3 for a, b in itertools.pairwise((0.03, 0.02, 0.012)))
    assert limit.error == pytest.approx(abs(fine - coarse) / SAFE_LIMIT["gauss"])


def test_a_bend_that_is_let_go_goes_to_the_joint_and_the_rest_of_it_swings() -> None:
    """A bar with a heavy load sags by m g L³ / 3EI while it is held; let go, its load stays, and the joint turns."""
    load, two = 1000.0, bars()
    arm = replace(two.arm, links=two.arm.links[:1], tip=fl.RigidBody(mass=load))
    initial = fl.InitialState(joint_deg=(0.0,), passive="static")
    scene = replace(two, arm=arm, gravity=(0.0, -0.001, 0.0), initial=initial)
    runner, model = ModelRunner(scene, 1.0), uniform(("z",), 2)
    strict = runner.run((None,), Stepping("Radau5", tolerance=1e-9))
    found = release(runner, strict, model, np.zeros(runner.chain(model).n))
    sag = load * 0.001 / (3 * 210e9 * 0.006**4 / 12)
    assert found.start == pytest.approx([0.0, -sag, 0.0], abs=0.01 * sag)
    assert found.drift[0] == pytest.approx([0.0, -sag, 0.0], abs=0.01 * sag)
    straight = ModelRunner(replace(scene, initial=fl.InitialState(joint_deg=(0.0,))), 1.0)
    assert not release(straight, strict, model, np.zeros(3)).drift.any()


class Strict:
    """A runner whose runs with stricter steps are known, by the hinges of the link."""

    def __init__(self, paths: dict[int, Array]) -> None:
        self.paths = paths

    def run(self, model: Model, stepping: Stepping) -> Outcome:
        assert stepping.tolerance == pytest.approx(1e-5)  # a tenth
        assert model[0] is not None
        return outcome(self.paths[model[0].hinges])


def with_strict_steps(off: dict[int, float], **strict: Array) -> RefinementStudy:
    """A refinement of levels, their steps off by so much in x at the last sample, beside stricter ones."""
    refinement = study_of_levels(**{f"n{n}": strict[f"n{n}"] + along_x(0.0, x) for n, x in off.items()})
    refinement.stepping = Stepping("Radau5", tolerance=1e-4)
    refinement.runner = cast("ModelRunner", Strict({int(name[1:]): path for name, path in strict.items()}))
    return refinement


def test_what_steps_do_at_the_levels_of_a_limit_is_taken_out_of_it() -> None:
    exact = {f"n{n}": along_x(0.0, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    off = {1: 0.0, 2: 1e-6, 4: -7e-6}
    refinement = with_strict_steps(off, **exact)
    left = refinement.remove_step_errors()
    assert refinement.limit is not None
    assert refinement.limit.tip == pytest.approx(along_x(0.0, 0.2), abs=1e-15)
    assert left == pytest.approx([0.0, 0.1**0.5 * (off[2] + 4 * -off[4]) / 3])  # x* = (4 x₄ − x₂) / 3


def test_where_no_stricter_steps_can_be_taken_at_the_last_level_a_coarser_one_tells_with_room() -> None:
    exact = {f"n{n}": along_x(0.0, 0.2 + 4e-3 / n**2) for n in (1, 2, 4)}
    refinement = with_strict_steps({1: 0.0, 2: 1e-6, 4: 0.0}, **{**exact, "n4": along_x(0.0, 0.2)})
    before = refinement.limit
    refinement.runner = cast("ModelRunner", Strict({2: exact["n2"], 4: along_x(0.0, np.nan)}))
    assert refinement.remove_step_errors() == pytest.approx([0.0, SCATTER * 1e-6])
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
        return outcome(along_x(0.0, moved[axes] * ALLOWED_SHARE * ALLOWED))

    runner = SimpleNamespace(scene=SimpleNamespace(arm=SimpleNamespace(links=links)), run=run)
    screening = AxisScreening(cast("ModelRunner", runner), NORM, ("yz", "yz"), Stepping("Radau5"), ALLOWED)
    assert screening.axes == ("z", "yz")
    assert [trial.kept for trial in screening.trials] == [True, False, True]


# growth


def test_the_growth_of_an_error_is_how_much_farther_the_tip_is_off_than_the_start_was() -> None:
    """An arm of 4 m, turned by an angle: 4 m · angle off at first, three times as much in the end."""
    reach, base = 4.0, along_x(0.0, 0.1, 0.2, 0.3)
    finest = outcome(base)._replace(stepping=Stepping("Radau5", tolerance=1e-9))

    def perturbed_run(model: Model, stepping: Stepping, angle: float) -> Outcome:
        return outcome(base + angle * reach * along_x(1.0, 2.0, 3.0, 2.0))

    runner = SimpleNamespace(chain=lambda _: SimpleNamespace(reach=reach), perturbed_run=perturbed_run)
    refinement = SimpleNamespace(finest=SimpleNamespace(outcome=finest), model=(None,), travel=1.0)
    found = horizons.growth(cast("ModelRunner", runner), cast("RefinementStudy", refinement), ALLOWED)
    assert found.factor == pytest.approx(3.0)
    assert found.e_fold == np.inf


# deflections and budgets


def test_a_rod_that_is_held_bends_by_its_weight_downwards_as_a_beam_does() -> None:
    """−ρ A g L⁴ / 8 E I at the tip of 1 m of steel, 1 cm thick: two hinges are off by less than a tenth."""
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


def test_a_run_ends_where_it_has_used_up_its_budget() -> None:
    """A tenth of what the whole run takes."""
    scene, model, steps = bars().varied({"run.duration": 2.0}), (None, None), Stepping("RK4", step=1e-3)
    whole = ModelRunner(scene, 60.0).run(model, steps)
    assert whole.completed
    short = ModelRunner(scene, 0.1 * whole.seconds).run(model, steps)
    assert short.over_budget
    assert "the budget of" in short.reason
