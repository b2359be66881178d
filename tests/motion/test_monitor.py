"""Checks of a run: finite samples only, a stable step, and the energy balance."""

from __future__ import annotations

import contextlib
import pickle
import re
import sys

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.dynamics import rounding
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.kernels.stepping.judgement import SEEN, WRONG, Allowance, explained_by
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import allowed_imbalance
from flexlink.results import balance
from flexlink.results.record import Record, trajectory_from_states
from tests.campaigns.random_scenes import verdict
from tests.conftest import flexible, make_scene
from tests.support.words import refused, reviewed


@pytest.fixture
def paper(models) -> fl.Scene:
    return fl.load_scene(models / "paper_fig5.toml")


def finite(run: fl.Trajectory) -> bool:
    return all(np.isfinite(column).all() for column in run.columns.values())


# -- the energy balance ------------------------------------------------------------------------------------------------


def everything(flex: str, solver: str = "articulated") -> fl.Scene:
    """An arm with drive, friction, damping, wrench, a prescribed joint with a rotor, and oblique gravity."""
    links = (
        flexible("a", flex, 3, joint=fl.Joint(viscous=0.4, coulomb=0.5, coulomb_width=0.1, armature=0.3)),
        flexible("b", flex, 3, joint=fl.Joint(viscous=0.2, armature=0.1), damping=fl.Damping(ratio=0.05, at_hz=20.0)),
    )
    motion = fl.PrescribedMotion(
        link="a", times=(0.0, 0.1), angle_deg=(10.0, 25.0), rate_deg=(0.0, 40.0), acceleration_deg=(0.0, 0.0)
    )
    return make_scene(
        *links, gravity=(1.0, 7.0, 3.0), motion=(motion,), initial=fl.InitialState(joint_deg=(10.0, -30.0)),
        drive=fl.Drive(kind="pd", kp=(0.0, 30.0), kd=(0.0, 2.0), target_deg=(0.0, 10.0)),
        wrench=fl.Wrench(force=(3.0, -2.0, 1.0), moment=(0.4, 0.3, -0.5)),
        run=fl.RunSettings(step=2e-5, sample=1e-3, duration=0.1, solver=solver),
    )  # fmt: skip


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
def test_the_energy_gained_equals_the_work_of_all_loads(flex: str, solver: str) -> None:
    """The error of the balance has the order of the method: halving the step divides it by 16."""
    scene = everything(flex, solver)
    coarse, fine = (fl.simulate(scene, step=h) for h in (2e-5, 1e-5))
    parts = np.abs(np.diff(coarse.work)).sum()
    assert parts > 1.0  # J: enough to test the balance
    assert np.abs(coarse.imbalance).max() < 1e-7 * coarse.exchanged[-1]
    assert np.abs(fine.imbalance).max() < np.abs(coarse.imbalance).max() / 8 + 1e-12 * parts


def test_the_work_of_a_drive_equals_the_kinetic_energy_of_its_wheel() -> None:
    """J = 4 kg m² under 2 N m: q̇ = t/2, W = T = t²/2, all exact for a method of order 2."""
    wheel = fl.RigidBody(mass=1.0, inertia=(2.0, 2.0, 4.0))
    drive = fl.Drive(kind="constant", torque=(2.0,))
    run = fl.simulate(make_scene(fl.Link(name="a"), tip=wheel, gravity=(0, 0, 0), drive=drive), step=0.01, sample=0.1)
    np.testing.assert_allclose(run.work, run.t**2 / 2, rtol=1e-12)
    np.testing.assert_allclose(run.energy.kinetic, run.t**2 / 2, rtol=1e-12)


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


def test_all_samples_of_many_runs_are_finite(paper: fl.Scene) -> None:
    wild = paper.varied({"run": fl.RunSettings(step=0.01, sample=0.01, duration=0.05, unstable="allow")})
    with pytest.raises(fl.errors.DivergenceError) as caught:
        fl.simulate_many([wild, wild])
    assert all(finite(run) for run in caught.value.runs)


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
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    scene = make_scene(rod, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)))
    with refused(fl.errors.DivergenceError, "energy-imbalance") as caught:
        fl.simulate(scene, step=0.35, sample=0.35, duration=35.0)
    kept = caught.value.trajectory
    assert (np.abs(kept.imbalance) <= 0.1 * kept.exchanged + 1e-9).all()
    insisted = fl.simulate(scene, step=0.35, sample=0.35, duration=35.0, unstable="allow")
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


def test_a_warning_names_a_hinge_whose_axes_nearly_coincide() -> None:
    soft = flexible("a", "xyz", 2, joint=fl.Joint(locked=True), lumping="midpoint")
    scene = make_scene(soft, gravity=(0.0, 0.0, -60.0), run=fl.RunSettings(step=1e-4, sample=1e-2, duration=1.0))
    run = fl.simulate(scene.varied({"material.aluminium": fl.Material(young=2e6, density=1000.0)}))
    assert np.degrees(np.abs(run.q).max()) > 84
    (warning,) = run.warnings
    assert "'a.1.y'" in warning
    check_text("hinge-bent-far", warning)


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


def test_a_warning_names_every_hinge_bent_beyond_84_degrees() -> None:
    scene = make_scene(flexible("a", "xyz", 3))
    for k in (2, 6):
        q = np.zeros(7)
        q[k] = np.radians(83.0)
        assert not looked_at(scene, q).warnings
        q[k] = -np.radians(85.0)
        (warning,) = looked_at(scene, q).warnings
        assert repr(fl.lump(scene).joint_name(k)) in warning
        assert "-85.0°" in warning
        check_text("hinge-bent-far", warning)


def test_a_hinge_bent_by_more_than_a_turn_has_a_warning() -> None:
    (warning,) = looked_at(make_scene(flexible("a", "xyz", 3)), np.array([0.0, 0.0, 7.0, 0.0, 0.0, 0.0, 0.0])).warnings
    assert "401.1°" in warning
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


def swung(step: float) -> fl.Trajectory:
    """A rod released 10° from its upright position."""
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    scene = make_scene(rod, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)))
    return fl.simulate(scene, step=step, sample=step, duration=34.0)


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
    chain, force, rows, n = fl.lump(everything("xyz")), np.array([2.0, -1.0, 0.5]), 9, 8
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
