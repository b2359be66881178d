"""Simulation: overrides, samples, drives, and diverging runs."""

import copy
import itertools
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.motion.adaptive_steps import AdaptiveSteps
from flexlink.motion.batch import outcomes
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.record import Record, trajectory_from_states
from tests.conftest import compiled, flexible, make_scene
from tests.support.words import refused, reviewed


@pytest.fixture
def paper(models) -> fl.Scene:
    return fl.load_scene(models / "paper_fig5.toml")


def test_a_trajectory_has_every_sample_and_the_initial_state(paper: fl.Scene) -> None:
    run = fl.simulate(paper, duration=0.05)
    assert run.t.tolist() == [pytest.approx(0.005 * k, rel=1e-15, abs=0) for k in range(11)]
    assert run.q.shape == run.qd.shape == (11, 10)
    assert run.tip.shape == (11, 3)
    np.testing.assert_array_equal(run.q[0], fl.initial_state(paper, run.chain)[0])
    np.testing.assert_array_equal(run.tip[-1], fl.tip_position(run.chain, run.q[-1]))
    assert run.energy.total[3] == fl.energy(run.chain, run.q[3], run.qd[3]).total
    with refused(ValueError, "test-simulate"):
        run.q[0, 0] = 1.0


def test_a_table_that_starts_late_holds_its_first_torque_until_then() -> None:
    """q̈ = τ/J with τ = 3 up to t = 1, then linearly to 5 at t = 2: q̇(2) = (3 + 4)/J and q̇(1) = 3/J."""
    drive = fl.Drive(kind="table", times=(1.0, 2.0), torques=((3.0,), (5.0,)))
    scene = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=2.0), gravity=(0, 0, 0), drive=drive)
    run = fl.simulate(scene, step=1e-2, duration=2.0, sample=0.5)
    assert run.qd[:, 0] == pytest.approx([0.0, 0.75, 1.5, 2.375, 3.5], rel=1e-12)
    assert run.tau[:, 0] == pytest.approx([3.0, 3.0, 3.0, 4.0, 5.0], rel=1e-15, abs=0)


DRIVES = {  # three links, the first one locked: torques on the other two at t = 0.5 s
    "constant": (fl.Drive(kind="constant", torque=(0.0, 1.0, 2.0)), (1.0, 2.0)),
    "table": (
        fl.Drive(kind="table", times=(0.1, 0.3, 0.7), torques=((0.0, 0.0, 0.0), (0.0, 1.0, 2.0), (0.0, 3.0, 8.0))),
        (2.0, 5.0),
    ),
    "pd": (
        fl.Drive(kind="pd", kp=(0.0, 5.0, 7.0), kd=(0.0, 2.0, 3.0), target_deg=(90.0, 10.0, 20.0)),
        (5.0 * np.radians(10 - 4) - 2.0 * np.radians(1), 7.0 * np.radians(20 - 8) - 3.0 * np.radians(-2)),
    ),
}


@pytest.mark.parametrize("kind", DRIVES)
def test_every_link_gets_its_own_drive_even_after_a_locked_one(kind: str) -> None:
    """The arm is so heavy that its rates stay 1 and −2 deg/s and its angles at 0.5 s are 4 and 8 degrees."""
    drive, wanted = DRIVES[kind]
    hub, locked = fl.RigidBody(inertia=(1e9, 1e9, 1e9)), fl.Joint(locked=True)
    links = [fl.Link(name="a", joint=locked), fl.Link(name="b", hub=hub), fl.Link(name="c", hub=hub)]
    start = fl.InitialState(joint_deg=(30.0, 3.5, 9.0), rate_deg=(0.0, 1.0, -2.0))
    run = fl.simulate(
        make_scene(*links, gravity=(0, 0, 0), drive=drive, initial=start), step=0.01, sample=0.5, duration=0.5
    )
    assert run.tau[-1] == pytest.approx(np.array(wanted), rel=1e-8)  # rates change slightly: 10 N m act on 1e9 kg m²


def test_a_run_that_diverges_stops_and_keeps_its_samples(paper: fl.Scene) -> None:
    with pytest.raises(fl.errors.DivergenceError) as caught:
        fl.simulate(paper, step=1e-3, sample=1e-3, unstable="allow")
    message, kept = str(caught.value), caught.value.trajectory
    for part in ("paper_fig5: ", "t = ", "0.001 s", f"{len(kept.t)} samples"):
        assert part in message
    assert kept.warnings[0].id == "unstable-step"
    assert "0.000491 s" in kept.warnings[0]
    assert len(kept.t) >= 2
    assert np.isfinite(kept.q).all()
    assert kept.q.shape == (len(kept.t), 10)


@pytest.mark.parametrize(
    ("override", "wanted"),
    [
        ({"step": -1.0}, "wrong-value"),
        ({"step": float("nan")}, "not-finite"),
        ({"method": "RK7"}, "unknown-name"),
        ({"solver": "magic"}, "wrong-value"),
        ({"duration": 1e300}, "not-a-multiple"),
    ],
)
def test_bad_overrides_are_refused(paper: fl.Scene, override: dict, wanted: str) -> None:
    with refused(fl.FlexlinkError, wanted):
        fl.simulate(paper, **override)


def test_progress_ends_at_one_and_only_grows(paper: fl.Scene) -> None:
    seen: list[float] = []
    fl.simulate(paper, progress=seen.append, duration=0.5)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_duration_of_zero_gives_the_initial_sample(paper: fl.Scene) -> None:
    assert len(fl.simulate(paper, duration=0.0).t) == 1


def test_saved_files_read_back_exactly(paper: fl.Scene, tmp_path) -> None:
    run = fl.simulate(paper, duration=0.02)
    archive = np.load(run.save(tmp_path / "run.npz"))
    for name in ("t", "q", "qd", "tip"):
        np.testing.assert_array_equal(archive[name], getattr(run, name))
    table = np.genfromtxt(run.save(tmp_path / "run.csv"), delimiter=",", skip_header=1)
    np.testing.assert_array_equal(table, np.column_stack(list(run.columns.values())))
    with refused(fl.errors.ArgumentError, "unknown-format"):
        run.save(tmp_path / "run.xlsx")


def test_a_failed_save_keeps_the_old_file_and_gives_the_reason(paper: fl.Scene, tmp_path) -> None:
    run = fl.simulate(paper, duration=0.01)
    with refused(fl.errors.OutputError, "cannot-write"):
        run.save(tmp_path / "no" / "run.npz")
    assert list(tmp_path.iterdir()) == []


def test_with_a_static_start_hinges_stay_at_rest_while_joints_are_held(models) -> None:
    scene = fl.load_scene(models / "t3_spatial.toml")
    held = fl.Scene(
        name="held", arm=scene.arm, wrench=scene.wrench,
        initial=fl.InitialState(joint_deg=scene.initial.joint_deg, passive="static"),
    )  # fmt: skip
    chain = fl.lump(held)
    q, qd = fl.initial_state(held, chain)
    passive = np.setdiff1d(np.arange(chain.n), chain.active)
    torque = fl.bias_torque(chain, q, qd, tip_wrench=held.tip_wrench) + fl.elastic_torque(chain, q)
    assert np.abs(torque[passive]).max() < 1e-9 * np.abs(torque).max()
    assert np.abs(q[passive]).max() > 1e-4
    np.testing.assert_array_equal(q[chain.active], np.radians(held.initial.joint_deg))


CLONES = [lambda one: pickle.loads(pickle.dumps(one)), copy.copy, copy.deepcopy]


@pytest.mark.parametrize("clone", CLONES)
@pytest.mark.parametrize("kind", [fl.Simulator, lambda scene: fl.SimulatorBatch([scene])], ids=["one", "batch"])
def test_a_simulator_is_not_copied_and_another_one_takes_over_its_state(kind, clone, paper: fl.Scene) -> None:
    """A copy would share arrays that compiled code changes, so a step of one would move the other."""
    arm = kind(paper)
    after = arm.step(duration=0.01)
    with refused(fl.errors.ArgumentError, "cannot-copy"):
        clone(arm)
    other = kind(paper)
    other.reset(q=after.q, qd=after.qd)
    moved = other.step(duration=0.01)
    np.testing.assert_array_equal(arm.state.q, after.q)
    np.testing.assert_array_equal(arm.step(duration=0.01).q, moved.q)


@pytest.mark.parametrize("clone", CLONES)
def test_copies_of_a_trajectory_and_of_its_columns_are_equal_and_read_only(clone, paper: fl.Scene) -> None:
    run = fl.simulate(paper, duration=0.01)
    twin, columns = clone(run), clone(run.columns)
    for array in (twin.t, twin.q, twin.qd, twin.tau, twin.tip, *vars(twin.energy).values()):
        assert not array.flags.writeable
    np.testing.assert_array_equal(twin.energy.total, run.energy.total)
    assert list(columns) == list(run.columns)
    for name, column in run.columns.items():
        assert np.array_equal(columns[name], column) and np.array_equal(twin.columns[name], column)
        assert repr(name) in repr(columns)


def test_from_states_does_not_modify_the_arrays_of_its_caller(paper: fl.Scene) -> None:
    chain = fl.lump(paper)
    q, qd = fl.initial_state(paper, chain)
    t, q, qd = np.zeros(1), q[None].copy(), qd[None].copy()
    run = trajectory_from_states(problem_of(paper), t, q, qd)
    for array in (t, q, qd):
        assert array.flags.writeable
    for array in (run.t, run.q, run.qd):
        assert not array.flags.writeable


def test_the_array_of_driven_joints_is_read_only(paper: fl.Scene) -> None:
    with refused(ValueError, "test-simulate"):
        fl.lump(paper).active[0] = 3


def test_every_quantity_of_a_run_has_a_unique_name(models, tmp_path) -> None:
    """This is checked in trajectory, columns and archive for a driven spatial arm with flexible links."""
    scene = fl.load_scene(models / "t3_spatial.toml")
    drive = fl.Drive(kind="constant", torque=tuple(float(k + 1) for k in range(len(scene.arm.links))))
    run = fl.simulate(scene.varied({"drive": drive}), step=1e-5, sample=1e-4, duration=2e-4)
    chain, last = run.chain, run.columns
    wanted = fl.energy(chain, run.q[-1], run.qd[-1])
    archive = np.load(run.save(tmp_path / "run.npz"))
    for name in ("kinetic", "gravity", "elastic"):
        for found in (getattr(run.energy, name), last[f"{name} [J]"], archive[name]):
            assert found[-1] == getattr(wanted, name)
    assert len({*vars(wanted).values()}) == 3
    np.testing.assert_array_equal(archive["tau"], run.tau)
    for k in chain.active:
        assert last[f"tau {chain.joint_name(int(k))} [N m]"][-1] == drive.torque[chain.coordinate(int(k)).link - 1]
    assert [last[f"tip {axis} [m]"][-1] for axis in "xyz"] == fl.tip_position(chain, run.q[-1]).tolist()


def satellite(spin: float, **changes: Any) -> fl.Scene:
    """A free body with a flexible panel and an arm, rotating at `spin` [rad/s], for which some steps are too long."""
    links = (
        flexible("panel", "yz", 2, joint=fl.Joint(locked=True), length=1.0, section="thin", lumping="midpoint"),
        fl.Link(name="arm", on="base", length=0.8, material="aluminium", section="thin"),
    )
    arm = fl.Arm(
        links=links, materials={"aluminium": fl.Material(young=7e9, density=1500.0)},
        sections={"thin": fl.Section(shape="rectangle", height=0.012, width=0.03)}, tip=fl.RigidBody(mass=0.5),
        base=fl.Base(kind="free", mass=8.0, center=(0.02, -0.01, 0.03), inertia=(0.4, 0.6, 0.7)),
    )  # fmt: skip
    direction = np.array([0.15, 0.94, 0.3]) * np.degrees(spin)
    base = fl.details.BaseState(velocity=(0.1, -0.2, 0.05), spin_deg=(direction[0], direction[1], direction[2]))
    start = fl.InitialState(joint_deg=(0.0, 20.0), rate_deg=(0.0, 50.0), base=base)
    return fl.Scene(name="satellite", arm=arm, initial=start, gravity=(0.0, 0.0, 0.0)).varied(
        {"run.duration": 0.4, "run.sample": 0.04, **changes}
    )


FIXED = list(itertools.product(("Gauss4", "Gauss6", "Radau5", "Radau9"), (2.0, 10.0), (0.04, 0.01)))


@compiled
@pytest.mark.parametrize(("method", "spin", "step"), FIXED)
def test_a_free_base_in_implicit_steps_reaches_its_end_or_fails_with_a_reason(method, spin, step) -> None:
    try:
        run = fl.simulate(satellite(spin), method=method, step=step)
    except fl.errors.DivergenceError as error:
        assert error.id in {"diverged", "newton-failed"}
        reviewed("diverged: Newton's iteration", str(error), values=False)
        return
    assert run.t[-1] == 0.4
    assert run.steps is not None and run.steps.taken >= round(0.4 / step)


@compiled
@pytest.mark.slow
def test_subdivided_steps_of_a_fast_rotating_body_follow_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Full steps are made to fail, so that they are subdivided; the base rotates far even within half steps."""
    exact = fl.simulate(satellite(10.0), method="DOP853", tolerance=1e-10)
    take, turns = AdaptiveSteps.take, []

    def in_parts_only(steps: AdaptiveSteps, most: int) -> int:
        if most and steps.settings[-1] == steps.run.fixed_step:
            return int(OUTCOME.stuck)
        how = take(steps, most)
        turns.append(how == OUTCOME.turned)
        return how

    monkeypatch.setattr(AdaptiveSteps, "take", in_parts_only)
    run = fl.simulate(satellite(10.0), method="Gauss6", step=0.01)
    assert sum(turns) >= 5
    assert run.t[-1] == 0.4
    assert np.abs(run.tip - exact.tip).max() < 1e-6
    arm = fl.Simulator(satellite(10.0, **{"run.method": "Gauss6", "run.step": 0.01}))
    for k in range(1, 11):
        state = arm.step(duration=0.04)
        assert np.abs(fl.tip_position(arm.chain, state.q) - exact.tip[k]).max() < 1e-6


def pendulum(**changes: Any) -> fl.Scene:
    """A double pendulum of rigid links."""
    rods = [fl.Link(name=name, length=1.0, material="aluminium", section="square") for name in "ab"]
    scene = make_scene(*rods, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(50.0, 20.0)))
    return scene.varied({"run.duration": 0.1, "run.sample": 0.01, "run.step": 1e-3, **changes})


def no_torque(_t: float, _q: np.ndarray, _qd: np.ndarray) -> np.ndarray:
    """Control law without torque."""
    return np.zeros(2)


TOLERANCE = {"run.step": None, "run.tolerance": 1e-6, "run.method": "Radau5"}
IMPLICIT = {"run.method": "Gauss6"}


def stepped(scene: fl.Scene) -> fl.Simulator:
    """A simulator after 0.1 s."""
    arm = fl.Simulator(scene)
    arm.step(duration=0.1)
    return arm


def first_of(ended: list[Any]) -> fl.Trajectory:
    """Return the first outcome, or raise it if it is an error."""
    if isinstance(ended[0], Exception):
        raise ended[0]
    assert isinstance(ended[0], fl.Trajectory)
    return ended[0]


RUNS: dict[str, Callable[[], object]] = {
    "fixed explicit": lambda: fl.simulate(pendulum()),
    "fixed implicit": lambda: fl.simulate(pendulum(**IMPLICIT)),
    "tolerance": lambda: fl.simulate(pendulum(**TOLERANCE)),
    "law": lambda: fl.simulate(pendulum(), control=no_torque, rate=100.0),
    "law, implicit": lambda: fl.simulate(pendulum(**IMPLICIT), control=no_torque, rate=100.0),
    "problem": lambda: fl.Problem(pendulum()).simulate(),
    "side by side": lambda: fl.simulate_many([pendulum(), pendulum()]),
    "member of a sweep": lambda: first_of(outcomes([pendulum(**TOLERANCE)], Stop())),
    "members of a sweep": lambda: first_of(outcomes([pendulum(), pendulum()], Stop())),
    "Simulator, explicit": lambda: stepped(pendulum()),
    "Simulator, implicit": lambda: stepped(pendulum(**IMPLICIT)),
    "Simulator, tolerance": lambda: stepped(pendulum(**TOLERANCE)),
}


@compiled
@pytest.mark.parametrize("kind", RUNS)
def test_a_run_that_stops_early_without_a_reason_is_an_error(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    RUNS[kind]()  # a complete run is not an error
    take, go = AdaptiveSteps.take, Record.advance

    def half_way(steps: AdaptiveSteps, most: int) -> int:
        return int(OUTCOME.ended) if most and steps.tries >= 2 else take(steps, min(most, 2))

    def some(record: Record, integrate: Any, fixed: Any, first: int, stop: int, rest: Any) -> int:
        return go(record, integrate, fixed, first, min(stop, 50), rest)

    monkeypatch.setattr(AdaptiveSteps, "take", half_way)
    monkeypatch.setattr(Record, "advance", some)
    with pytest.raises(fl.errors.DivergenceError) as caught:
        RUNS[kind]()
    assert caught.value.id == ("diverged" if kind == "Simulator, explicit" else "ended-early")
    reviewed(f"ends early: {kind}", str(caught.value), values=False)


@compiled
def test_a_run_never_reads_unwritten_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """All unwritten memory is set to NaN, which would change the results."""
    scene = pendulum(**{"run.duration": 3.0, "run.step": 0.05, "run.sample": 0.1, **IMPLICIT})
    before, empty = fl.simulate(scene), np.empty

    def never_read(*arguments: Any, **named: Any) -> np.ndarray:
        array = empty(*arguments, **named)
        if array.dtype == float:
            array.fill(np.nan)
        return array

    monkeypatch.setattr(np, "empty", never_read)
    again = fl.simulate(scene)
    assert again.warnings == before.warnings
    assert np.array_equal(again.tip, before.tip)


@compiled
@pytest.mark.slow
def test_the_spin_of_a_free_body_is_conserved_in_implicit_steps() -> None:
    """The spin is constant within the rounding of all steps; Newton residuals would add up to fifty times as much."""
    for method in ("Gauss6", "Radau9"):
        run = fl.simulate(satellite(1.0), method=method, step=0.002, sample=0.2, duration=6.0)
        assert run.base is not None
        spin = np.linalg.norm(run.base.momentum.spin - run.base.momentum.spin[0], axis=1)
        assert spin.max() < 1e-12 * np.linalg.norm(run.base.momentum.spin[0])
