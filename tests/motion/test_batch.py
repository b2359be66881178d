"""Batches of states or scenes give the same results as single ones."""

import contextlib
import signal
import sys

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.dynamics.accelerations import lanes_workspace, solver_for
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.inputs.drives import side_by_side
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.monitor import step_errors, step_errors_side_by_side
from flexlink.motion.side_by_side import alike, fits_lanes
from flexlink.motion.single_run import SingleRun
from flexlink.results.record import Record
from tests.conftest import compiled, flexible, make_scene, nasty_scene, random_state
from tests.support.words import refused


@pytest.mark.parametrize("states", [1, 7, 8, 21])
@pytest.mark.parametrize("method", ["articulated", "lu"])
def test_a_batch_of_states_gives_the_accelerations_of_single_states(chain, states: int, method: str, rng) -> None:
    q, qd = (np.array(x) for x in zip(*(random_state(chain, rng) for _ in range(states)), strict=True))
    tau, wrench = rng.normal(size=q.shape), rng.normal(size=6)
    many = fl.forward_dynamics(chain, q, qd, tau, solver=method, tip_wrench=wrench)
    for row, state in zip(many, zip(q, qd, tau, strict=True), strict=True):
        np.testing.assert_array_equal(row, fl.forward_dynamics(chain, *state, solver=method, tip_wrench=wrench))


def test_batch_functions_do_not_modify_their_input_states(chain: fl.Chain, rng: np.random.Generator) -> None:
    """The functions read their input arrays without a copy."""
    q, qd = (np.array(x) for x in zip(*(random_state(chain, rng) for _ in range(9)), strict=True))
    states = [q, qd, rng.normal(size=q.shape)]
    before = [part.copy() for part in states]
    of_angles = fl.mass_matrix, fl.gravity_torque, fl.elastic_torque, fl.tip_position
    of_rates = fl.bias_torque, fl.momentum, fl.energy, fl.drag_torque
    of_all = (fl.forward_dynamics, fl.inverse_dynamics, fl.forward_dynamics_derivatives,
              fl.inverse_dynamics_derivatives, fl.point_motion)  # fmt: skip
    for count, functions in enumerate((of_angles, of_rates, of_all), start=1):
        for function in functions:
            function(chain, *states[:count])
    fl.friction_torque(chain, qd)
    for now, then in zip(states, before, strict=True):
        np.testing.assert_array_equal(now, then)


@pytest.mark.parametrize("made", ["read only", "of whole numbers", "every other row", "a column first"])
def test_any_array_layout_is_accepted_as_a_batch_of_states(chain, made: str, rng) -> None:
    """Kernels are compiled for one array layout; others are converted."""
    tau = np.round(rng.normal(size=(8, chain.n)))
    kinds = {
        "of whole numbers": tau.astype(int),
        "every other row": np.repeat(tau, 2, axis=0)[::2],
        "a column first": np.asfortranarray(tau),
    }
    other = kinds.get(made, tau.copy())
    if made == "read only":
        other.setflags(write=False)
    q = random_state(chain, rng)[0]
    np.testing.assert_array_equal(fl.forward_dynamics(chain, q, q, other), fl.forward_dynamics(chain, q, q, tau))


def test_states_of_unequal_shape_are_refused(chain: fl.Chain) -> None:
    q = np.zeros((3, chain.n))
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.forward_dynamics(chain, q, q, q[:2])


def members(flex: str, count: int) -> list[fl.Scene]:
    """Arms with different lengths, angles and gravity, under the same drive."""
    drive = fl.Drive(kind="pd", kp=(50.0, 20.0), kd=(1.0, 1.0), target_deg=(10.0, 20.0))
    wrench = fl.Wrench(force=(1.0, 2.0, 3.0))
    return [
        make_scene(
            flexible("a", flex, 3, length=1.0 + 0.1 * i, joint=fl.Joint(coulomb=0.1 * (i % 2))),
            flexible("b", flex, 3, mount=fl.Mount(rpy_deg=(0.0 if flex == "z" else 40.0, 0.0, 5.0 * i))),
            gravity=(0.0, 9.0 + i, 1.0),
            initial=fl.InitialState(joint_deg=(-80.0 + i, 3.0 * i)),
            drive=drive,
            wrench=wrench,
            run=fl.RunSettings(step=2e-5, sample=1e-3, duration=0.01),
        )
        for i in range(count)
    ]


@compiled
def test_step_errors_in_a_batch_equal_step_errors_of_single_runs() -> None:
    scenes = [scene.varied({"run.step": 1e-3, "run.unstable": "allow"}) for scene in members("z", LANES)]
    monitors = [SingleRun(problem_of(scene)).monitor for scene in scenes]
    q, qd = (np.stack([getattr(w.record, name)[:1] for w in monitors], axis=-1) for name in ("q", "qd"))
    chains, probed = [w.record.chain for w in monitors], np.array([0])
    scratch = lanes_workspace(solver_for(chains[0], "articulated"), chains)
    records = [w.record for w in monitors]
    inputs = records[0].inputs._replace(drive=side_by_side([record.inputs.drive for record in records]))
    errors = step_errors_side_by_side(records, scratch, inputs, (q, qd), probed)
    np.testing.assert_allclose(errors, [step_errors(w.record, probed) for w in monitors], rtol=1e-9)
    assert errors.min() > 1e-9
    assert len(np.unique(errors)) == LANES


@compiled
@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
@pytest.mark.parametrize("threads", [1, 2])
def test_scenes_simulated_together_give_the_trajectories_of_single_runs(flex: str, threads: int) -> None:
    scenes = members(flex, 11)
    for scene, many in zip(scenes, fl.simulate_many(scenes, threads=threads), strict=True):
        one = fl.simulate(scene)
        for name in ("t", "q", "qd", "tau", "tip", "work"):
            np.testing.assert_array_equal(getattr(many, name), getattr(one, name), err_msg=name)


def driven(**change: object) -> fl.Scene:
    """An arm that turns about one free joint, changed by the given edits."""
    arm = flexible("a", segments=3), flexible("b", segments=3, joint=fl.Joint(locked=True))
    fields = {"gravity": (0.0, 9.81, 0.0), "initial": fl.InitialState(joint_deg=(0.0, 30.0))}
    return make_scene(*arm, **{**fields, "run": fl.RunSettings(step=2e-5, sample=1e-3, duration=0.01), **change})


def swung(degrees: float) -> tuple[fl.PrescribedMotion, ...]:
    """A prescribed motion of the first joint from 0 to an angle [deg] within a second."""
    zero = (0.0, 0.0)
    return (
        fl.PrescribedMotion(link="a", times=(0.0, 1.0), angle_deg=(0.0, degrees), rate_deg=zero, acceleration_deg=zero),
    )


PULL = fl.Drive(kind="table", times=(0.0, 1.0), torques=((0.0, 0.0), (1000.0, 0.0)))
WEAK = fl.Drive(kind="pd", kp=(100.0, 0.0), kd=(1.0, 0.0), target_deg=(60.0, 0.0), effort=(1.0, 1.0))
DIFFER: dict[str, tuple[fl.Scene, dict[str, object]]] = {
    "drive": (driven(), {"drive": fl.Drive(kind="constant", torque=(50.0, 0.0))}),
    "wrench": (driven(), {"wrench": fl.Wrench(force=(0.0, 50.0, 0.0))}),
    "gravity": (driven(), {"gravity": (0.0, -9.81, 0.0)}),
    "a locked angle, with another chain": (driven(), {"initial": fl.InitialState(joint_deg=(0.0, 90.0))}),
    "a free angle": (driven(), {"initial": fl.InitialState(joint_deg=(20.0, 30.0))}),
    "step": (driven(), {"run.step": 1e-5}),
    "solver": (driven(), {"run.solver": "lu"}),
    "motion": (driven(motion=swung(30.0)), {"motion": swung(90.0)}),
    "no motion": (driven(), {"motion": swung(30.0)}),
    "plane": (driven(), {"link.a.flex": "yz", "gravity": (0.0, 9.81, 1.0)}),
    "name": (driven(), {"name": "other"}),
    "start": (driven(drive=PULL), {"initial.time": 0.5}),
    "limit": (driven(drive=WEAK), {"drive.effort": (2.0, 2.0)}),
}


@pytest.mark.parametrize("what", DIFFER)
def test_scenes_that_differ_in_one_setting_move_as_in_single_runs(what: str) -> None:
    base, change = DIFFER[what]
    scenes = [base, base.varied(change), nasty_scene().varied({"run": base.run}), base]
    singles = [fl.simulate(scene) for scene in scenes]
    for many, one in zip(fl.simulate_many(scenes), singles, strict=True):
        np.testing.assert_allclose(many.q, one.q, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(many.tau, one.tau, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(many.tip, one.tip, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(many.work, one.work, rtol=1e-9, atol=1e-12)
        assert many.chain.name == one.chain.name
    if what not in {"step", "solver", "name"}:
        assert np.abs(singles[0].tip - singles[1].tip).max() > 1e-8  # far above the allowed difference


MOVE = fl.Reference(profile="quintic", to_deg=(20.0, -10.0), duration=0.5)
LAWS = {
    "sampled": {"kind": "pd", "kp": (60.0, 30.0), "kd": (6.0, 2.0), "target_deg": (20.0, -10.0)},
    "rigid gravity": {"kind": "pd", "kp": (60.0, 30.0), "kd": (6.0, 2.0), "reference": MOVE, "gravity": "rigid"},
    "computed torque": {"kind": "computed_torque", "kp": (1.0, 1.0), "kd": (0.3, 0.3), "reference": MOVE},
    "cascade": {"kind": "cascade", "kp": (9.0, 9.0), "kd": (6.0, 2.0), "ki": (9.0, 9.0), "reference": MOVE,
                "gravity": "rigid", "filter": (fl.details.DriveFilter(low_pass=80.0),)},
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("delay", [0.0, 0.003])
def test_laws_with_models_and_memories_run_side_by_side(law: str, delay: float) -> None:
    drive = fl.Drive(rate=500.0, delay=delay, **LAWS[law])
    motor = fl.Joint(armature=2.0)
    arm = make_scene(flexible("a", segments=2, joint=motor), flexible("b", segments=2, joint=motor))
    run = fl.RunSettings(step=1e-4, duration=0.06, sample=0.002)
    one = arm.varied({"drive": drive, "run": run})
    scenes = [one.varied({"tip.mass": 1.0 + k, "initial.rate_deg": (k / 9.0, 0.0)}) for k in range(9)]
    problems = [problem_of(scene) for scene in scenes]
    assert all(fits_lanes(problem) and alike(problems[0], problem) for problem in problems)
    for found, scene in zip(fl.simulate_many(scenes), scenes, strict=True):
        single = fl.simulate(scene)
        for name in ("q", "qd", "tau", "delayed"):
            np.testing.assert_array_equal(getattr(found, name), getattr(single, name), err_msg=name)


def test_drives_that_differ_do_not_act_side_by_side() -> None:
    arm = make_scene(flexible("a", segments=2)).varied({"run": fl.RunSettings(step=2e-4, duration=0.06, sample=0.002)})
    drive = fl.Drive(kind="cascade", rate=500.0, kp=(9.0,), kd=(6.0,), ki=(1.0,), target_deg=(20.0,))
    one = problem_of(arm.varied({"drive": drive}))
    changes = {"ki": (2.0,), "rate": 250.0, "delay": 0.002, "filter": (fl.details.DriveFilter(low_pass=80.0),)}
    for name, value in changes.items():
        assert not alike(one, problem_of(arm.varied({"drive": drive, f"drive.{name}": value}))), name


PD = fl.Drive(kind="pd", kp=(50.0, 20.0), kd=(1.0, 1.0), target_deg=(10.0, 20.0))
GAUGE = fl.Sensor(name="gauge", kind="strain", link="a", x=0.3, fibre=(0.01, 0.0))
MOVE = {
    "kind": "pd", "kp": (50.0, 20.0), "kd": (1.0, 1.0),
    "reference": {"profile": "quintic", "to_deg": (10.0, 20.0), "duration": 0.01},
}  # fmt: skip
STARTED = {  # changes of an arm whose runs differ in their start, and changes of every second run
    "undriven": ({}, {"initial.rate_deg": (20.0, 0.0)}),
    "sampled": ({"drive": PD, "drive.rate": 250.0, "drive.delay": 0.004}, {"initial.rate_deg": (20.0, 0.0)}),
    "by a model": ({"drive": PD, "drive.kind": "computed_torque"}, {"initial.rate_deg": (20.0, 0.0)}),
    "locked": ({"drive": fl.Drive(), "link.b.joint": {"locked": True}}, {"initial.joint_deg": (-60.0, 50.0)}),
    "driven": ({"drive": PD}, {"drive.kp": (80.0, 20.0)}),
    "to a target": ({"drive": MOVE}, {}),
    "from a place": ({"drive": MOVE, "drive.reference.from_deg": (-60.0, 5.0)}, {}),
    "loaded": ({}, {"wrench": fl.Wrench(force=(9.0, 2.0, 3.0))}),
    "later": ({}, {"initial.time": 0.01}),
    "hardening": ({"link.a.joint": {"quadratic": 5.0, "hardening": 50.0}, "sensor": (GAUGE,)}, {}),
    "fixed": ({"run": fl.RunSettings(method="Gauss4", step=2e-4, sample=1e-3, duration=0.01)}, {}),
}


@compiled
@pytest.mark.parametrize("what", STARTED)
def test_runs_with_a_tolerance_that_share_an_arm_are_those_of_single_runs(what: str) -> None:
    changes, odd = STARTED[what]
    arm = members("z", 1)[0].varied({"run": fl.RunSettings(tolerance=1e-5, sample=1e-3, duration=0.02), **changes})
    starts = [{"initial.joint_deg": (-80.0 + 9 * k, 3.0 * k)} for k in range(6)]
    scenes = [arm.varied(start | (odd if k % 2 else {})) for k, start in enumerate(starts)]
    for threads in (1, 2):
        for scene, many in zip(scenes, fl.simulate_many(scenes, threads=threads), strict=True):
            one = fl.Problem(scene).simulate()
            for name in ("t", "q", "qd", "tau", "tip", "work"):
                np.testing.assert_array_equal(getattr(many, name), getattr(one, name), err_msg=name)


def test_runs_that_differ_in_their_start_are_prepared_once(monkeypatch) -> None:
    arm = members("z", 1)[0].varied({"drive": PD, "run": fl.RunSettings(tolerance=1e-4, duration=0.01)})
    built: list[fl.Scene] = []

    class Counted(SingleRun):
        def __init__(self, problem, *given, **named) -> None:
            built.append(problem.scene)
            super().__init__(problem, *given, **named)

    monkeypatch.setattr(sys.modules["flexlink.motion.single_run"], "SingleRun", Counted)
    fl.simulate_many([arm.varied({"initial.joint_deg": (-80.0 + k, 3.0)}) for k in range(5)])
    assert len(built) == 1


def test_a_diverging_batch_member_does_not_affect_its_neighbours() -> None:
    calm = driven().varied({"run.unstable": "allow"})
    wild = calm.varied({"initial": fl.InitialState(joint_deg=(0.0, 30.0), rate_deg=(1e120, 0.0))})
    with pytest.raises(fl.errors.DivergenceError) as caught:
        fl.simulate_many([calm, wild, calm])
    first, _, last = caught.value.runs
    for run in (first, last):
        np.testing.assert_allclose(run.q, fl.simulate(calm).q, rtol=1e-12, atol=1e-12)


def test_a_diverging_member_does_not_lose_the_results_of_others(models) -> None:
    paper = fl.load_scene(models / "paper_fig5.toml")
    fine = fl.RunSettings(step=1e-4, duration=0.05)
    runs = fine, fl.RunSettings(step=1e-3, duration=0.05, sample=1e-3, unstable="allow")
    good, wild = (paper.varied({"run": run}) for run in runs)
    with refused(fl.errors.DivergenceError, "diverged") as caught:
        fl.simulate_many([good, wild, good])
    runs = caught.value.runs
    assert [len(run.t) for run in runs] == [11, len(caught.value.trajectory.t), 11]
    np.testing.assert_array_equal(runs[2].q, fl.simulate(good).q)


def test_interrupted_batch_runs_keep_their_samples(monkeypatch) -> None:
    """The run is stopped after 100 of 500 steps, that is, 2 of 10 samples."""
    stop, advance, scenes = Stop(), Record.advance, members("yz", 10)

    def interrupted(*arguments):
        done = advance(*arguments)
        if done >= 100:
            stop.signal = signal.SIGINT
        return done

    monkeypatch.setattr(sys.modules["flexlink.motion.budget"], "BREATH", 0.0)  # one piece per step
    monkeypatch.setattr(Record, "advance", interrupted)
    monkeypatch.setattr(sys.modules["flexlink.motion.batch"], "deferred", lambda: contextlib.nullcontext(stop))
    with pytest.raises(fl.errors.InterruptedRunError) as caught:
        fl.simulate_many(scenes)
    assert (caught.value.signal, len(caught.value.runs)) == (signal.SIGINT, len(scenes))
    for scene, run in zip(scenes[:8], caught.value.runs, strict=False):
        rows = len(run.t)
        assert 3 <= rows < 11
        np.testing.assert_allclose(run.q, fl.simulate(scene).q[:rows], rtol=1e-12, atol=1e-12)
    assert [len(run.t) for run in caught.value.runs[8:]] == [1, 1]  # these runs had not begun


def test_batch_runs_with_an_energy_imbalance_are_errors_even_if_finite() -> None:
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    coarse = fl.RunSettings(step=0.35, sample=0.35, duration=35.0)
    scene = make_scene(rod, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)), run=coarse)
    with refused(fl.errors.DivergenceError, "energy-imbalance"):
        fl.simulate_many([scene, scene])
