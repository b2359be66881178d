"""Error limits that advice reports as met are really met, for arms with closed-form tip paths."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest

import flexlink as fl
from flexlink.advice import advise as advising
from flexlink.advice import refinement as refining
from flexlink.advice import rigid
from flexlink.advice.advise import Advisor
from flexlink.advice.goal import TipErrorNorm, goal_of
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Bend, Model, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.refinement import RefinementStudy
from flexlink.advice.search import Search
from flexlink.advice.straightness import load_and_bend, may_pay
from flexlink.advice.verdict import Advice
from flexlink.results.convergence import Limit
from tests.advice.test_advice import along_x, study_of_levels
from tests.conftest import make_scene

Array = np.ndarray
T = np.linspace(0.0, 1.0, 21)
PATH = np.column_stack([np.sin(2 * T), 1 - np.cos(2 * T), 0 * T])  # converged tip path [m]
WAYS = [T[:, None] * [1.0, 0.0, 0.0], (T**2)[:, None] * [0.6, 0.8, 0.0]]  # direction of each link's error over time


class World(NamedTuple):
    """Tip errors: C_k (1/N² − fourth/N⁴) for N hinges in link k, `aside` per dropped axis, `steps` · tolerance."""

    constants: tuple[float, ...] = (1e-2, 4e-2)
    fourth: float = 0.0
    aside: float = 0.0
    steps: float = 0.1
    estimated: float = np.inf  # error estimate for rigid links
    grows: float = 1.0
    fails: tuple[int, ...] = ()  # hinge counts with which runs fail

    def tip(self, model: Model, stepping: Stepping) -> Array:
        off = (stepping.tolerance or 0.0) * self.steps * T[:, None] * [0.0, 0.0, 1.0]
        for C, way, bend in zip(self.constants, WAYS, model, strict=False):
            N = bend.hinges if bend else 0.3
            off = off + C * (N**-2.0 - self.fourth * N**-4.0) * way
            if bend is None or bend.flex == "z":
                off = off + self.aside * T[:, None] * [0.0, 0.0, 1.0]
        return np.asarray(PATH + off)


class KnownRunner(ModelRunner):
    """A runner whose runs cost a microsecond per hinge, and less with a looser step tolerance."""

    def __init__(self, scene: fl.Scene, budget: float, world: World) -> None:
        super().__init__(scene, budget)
        self.world = world

    def _run(self, model: Model, stepping: Stepping, initial: object = None) -> Outcome:
        self.count += 1
        hinges = sum(len(bend.flex) * bend.hinges for bend in model if bend)
        seconds = 1e-6 * (1 + hinges) * ((stepping.tolerance or 1e-3) / 1e-3) ** -0.25
        why = "did not end" if any(bend and bend.hinges in self.world.fails for bend in model) else ""
        over = seconds > self.budget
        tip = np.full_like(PATH, np.nan) if why or over else self.world.tip(model, stepping)
        run = SimpleNamespace(t=T, chain=None, steps="known")
        return Outcome(tip, seconds, cast("Any", run), stepping, why or ("over" if over else ""), over)

    def perturbed_run(self, model: Model, stepping: Stepping, angle: float) -> Outcome:
        found = self.run(model, stepping)
        return found._replace(
            tip=found.tip + angle * self.chain(model).reach * self.world.grows * T[:, None] * [0.0, 1.0, 0.0]
        )

    def sample_postures(self, run: object) -> None:
        """Do nothing: no postures are needed."""

    def evaluation_cost(self, model: Model, *, explicit: bool) -> float:
        return 1e-9 * (1 + sum(len(bend.flex) * bend.hinges for bend in model if bend))

    def fixed_steps(self, largest: float) -> None:
        """Fixed steps are never offered."""

    def stable_step(self, model: Model) -> float:
        return 1e-4

    def estimated_step(self, link: int, bend: Bend) -> float:
        return 1e-4


SCENE = make_scene(
    *(fl.Link(name=name, length=1.0, material="aluminium", section="square") for name in ("upper", "fore")),
    run=fl.RunSettings(duration=1.0, sample=0.05, step=0.05),
)


@pytest.fixture
def advised(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(advising, "deflections", lambda _: 0.05 * T)
    monkeypatch.setattr(refining, "deflections", lambda _: 0.05 * T)
    monkeypatch.setattr(refining, "may_pay", lambda *_: False)
    monkeypatch.setattr(advising, "run_time", lambda _: (0.0, 0.0))

    def found(
        world: World, tip: float | str = 1e-3, budget: float = 1.0, deflection: bool = False
    ) -> tuple[Advice, float]:
        """The advice, and the true tip error of the scene that it returns."""
        goal = goal_of(tip, deflection=deflection, band=None, run=SCENE.run)
        advisor = Advisor(SCENE, goal, budget)
        advisor.runner = KnownRunner(SCENE, budget, world)
        monkeypatch.setattr(rigid, "estimate", lambda *_: (world.estimated, 3.0))
        advice = advisor.advice()
        model = tuple(
            None if link.flex == "rigid" else Bend(link.flex, link.lumping, link.segments - 1)
            for link in advice.scene.arm.links
        )
        run = advice.scene.run
        tip_of = world.tip(model, Stepping(run.method, tolerance=run.tolerance))
        return advice, float(np.linalg.norm(tip_of - PATH, axis=1).max())

    return found


def worlds() -> list[World]:
    """Random models whose second-order term dominates for any hinge count, so that no two levels agree by chance."""
    rng = np.random.default_rng(0)
    return [
        World(
            tuple(10 ** rng.uniform(-4, -1, 2)),
            rng.uniform(-0.5, 0.5),
            float(10 ** rng.uniform(-7, -2)),
            float(rng.uniform(0, 0.5)),
        )
        for _ in range(30)
    ]


TRAVEL = float(np.linalg.norm(PATH - PATH[0], axis=1).max())


def off(tip: Array) -> float:
    return float(np.linalg.norm(tip - PATH, axis=1).max())


@pytest.mark.slow
@pytest.mark.parametrize("tip", [1e-2, 1e-3, 1e-4])
def test_reported_errors_bound_the_true_errors_in_thirty_synthetic_models(advised: Any, tip: float) -> None:
    """The reported error is at least the true one, and a goal counts as met only if this error is within tolerance."""
    met = 0
    for world in worlds():
        advice, true = advised(world, tip)
        assert true <= advice.error * (1 + 1e-9), world
        assert advice.met == (advice.error <= advice.tolerance)
        assert advice.tolerance == pytest.approx(tip * TRAVEL, rel=0.05)
        if advice.converged_tip is not None:
            assert off(advice.converged_tip.tip) <= advice.converged_tip.error * (1 + 1e-9), world
        met += advice.met
    assert met >= 25


def test_dropped_axes_are_included_in_the_uncertainty_of_the_converged_tip(advised: Any) -> None:
    """Dropping one axis per link moves the tip by 0.04 tolerances each; both displacements add to the limit's error."""
    tolerance = 1e-3 * TRAVEL
    advice, true = advised(World(aside=0.04 * tolerance, steps=0.0), 1e-3)
    assert [link.flex for link in advice.scene.arm.links] == ["z", "z"]
    assert off(advice.converged_tip.tip) == pytest.approx(0.08 * tolerance, rel=1e-3)
    assert 0.08 * tolerance <= advice.converged_tip.error * (1 + 1e-9)
    assert true <= advice.error <= tolerance
    parts = next(line for line in advice.lines if line.startswith("error")).split(", including ")
    for text, error in zip(parts, (advice.error, advice.converged_tip.error), strict=True):
        value, unit = re.findall(r"([\d.e-]+) (mm|µm)", text)[0]
        assert float(value) * {"mm": 1e-3, "µm": 1e-6}[unit] == pytest.approx(error, rel=5.01e-3)
    kept = advised(World(aside=2 * tolerance, steps=0.0), 1e-3)[0].scene.arm.links
    assert [link.flex for link in kept] == ["yz", "yz"]


def test_the_uncertainty_of_the_reference_reduces_the_allowed_model_error(
    advised: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed = []
    init = Search.__init__

    def noted(self: Search, runner: Any, link_errors: Any, may: float) -> None:
        allowed.append(may)
        init(self, runner, link_errors, may)

    monkeypatch.setattr(Search, "__init__", noted)
    advice, _ = advised(World(fourth=0.4), 3e-3)
    assert advice.met
    assert advice.converged_tip.error > 0.01 * advice.tolerance
    assert allowed == [pytest.approx(advice.tolerance - advice.converged_tip.error, rel=1e-9)]


@pytest.mark.parametrize(
    ("estimated", "grows", "rigid_links"), [(0.1, 1.0, True), (0.1, 30.0, True), (0.1, 90.0, False), (0.7, 1.0, False)]
)
def test_rigid_links_suffice_if_the_error_with_growth_is_below_half_the_tolerance(
    advised: Any, estimated: float, grows: float, rigid_links: bool
) -> None:
    """A growth above 10 multiplies errors by growth / 10: 0.1 tolerances become 0.3 at 30 and 0.9, too much, at 90."""
    tolerance = 0.01 * TRAVEL
    world = World(estimated=estimated * tolerance, grows=grows, constants=(1e-6, 1e-6), steps=0.5)
    advice, true = advised(world, 0.01)
    assert true <= advice.error <= tolerance
    assert (advice.converged_tip is None) == rigid_links
    if rigid_links:
        assert advice.error == pytest.approx(max(1.0, grows / 10) * estimated * tolerance, rel=0.05)
        assert any(f" {1e3 * estimated * tolerance:.3g} mm" in line for line in advice.lines)


@pytest.mark.parametrize(("steps", "times"), [(1e-4, 100.0), (0.05, 10.0)])
def test_rigid_links_use_the_loosest_allowed_step_tolerance(advised: Any, steps: float, times: float) -> None:
    """Step tolerances of 100 and then 10 times the goal are tried; the step error is `steps` times the tolerance."""
    tolerance = 0.01 * TRAVEL
    world = World(estimated=0.1 * tolerance, constants=(1e-6, 1e-6), steps=steps)
    advice, true = advised(world, 0.01)
    assert advice.scene.run.tolerance == pytest.approx(times * tolerance, rel=1e-3)
    assert true <= advice.error <= tolerance


def test_rigid_links_are_chosen_if_their_error_with_uncertainty_is_small_enough(advised: Any) -> None:
    """The direct estimate for rigid links is infinite, but flexible models show that their error is small."""
    tolerance = 1e-3 * TRAVEL
    advice, true = advised(World(constants=(1e-6, 1e-6), aside=0.04 * tolerance, steps=0.0), 1e-3)
    assert {link.flex for link in advice.scene.arm.links} == {"rigid"}
    assert 0.08 * tolerance <= true <= advice.error <= tolerance


def test_a_goal_relative_to_the_deflection_uses_the_spring_deflection(advised: Any) -> None:
    advice, true = advised(World(), 1e-2, deflection=True)
    assert advice.tolerance == pytest.approx(1e-2 * 0.05)
    assert true <= advice.error <= advice.tolerance


def test_advice_that_misses_its_tolerance_reports_how_long_the_tolerance_is_met(advised: Any) -> None:
    """Runs with more than four hinges fail, so the fourth-order term makes the limit more uncertain than allowed."""
    world = World(fourth=0.5, fails=tuple(range(5, 200)), steps=0.0)
    advice, true = advised(world, 1e-4)
    assert not advice.met
    assert advice.tolerance < advice.error
    assert true <= advice.error
    assert any(line.startswith("cannot") and "did not end" in line for line in advice.lines)
    beyond = T[np.linalg.norm(world.tip(uniform(("z", "z"), 4), Stepping("auto")) - PATH, axis=1) > advice.tolerance][0]
    assert advice.horizon <= beyond
    nearly, _ = advised(world, advice.error / TRAVEL / 1.5)
    assert nearly.error > nearly.tolerance > nearly.error / 2
    assert not nearly.met


# pieces


def study_of(world: World) -> tuple[KnownRunner, TipErrorNorm, RefinementStudy]:
    goal = goal_of("1 mm", deflection=False, band=None, run=SCENE.run)
    runner, norm = KnownRunner(SCENE, 1.0, world), TipErrorNorm(goal, 0.05)
    return runner, norm, RefinementStudy(runner, norm, goal, ("z", "rigid"), Stepping("auto", tolerance=1e-6))


def test_link_errors_are_exact_even_if_they_change_sign_between_models(advised: Any) -> None:
    """The link error 1/N² − 8/N⁴ is positive for four hinges and negative for two or one; its magnitude is reported."""
    runner, norm, study = study_of(World(fourth=8.0, steps=0.0))
    study.refine()
    study.limit = Limit(
        runner.world._replace(constants=(0.0, 4e-2)).tip(uniform(("z", "rigid"), 4), study.stepping), np.zeros(len(T))
    )
    errors = LinkErrors(runner, norm, study)
    assert errors.base == 4
    for hinges in (1, 2, 4):
        true = abs(1e-2 * (hinges**-2.0 - 8 * hinges**-4.0))
        assert errors.error(uniform(("z", "rigid"), hinges)) == pytest.approx(true, rel=1e-9)
    assert errors.error(uniform(("z", "rigid"), 8)) == pytest.approx(1e-2 * (4**-2.0 - 8 * 4**-4.0) / 4, rel=1e-9)


def test_a_perturbed_run_turns_every_joint_by_the_given_angle() -> None:
    """Two straight bars of 1 m each: turning both joints by an angle moves the tip by (2 m + 1 m) · angle."""
    runner, steps = ModelRunner(SCENE.varied({"run.duration": 0.05}), 60.0), Stepping("RK4", step=0.05)
    plain, turned = runner.run((None, None), steps), runner.perturbed_run((None, None), steps, 1e-3)
    assert turned is not None
    assert np.linalg.norm(turned.tip[0] - plain.tip[0]) == pytest.approx(3e-3, rel=1e-3)


def test_postures_are_sampled_over_the_run_and_fixed_steps_respect_the_limit() -> None:
    runner = ModelRunner(SCENE.varied({"run.duration": 0.2}), 60.0)
    run = runner.run((None, None), Stepping("RK4", step=0.05)).run
    assert run is not None
    runner.sample_postures(run)
    assert [time for time, _, _ in runner.postures] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2])
    assert [list(angles.values()) for _, angles, _ in runner.postures] == run.q.tolist()
    for largest, step in ((0.02, 0.05 / 3), (0.05, 0.05), (0.024, 0.05 / 3)):
        assert runner.fixed_steps(largest) == Stepping("RK4", pytest.approx(step))


def test_stable_steps_scale_with_the_inverse_square_of_the_hinge_count() -> None:
    runner = SimpleNamespace(
        estimated_step=lambda k, bend: 1e-3 / bend.hinges**2, stable_step=lambda model: 1e-3, budget=1.0,
        fixed_steps=lambda largest: Stepping("RK4", step=largest), fixed_steps_cost=lambda model, stepping: 0.1,
    )  # fmt: skip
    search = Search(cast("Any", runner), cast("Any", None), 1e-3)
    assert search._fixed(0.5, uniform(("z",), 4)) == Stepping("RK4", step=pytest.approx(0.45e-3))
    for hinges in (2, 4, 12):
        assert search._stable_step(0, Bend("z", "gauss", hinges)) == pytest.approx(1e-3 / hinges**2)


def test_the_axial_load_of_a_hanging_bar_is_its_weight_times_length_squared_over_ei() -> None:
    """γ = F L² / EI at the first of two hinges, which is 0.21 L below the joint."""
    hanging = make_scene(
        fl.Link(name="bar", length=2.0, material="aluminium", section="square", flex="z", segments=3),
        tip=fl.RigidBody(mass=5.0), gravity=(9.81, 0.0, 0.0), run=fl.RunSettings(duration=0.01, sample=0.01, step=1e-4),
    )  # fmt: skip
    below = 5.0 + 2700 * 0.04**2 * 2.0 * (1 - 0.2113)
    found = load_and_bend(hanging.arm, fl.simulate(hanging))
    assert found == pytest.approx((below * 9.81 * 2.0**2 / (70e9 * 0.04**4 / 12),) * 2, rel=0.01)


def test_cells_are_tried_only_where_runs_with_them_are_more_accurate_than_with_gauss() -> None:
    """A hose with γ = 19,620, released at 20°: γ/N² is 545 with 6 hinges and 34 with 24."""
    link = fl.Link(
        name="a", length=10.0, rigidity="r", flex="z", segments=9, joint=fl.Joint(axis=(0.0, 1.0, 0.0)),
        mount=fl.Mount(rpy_deg=(0.0, 90.0, 0.0)),
    )  # fmt: skip
    arm = fl.Arm(links=(link,), rigidities={"r": fl.Rigidity(x=(0.0, 10.0), rho_a=(1.0, 1.0), ei_z=(0.5, 0.5))})
    hose = fl.Scene(name="hose", arm=arm, gravity=(0.0, 0.0, -9.81), initial=fl.InitialState(joint_deg=(20.0,)),
                    run=fl.RunSettings(duration=2.0, tolerance=1e-3))  # fmt: skip

    def tips(rule: str, hinges: int) -> np.ndarray:
        return fl.simulate(hose.varied({"link.a.lumping": rule, "link.a.segments": hinges + 1})).tip

    exact = tips("gauss", 96)
    for hinges, pays in ((6, False), (24, True)):
        gauss, cells = (np.abs(tips(rule, hinges) - exact).max() for rule in ("gauss", "lobatto2"))
        assert may_pay(arm, fl.simulate(hose), hinges) == (cells < gauss) == pays


def test_two_levels_that_agree_do_not_lower_the_error_estimate_too_far() -> None:
    """For tips at 0, 1 and 1 cm with 4, 6 and 8 hinges, the error is 1.4 · 0.8 (6/8)⁴ cm.

    Extrapolation from the first two levels moves the tip by a further 0.8 cm.
    """
    limit = study_of_levels(n4=along_x(0.0, 0.0), n6=along_x(0.0, 0.01), n8=along_x(0.0, 0.01)).limit
    assert limit is not None
    assert limit.tip[1, 0] == 0.01
    assert limit.error == pytest.approx(1.4 * 0.008 * (6 / 8) ** 4)


def test_an_incomplete_run_is_not_accepted_however_small_its_error(advised: Any) -> None:
    errors = SimpleNamespace(from_limit=lambda tip: 1e-9)
    search = Search(cast("Any", None), cast("Any", errors), 1e-3)
    good = Outcome(PATH, 1.0, None, Stepping("Radau5", tolerance=1e-5))
    assert not search.accept((None,), good._replace(reason="did not end"))
    assert search.solution is None
    assert search.accept((None,), good)
    assert search.accept((None,), good._replace(seconds=2.0))  # an equally accurate but more expensive run
    assert search.solution is not None
    assert search.solution.outcome.seconds == 1.0
