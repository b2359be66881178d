"""Checks of a run: finite samples only, a stable step, and the energy balance."""

import contextlib
import pickle
import re
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.dynamics.floating_base import FloatingBase
from flexlink.kernels.stepping.judgement import SEEN, WRONG, Allowance, explained_by
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.motion import monitor
from flexlink.motion.batch import outcomes
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import allowed_imbalance, tolerance_of
from flexlink.results import balance
from flexlink.results.record import Record, trajectory_from_states
from flexlink.results.stop_reasons import Failure
from tests.campaigns.random_scenes import verdict
from tests.conftest import ROOT, compiled, flexible, make_scene
from tests.support.looking import digests, in_every_way
from tests.support.words import refused, reviewed

HANGING = make_scene(
    fl.Link(name="a", length=1.0, material="aluminium", section="square"),
    gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)),
)  # fmt: skip
"""A rod near its upright position."""


@pytest.fixture
def paper(models) -> fl.Scene:
    return fl.load_scene(models / "paper_fig5.toml")


def finite(run: fl.Trajectory) -> bool:
    return all(np.isfinite(column).all() for column in run.columns.values())


# -- the energy balance ------------------------------------------------------------------------------------------------


def test_a_run_of_another_engine_has_no_work_or_imbalance(paper: fl.Scene) -> None:
    run = fl.simulate(paper, duration=0.01)
    other = trajectory_from_states(problem_of(paper), run.t, run.q, run.qd)
    assert "work [J]" not in other.columns
    with refused(fl.errors.ArgumentError, "engine-does-not-support"):
        _ = other.imbalance


# -- finite samples only -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sample", [0.01, 0.05, 0.25, 1.0])
@pytest.mark.parametrize("unstable", ["refuse", "allow"])
def test_all_samples_of_a_run_are_finite(paper: fl.Scene, sample: float, unstable: str) -> None:
    """The overflow may also occur in the last step of a piece or of the run."""
    with pytest.raises((fl.errors.UnstableStepError, fl.errors.DivergenceError)) as caught:
        fl.simulate(paper, step=0.01, sample=sample, duration=1.0, unstable=unstable)
    kept = getattr(caught.value, "trajectory", None)
    assert kept is None or finite(kept)


# -- the step is checked before the run --------------------------------------------------------------------------------


def test_the_error_names_the_step_that_overflows(paper: fl.Scene) -> None:
    ended = []
    for sample in (0.01, 1.0):
        run = fl.RunSettings(step=0.01, sample=sample, duration=20.0, unstable="allow")
        with pytest.raises(fl.errors.DivergenceError) as caught:
            fl.simulate(paper.varied({"run": run}))
        ended.append(caught.value)
    finite = len(ended[0].trajectory.t)  # the first sample is at step 0
    step = int(str(ended[1]).split("(step ")[1].split(",")[0])
    assert 0 <= step - finite <= 1  # energies overflow one step earlier than angles


def test_a_step_above_the_largest_stable_one_is_refused(paper: fl.Scene) -> None:
    with refused(fl.errors.UnstableStepError, "unstable-step") as caught:
        fl.simulate(paper, step=0.01, sample=0.01, duration=1.0)
    assert caught.value.largest == pytest.approx(fl.stable_step(fl.lump(paper), method="RK4"), rel=0.01)
    assert pickle.loads(pickle.dumps(caught.value)).largest == caught.value.largest


def test_the_result_notes_an_unstable_step_that_was_allowed(paper: fl.Scene, tmp_path) -> None:
    run = fl.simulate(paper, step=4.95e-4, sample=4.95e-3, duration=9.9e-3, unstable="allow")
    assert "run.step = 0.000495 s" in run.warnings[0]
    assert "run.step" in str(np.load(run.save(tmp_path / "run.npz"))["warnings"][0])


def test_dry_friction_limits_the_step_by_its_slope_at_rest() -> None:
    """Two rigid links with 500 N m of dry friction: without this check the tip error was 0.3 m."""
    links = [
        fl.Link(name=name, length=1.0, material="aluminium", section="square", joint=fl.Joint(coulomb=500.0))
        for name in "ab"
    ]
    scene = make_scene(*links, gravity=(0.0, 9.81, 0.0))
    with refused(fl.errors.UnstableStepError, "unstable-step"):
        fl.simulate(scene, duration=0.1)


def test_drive_gains_limit_the_step() -> None:
    """J q̈ = −k_p q − k_d q̇: with k_d alone RK4 is stable up to 2.785 J/k_d."""
    wheel = fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 2.0))
    for kp, kd, limit in ((0.0, 400.0, 2.785293563 * 2.0 / 400.0), (8e4, 0.0, 2.828427522 / 200.0)):
        drive = fl.Drive(kind="pd", kp=(kp,), kd=(kd,), target_deg=(1.0,))
        scene = make_scene(fl.Link(name="a"), tip=wheel, gravity=(0, 0, 0), drive=drive)
        for h, is_refused in ((1.001 * limit, True), (0.999 * limit, False)):
            run = fl.RunSettings(step=h, sample=h, duration=h)
            with (
                pytest.raises(fl.errors.UnstableStepError)
                if is_refused
                else contextlib.suppress(fl.errors.DivergenceError)
            ):  # stable, but not accurate
                fl.simulate(scene.varied({"run": run}))


def test_loads_that_stiffen_a_chain_shorten_the_stable_step() -> None:
    """For a string of two point masses under a pull P ≫ k/l, ω² grows with P, so the stable step becomes shorter."""
    scene = make_scene(flexible("a", "z", 5, joint=fl.Joint(locked=True)), gravity=(0, 0, 0))
    chain, q = fl.lump(scene), np.zeros(4)
    slack, pulled = (fl.stable_step(chain, q, method="RK4", tip_wrench=[f, 0, 0, 0, 0, 0]) for f in (0.0, 1e6))
    ω = fl.natural_frequencies(chain, q, tip_wrench=[1e6, 0, 0, 0, 0, 0])[-1]
    assert pulled * ω == pytest.approx(2.828427522, rel=1e-6)
    assert pulled < 0.8 * slack
    with pytest.raises(fl.errors.UnstableStepError):
        fl.simulate(
            scene.varied({"wrench": fl.Wrench(force=(1e6, 0, 0))}), step=slack, sample=slack, duration=10 * slack
        )


def test_a_falling_upright_rod_has_a_largest_stable_step() -> None:
    """Small motion about the upright position is e^(±λt) with λ = √(3g/2l); the stable step is 2.785/λ."""
    scene = make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"), gravity=(-9.81, 0.0, 0.0))
    rate = np.sqrt(9.81 * 0.5 / (1 / 3 + 0.04**2 / 12))  # m g l/2 over I of a square bar about its end
    assert fl.stable_step(fl.lump(scene), [0.0], method="RK4") * rate == pytest.approx(2.785293563, rel=1e-6)
    fl.simulate(scene, step=1e-3, sample=1e-2, duration=0.1)


# -- finite but wrong runs ------------------------------------------------------------------------------------------


def test_a_finite_run_with_a_wrong_energy_is_refused() -> None:
    """With steps that are stable at rest but too long, the method dissipates the energy of the pendulum."""
    with refused(fl.errors.DivergenceError, "energy-imbalance") as caught:
        fl.simulate(wild())
    kept = caught.value.trajectory
    assert (np.abs(kept.imbalance) <= 0.1 * kept.exchanged + 1e-9).all()
    insisted = fl.simulate(wild(**{"run.unstable": "allow"}))
    (warning,) = (text for text in insisted.warnings if " J " in text)
    check_text("energy-imbalance", warning)


def test_rounding_errors_of_an_arm_at_rest_are_not_an_energy_imbalance(paper: fl.Scene) -> None:
    """Almost no energy is exchanged, so any imbalance is a large share of it; this imbalance is within rounding."""
    still = paper.varied({"initial.joint_deg": (0.0, -90.0, 0.0), "initial.passive": "static"})
    assert np.abs(fl.simulate(still, duration=0.5).imbalance).max() < 1e-10


def test_a_run_is_doubtful_if_rounding_errors_of_large_angles_add_up() -> None:
    swinging = make_scene(flexible("a"), initial=fl.InitialState(joint_deg=(20.0,)), gravity=(0.0, 9.81, 0.0))
    warnings = []
    for turns in (0, 20, 10**8):
        moved = swinging.varied({"initial.joint_deg": (20.0 + 360.0 * turns,)})
        run = fl.simulate(moved, step=1e-6, sample=1e-4, duration=1e-3)
        warnings.append(run.warnings)
    assert [len(each) for each in warnings] == [0, 0, 1]
    assert "6.3e+08 rad" in warnings[2][0]
    check_text("doubtful-rounding", warnings[2][0], values=False)


def check_text(id: str, text: str, *, values: bool = True) -> None:
    """Compare a warning or failure with the reviewed text, and its id, if any, with the given one."""
    assert (getattr(text, "id", "") or id) == id
    reviewed(id, text, values=values)


def looked_at(scene: fl.Scene, q: np.ndarray) -> Monitor:
    """The monitor of a run whose only sample is a configuration at rest."""
    problem = problem_of(replace(scene, run=replace(scene.run, duration=0.0)))
    monitor = Monitor(Record(problem, np.zeros(1), np.array([q]), np.zeros((1, problem.chain.n))))
    monitor.check(1)
    return monitor


@pytest.mark.parametrize(("k", "angle"), [(2, -85.0), (6, -85.0), (2, 401.1)])
def test_a_warning_names_every_hinge_bent_beyond_84_degrees(k: int, angle: float) -> None:
    scene, q = make_scene(flexible("a", "xyz", 3)), np.zeros(7)
    q[k] = np.radians(83.0)
    assert not looked_at(scene, q).warnings
    q[k] = np.radians(angle)
    (warning,) = looked_at(scene, q).warnings
    assert repr(fl.lump(scene).joint_name(k)) in warning and f"{angle}°" in warning
    check_text("hinge-bent-far", warning)


def test_a_diverging_run_that_continues_has_no_warnings_on_its_large_angles(paper: fl.Scene) -> None:
    with pytest.raises(fl.errors.DivergenceError) as caught:
        fl.simulate(paper, step=1e-2, sample=1e-2, duration=0.5, method="RK4", unstable="allow")
    ids = {warning.id for warning in caught.value.trajectory.warnings}
    assert "energy-imbalance" in ids
    assert not ids & {"hinge-bent-far", "doubtful-rounding"}


def test_a_configuration_with_indefinite_m_is_refused() -> None:
    scene = make_scene(flexible("a", "xyz", 9, lumping="gauss_matched"))
    chain = fl.lump(scene)
    q = np.where(chain.stiffness > 0, np.radians(80.0), 0.0)
    assert np.linalg.eigvalsh(fl.mass_matrix(chain, q))[0] < 0
    failure = looked_at(scene, q).failure
    assert "'a.1.x'" in failure
    assert "80.0°" in failure
    check_text("mass-not-positive-definite", failure)
    assert not looked_at(scene, 0.1 * q).failure


# -- doubt -------------------------------------------------------------------------------------------------------------


def swung(step: float, sample: float | None = None) -> fl.Trajectory:
    """A rod released 10° from its upright position."""
    return fl.simulate(HANGING, step=step, sample=sample or step, duration=34.0)


def sum_of_errors(run: fl.Trajectory) -> float:
    """The sum of step errors [m] that a doubtful run reports."""
    (found,) = (re.findall(r"(\S+) m\b", text) for text in run.warnings if re.search(r"\d m\b", text))
    return float(found[0])


def test_a_run_is_doubtful_for_errors_of_steps_and_of_energy() -> None:
    assert not swung(0.005).warnings
    run = swung(0.17)
    steps, energy = run.warnings
    check_text("doubtful-step-errors", steps)
    check_text("doubtful-energy", energy)
    (share,) = re.findall(r"\d\.\d+", energy)
    assert float(share) == pytest.approx(np.abs(run.imbalance).max() / run.exchanged[-1], rel=0.02)


def test_the_sum_of_step_errors_does_not_depend_on_the_number_of_probed_steps(monkeypatch) -> None:
    few = sum_of_errors(swung(0.17))
    monkeypatch.setattr(sys.modules["flexlink.motion.tolerable"], "APART", 1)  # probe every step
    assert sum_of_errors(swung(0.17)) == pytest.approx(few, rel=0.3)


def test_step_errors_between_samples_count_like_those_at_samples() -> None:
    assert sum_of_errors(swung(0.17, 0.85)) == pytest.approx(sum_of_errors(swung(0.17)), rel=0.5)


def test_a_tolerance_explains_only_its_share_of_the_imbalance_of_an_explicit_run() -> None:
    scene = swung(0.005).scene.varied({"run.tolerance": 0.05})
    run, chain, T, X = scene.run, fl.lump(scene), 1e4, 10.0
    for r in (-X, X):
        capped = allowed_imbalance(run, chain, 1e-12, explicit=True, compared=False)
        assert (capped.least, capped.part) == (0.05, 0.0)
        assert explained_by(capped, 0.05, 3.0, r, X, T) == pytest.approx(10.0 * 2 * 3 * 0.05 / 3.0)
        free = allowed_imbalance(run, chain, 1e-12, explicit=False, compared=True)
        momentum = 0.05 * np.sqrt(2 * chain.mass * T) * 100 / run.duration
        assert explained_by(free, 0.05, 3.0, r, X, T) == pytest.approx(
            np.inf if r < 0 else 0.05 * chain.weight + momentum
        )
        assert explained_by(balance.NOTHING, 0.05, 3.0, r, X, T) == 0.0


# -- terms of the balance ---------------------------------------------------------------------------------------


def test_the_energy_check_of_samples_gives_its_documented_values(rng: np.random.Generator) -> None:
    """Imbalance r, exchanged energy X, rounding ε and the unexplained part of r agree for random samples."""
    links = flexible("a", "xyz", 3), flexible("b", "xyz", 3)
    chain, rows, n = fl.lump(make_scene(*links, gravity=(1.0, 7.0, 3.0))), 9, 8
    force = np.array([2.0, -1.0, 0.5])
    energy, works, tip = rng.normal(size=(3, rows)), rng.normal(size=rows), rng.normal(size=(rows, 3))
    energy[0] = np.abs(energy[0])
    q, zero, t = rng.normal(size=(rows, n)), np.zeros((rows, n)), np.arange(rows) * 0.1
    so_far = np.zeros((rows, SO_FAR.size))
    so_far[:, SO_FAR.steps], so_far[:, SO_FAR.deflection] = 3 + 5 * np.arange(rows), rng.uniform(size=rows)
    samples = t, q, zero, zero.copy(), tip, energy, works, so_far
    some = Allowance(least=0.4, part=0.8, weight=0.3, momentum=0.2, share=1.5)
    work = works + (tip - tip[0]) @ force
    r = balance.imbalance(energy, work, energy[:, 0])
    X = np.maximum.accumulate(balance.turned_over(energy, work, energy[:, 0]))
    ε = np.maximum.accumulate(rounding.of_energy_balance(chain, energy, work, q)) * (1 + 3 + 5 * np.arange(rows))
    δ = np.maximum(0.4, 0.8 * so_far[:, SO_FAR.deflection])
    box = np.maximum.accumulate(tip), np.minimum.accumulate(tip)
    moved = np.linalg.norm(box[0] - box[1], axis=1)
    with np.errstate(divide="ignore"):  # at the start the tip has not moved
        explained = ε + np.minimum(δ * (0.3 + 0.2 * np.sqrt(energy[0])), 1.5 * δ / moved * X)
    known = balance.Balance(chain, force, insisted=True)
    known.start(energy[:, 0], tip[0])
    for first, stop in ((0, 4), (4, rows)):
        assert known.look(first, stop, samples, some) == (stop, WRONG.nothing)
    garbage = np.abs(r) > balance.SHARE * X + explained
    (seen, k), left = (known.seen, int(np.argmax(garbage))), np.abs(r)[~garbage]
    assert garbage.any() and not garbage.all()
    found = seen[[SEEN.exchanged, SEEN.unbalanced, SEEN.excused, SEEN.garbage, SEEN.imbalance, SEEN.available]]
    wanted = X[-1], max(0.0, (left - explained[~garbage]).max()), (left - ε[~garbage]).max(), k, r[k], X[k]
    assert found == pytest.approx(wanted, rel=1e-12)
    strict = balance.Balance(chain, force)
    strict.start(energy[:, 0], tip[0])
    assert strict.look(0, rows, samples, some) == (k, WRONG.balance)
    for at_rest in (balance.NOTHING, Allowance(weight=1.0)):  # no energy is exchanged, so any share of it is 0
        still = balance.Balance(chain, force)
        parts = t, zero, zero, zero, np.zeros((rows, 3)), np.zeros((3, rows)), np.zeros(rows), so_far
        assert still.look(0, rows, parts, at_rest) == (rows, WRONG.nothing)
        assert np.isfinite(still.seen).all()
    for place, value, why in ((samples[3], np.inf, WRONG.finite), (energy, np.nan, WRONG.finite)):
        before = place.copy()
        place[(3, 1) if place is samples[3] else (1, 3)] = value
        assert balance.Balance(chain, force, insisted=True).look(0, rows, samples, some) == (3, why)
        place[:] = before
    energy[0, 5] = -1.0
    assert balance.Balance(chain, force, insisted=True).look(0, rows, samples, some) == (5, WRONG.kinetic)


def test_the_energy_exchanged_is_the_sum_of_gains_and_losses_of_its_parts() -> None:
    energy, start, work = np.array([[1.0], [-2.0], [3.0]]), np.array([0.5, 1.0, 1.0]), np.array([-4.0])
    assert balance.turned_over(energy, work, start) == pytest.approx([1.0 + 3.0 + 2.0 + 4.0])
    assert balance.imbalance(energy, work, start) == pytest.approx([2.0 - 2.5 + 4.0])


def test_the_reach_bounds_the_distance_of_every_mass() -> None:
    links = flexible("a", "rigid", 1), flexible("b", "rigid", 1)
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.0)))
    stretched = sum(link.length for link in links)
    assert stretched <= chain.reach < 2 * stretched


# -- random scenes -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_no_random_scene_gives_a_wrong_run_without_a_warning() -> None:
    """Run a few of the scenes that `python -m tests.campaigns.random_scenes 2000` runs."""
    outcomes = {seed: verdict(seed) for seed in range(20)}
    assert {seed: found for seed, found in outcomes.items() if found[0] == "WRONG"} == {}
    assert sum(found[0] == "right" for found in outcomes.values()) >= 3  # the reference is used in these runs


def monitor_of(scene: fl.Scene, *postures: Array) -> Monitor:
    """Monitor of a run with these configurations, at rest."""
    last = 0.01 * (len(postures) - 1)
    problem = problem_of(replace(scene, run=replace(scene.run, sample=0.01, duration=last)))
    q = np.array(postures)
    return Monitor(Record(problem, 0.01 * np.arange(len(q)), q, np.zeros_like(q)))


@pytest.mark.parametrize(("angle", "shown"), [(-31.0, "-31"), (-29.0, ""), (44.0, ""), (46.0, "46")])
def test_a_joint_beyond_either_limit_has_a_warning(angle: float, shown: str) -> None:
    scene = make_scene(flexible("a", joint=fl.Joint(limits_deg=(-30.0, 45.0))))
    q = np.zeros(fl.lump(scene).n)
    bent = q.copy()
    bent[0] = np.radians(angle)
    seen = monitor_of(scene, q, bent)
    seen.check(2)
    expected = ["joint-past-limits"] * bool(shown)
    assert [warning.id for warning in seen.warnings] == expected
    for warning in seen.warnings:
        assert all(part in warning for part in ("'a'", f" {shown}°", "-30°", "45°"))
        reviewed(warning.id, warning)


def test_m_is_checked_where_hinges_are_bent_most() -> None:
    """With matched twist, M is indefinite at 80° (see `test_monitor`), but not at the start of the run."""
    scene = make_scene(
        flexible("a", "xyz", 9, lumping="gauss_matched"), run=fl.RunSettings(step=1e-4, unstable="allow")
    )
    chain = fl.lump(scene)
    bent = np.where(chain.stiffness > 0, np.radians(80.0), 0.0)
    seen = monitor_of(scene, 0 * bent, bent, 0.1 * bent)
    assert not seen.check(3)
    assert "80.0°" in seen.failure
    reviewed("watching: matched twist", seen.failure)
    assert seen.n_valid == 1


def test_the_remedy_is_a_smaller_tolerance_or_for_vanishing_steps_a_larger_one() -> None:
    scene = make_scene(flexible("a"), run=fl.RunSettings(tolerance=1e-4, duration=0.1))
    still = np.zeros(fl.lump(scene).n)
    wrong, stuck = monitor_of(scene, still, still), monitor_of(scene, still, still)
    for each in (wrong, stuck):
        each.check(1)
    wrong.failure = "energy"
    smaller, larger = str(wrong.diverged()), str(stuck.diverged(Failure("t = 0.01 s: steps")))
    assert "a smaller tolerance" in smaller
    assert "a larger tolerance" in larger
    reviewed("watching: remedies", f"{smaller}\n{larger}")


@compiled
def test_m_of_matched_twist_is_checked_in_batches_like_in_single_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = make_scene(flexible("a", "xyz", 5, lumping="gauss_matched"), run=fl.RunSettings(step=1e-6, duration=4e-6))
    monkeypatch.setattr(monitor, "mass_matrix", lambda chain, q: -np.eye(chain.n))
    texts = []
    for run in (lambda: fl.simulate(scene), lambda: fl.simulate_many([scene, scene])):
        with pytest.raises(fl.errors.DivergenceError) as caught:
            run()
        texts.append(str(caught.value))
    assert texts[1] == texts[0]
    reviewed("watching: M is indefinite", texts[0])


def test_a_controller_is_called_once_per_instant_even_if_the_motion_amplifies_errors() -> None:
    """A controller may have an internal state, so no verification run calls it."""
    rod = fl.Link(name="rod", length=1.0, material="aluminium", section="square")
    start = fl.InitialState(joint_deg=(0.0,), rate_deg=(4000.0,))
    scene = make_scene(
        rod, initial=start, run=fl.RunSettings(method="DOP853", tolerance=1e-5, duration=0.5, sample=0.1)
    )
    times = []

    def controller(t: float, q: Array, qd: Array) -> Array:
        times.append(t)
        return np.array([50.0])

    run = fl.simulate(scene, control=controller, rate=100.0)
    assert np.abs(run.q).max() > 30.0
    np.testing.assert_allclose(times, 0.01 * np.arange(51), atol=1e-12)
    assert not run.warnings, run.warnings


def test_a_relative_tolerance_is_a_fraction_of_the_reach_or_of_the_deflection() -> None:
    chain = fl.lump(make_scene(flexible("a", length=2.0)))
    of_reach = fl.RunSettings(relative_tolerance=1e-3)
    assert tolerance_of(of_reach, chain, 0.05) == pytest.approx(1e-3 * chain.reach, rel=1e-14)
    of_deflection = fl.RunSettings(relative_tolerance=1e-3, accuracy="deflection")
    assert tolerance_of(of_deflection, chain, 0.05) == pytest.approx(1e-3 * 0.05, rel=1e-14)


TUMBLER = fl.Arm(
    links=(flexible("a", "yz", 2, joint=fl.Joint(viscous=0.1), section="rod", material="soft"),),
    materials={"soft": fl.Material(young=2e9, density=1500.0)},
    sections={"rod": fl.Section(shape="circle", diameter=0.02)},
    tip=fl.RigidBody(mass=0.2), base=fl.Base(kind="free", mass=3.0, inertia=(0.2, 0.25, 0.3)),
)  # fmt: skip
SPIN = fl.InitialState(joint_deg=(20.0,), base=fl.details.BaseState(spin_deg=(30.0, 300.0, 60.0)))


def pendulum(**changes: Any) -> fl.Scene:
    """A soft link that bends and swings beyond its joint limits."""
    joint = fl.Joint(limits_deg=(-30.0, 60.0))
    link = flexible("a", "z", 4, joint=joint)
    scene = make_scene(link, gravity=(0.0, 9.81, 0.0), initial=fl.InitialState(joint_deg=(50.0,)))
    return scene.varied({"material.aluminium": fl.Material(young=1e8, density=2700.0), "run.duration": 0.5, **changes})


def driven(**changes: Any) -> fl.Scene:
    """A flexible link that a PD drive turns by 5° from static equilibrium."""
    pd = fl.Drive(kind="pd", kp=(2000.0,), kd=(120.0,), target_deg=(-10.0,))
    start = fl.InitialState(joint_deg=(-15.0,), passive="static")
    scene = make_scene(flexible("a", "z", 5), gravity=(0.0, 9.81, 0.0), drive=pd, initial=start)
    return scene.varied({"run.duration": 0.3, "run.sample": 0.01, **changes})


def slow_start() -> fl.Scene:
    """A link of spring steel that a stiff motor turns along a quintic: little energy is exchanged at first."""
    link = fl.Link(
        name="a", length=0.6271443245261225, material="steel", section="blade", flex="z", segments=5,
        mount=fl.Mount(rpy_deg=(90.0, 0.0, 0.0)), joint=fl.Joint(viscous=0.014072308992832272, armature=0.02),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), materials={"steel": fl.Material(young=205e9, density=7840.0, loss_time=5e-5)},
        sections={"blade": fl.Section(shape="rectangle", height=0.011924457975022196, width=0.03)},
        tip=fl.RigidBody(mass=0.8416351233032555),
    )  # fmt: skip
    to = fl.Reference(profile="quintic", to_deg=(23.058306634987986,), duration=0.6)
    return fl.Scene(
        name="slow start", arm=arm, gravity=(0.0, 0.0, -9.81), run=fl.RunSettings(duration=0.9, sample=0.03),
        initial=fl.InitialState(joint_deg=(-15.520856018662947,), passive="static"),
        drive=fl.Drive(kind="pd", kp=(2000.0,), kd=(120.0,), reference=to),
    )  # fmt: skip


def tumbler(**changes: Any) -> fl.Scene:
    """A scene of an arm on a tumbling free base."""
    scene = fl.Scene(name="tumbler", arm=TUMBLER, initial=SPIN, gravity=(0.0, 0.0, 0.0))
    return scene.varied({"run.duration": 0.5, "run.sample": 0.05, **changes})


def wild(**changes: Any) -> fl.Scene:
    """A rod released nearly upright, with such long steps that the method loses or gains energy."""
    return HANGING.varied({"run.step": 0.35, "run.sample": 0.35, "run.duration": 35.0, **changes})


def bent(**changes: Any) -> fl.Scene:
    """A soft link that bends beyond 84°."""
    soft = flexible("a", "xyz", 2, joint=fl.Joint(locked=True), lumping="midpoint")
    scene = make_scene(soft, gravity=(0.0, 0.0, -60.0))
    material = fl.Material(young=2e6, density=1000.0)
    return scene.varied({"material.aluminium": material, "run.duration": 1.0, "run.sample": 0.01, **changes})


def test_a_control_law_of_zero_torque_leaves_the_base_attitude_unchanged() -> None:
    scene = tumbler(**{"run.step": 2e-3, "run.duration": 0.2})
    free = fl.simulate(scene)
    driven = fl.simulate(scene, control=lambda t, q, qd: np.zeros(len(free.chain.active)))
    assert free.base is not None and driven.base is not None
    assert np.linalg.norm(free.base.attitude[-1] - free.base.attitude[0]) > 0.5
    np.testing.assert_allclose(driven.base.attitude, free.base.attitude, atol=1e-10)
    np.testing.assert_allclose(driven.tip, free.tip, atol=1e-10)


def test_restoring_a_base_restores_its_attitudes() -> None:
    base = FloatingBase(fl.lump(tumbler()))
    q = np.zeros((4, base.chain.n))
    q[:, 3:6] = 0.1 * np.arange(12).reshape(4, 3)
    (*_, before, _), saved = base.from_the_start(q, 0 * q), base.saved()
    base.turn(2, q[2].copy(), np.zeros(base.chain.n))
    assert np.abs(base.from_the_start(q, 0 * q)[2] - before).max() > 0.1
    base.restore(saved)
    np.testing.assert_array_equal(base.from_the_start(q, 0 * q)[2], before)


def law(_t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """A control law in Python that acts as a damper and a spring."""
    return np.asarray([-50.0 * q[0] - 5.0 * qd[0]])


TOLERANCE = {"run.step": None, "run.relative_tolerance": 1e-3}
KINDS: dict[str, Callable[[], Any]] = {
    "fixed explicit": lambda: fl.simulate(pendulum(**{"run.sample": 1e-3})),
    "fixed explicit, coarse": lambda: fl.simulate(wild()),
    "fixed explicit, insisted": lambda: fl.simulate(wild(**{"run.unstable": "allow"})),
    "fixed explicit, free base": lambda: fl.simulate(tumbler(**{"run.step": 1e-3})),
    "fixed implicit, free base": lambda: fl.simulate(tumbler(**{"run.step": 5e-3, "run.method": "Gauss6"})),
    "fixed implicit, coarse": lambda: fl.simulate(wild(**{"run.method": "Radau5", "run.step": 0.175})),
    "implicit": lambda: fl.simulate(driven(**TOLERANCE, **{"run.method": "Radau5"})),
    "explicit": lambda: fl.simulate(driven(**TOLERANCE, **{"run.method": "DOP853"})),
    "explicit, slow start": lambda: fl.simulate(slow_start(), method="DOP853", tolerance=4e-3),
    "of a deflection": lambda: fl.simulate(
        pendulum(**TOLERANCE, **{"run.method": "DOP853", "run.accuracy": "deflection", "run.sample": 0.01})
    ),
    "picked, with trials": lambda: fl.simulate(tumbler(**TOLERANCE, **{"run.method": "auto", "run.sample": 2e-3})),
    "no further": lambda: fl.simulate(
        driven(**TOLERANCE, **{"run.method": "Radau5", "run.max_evaluations": 60, "run.sample": 1e-3})
    ),
    "bent far": lambda: fl.simulate(bent(**TOLERANCE, **{"run.method": "Radau5"})),
    "a law": lambda: fl.simulate(pendulum(**{"run.sample": 0.01}), control=law, rate=200.0),
    "a law, adaptive": lambda: fl.simulate(
        pendulum(**TOLERANCE, **{"run.method": "Radau5", "run.sample": 0.01}), control=law, rate=200.0
    ),
    "side by side": lambda: fl.simulate_many(
        [pendulum(**{"run.sample": 5e-3, "initial.joint_deg": (angle,)}) for angle in (30.0, 50.0, 59.0)]
    ),
    "a sweep's members": lambda: outcomes([wild(), driven(**TOLERANCE), pendulum()], Stop()),
    "a model": lambda: fl.simulate(fl.load_scene(ROOT / "models" / "satellite.toml"), duration=0.2),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_results_and_warnings_do_not_depend_on_the_checking_times(kind: str) -> None:
    first, *others = in_every_way(KINDS[kind], kind)
    assert others == [first, first]


def test_the_compared_runs_cover_every_kind_of_ending() -> None:
    """If a kind of ending were missing, the comparison would not test it."""
    parts = {
        "fixed explicit": "joint 'a'",  # joint beyond its limits
        "fixed explicit, coarse": "E − E(0) − W",
        "no further": "max_evaluations = 60",
        "bent far": "'a.1.y'",
    }
    for kind, part in parts.items():
        assert any(part in text for each in digests(KINDS[kind]) for text in texts_of(each)), kind


def texts_of(found: object) -> Iterator[str]:
    """The error or the warnings of a run."""
    yield from [found] if isinstance(found, str) else found[2]  # type: ignore[index]


def test_a_run_with_little_energy_at_first_is_not_refused() -> None:
    run = fl.simulate(slow_start(), method="DOP853", tolerance=4e-3)
    exact = fl.simulate(slow_start(), method="Radau9", tolerance=1e-7)
    assert run.warnings == ()
    assert np.abs(run.tip - exact.tip).max() < 0.1 * 4e-3


@pytest.mark.parametrize("pieces", [(0, 20), (0, 1, 2, 3, 4, 5, 6, 7, 8, 20), (0, 4, 9, 20), (0, 7, 8, 20)])
def test_checks_of_configurations_do_not_depend_on_the_piece_size(pieces: tuple[int, ...]) -> None:
    """A joint beyond its limit and hinges that bend by 10° per sample until M is indefinite are both reported."""
    links = (
        flexible("a", "xyz", 9, lumping="gauss_matched"),
        flexible("b", "rigid", 1, joint=fl.Joint(limits_deg=(-9, 9))),
    )
    problem = problem_of(make_scene(*links).varied({"run.duration": 0.0, "run.unstable": "allow"}))
    chain, rows = problem.chain, np.arange(20.0)
    q = np.radians(np.multiply.outer(10.0 * rows, chain.stiffness > 0))
    q[2:, chain.index("b", 0, 0)] = 1.0
    monitor = Monitor(Record(problem, rows, q, np.zeros_like(q)))
    for stop in pieces[1:]:
        monitor.check(stop)
    firsts = [float(np.linalg.eigvalsh(fl.mass_matrix(chain, row))[0]) <= 0 for row in q]
    assert 3 < monitor.n_valid == firsts.index(True)
    unbalanced, past = monitor.warnings
    assert unbalanced.startswith("t = 1 s: ") and "E − E(0) − W" in unbalanced
    assert past.startswith("t = 2 s: ") and "joint 'b'" in past
    ids = {"mass-not-positive-definite": monitor.failure, "energy-imbalance": unbalanced, "joint-past-limits": past}
    for id, text in ids.items():
        assert (getattr(text, "id", "") or id) == id
        reviewed(id, text)
