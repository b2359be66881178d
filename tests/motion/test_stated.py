"""A run with a tolerance keeps it or states that it does not; its stated error is near the true one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.results.tip_motion import apart
from tests.conftest import compiled, flexible, make_scene

pytestmark = compiled
SOFT = fl.Section(shape="rectangle", height=0.04, width=0.003)


def robot(**drive: object) -> fl.Scene:
    """Two links, the first stiff: modes of about 200 Hz are seen by the rates that a law of 200 Hz reads."""
    links = flexible("upper", segments=4), fl.Link(name="fore", length=0.5, material="aluminium", section="square")
    scene = make_scene(*links, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(-60.0, 40.0)))
    law = {"kind": "pd", "kp": (600.0, 60.0), "kd": (60.0, 6.0), "target_deg": (30.0, -40.0)}
    run = fl.RunSettings(duration=1.0, sample=0.01)
    return scene.varied({"tip.mass": 2.0, "drive": fl.Drive(**{**law, "rate": 200.0, **drive}), "run": run})


def stiff_and_free() -> fl.Scene:
    """Two undamped strips of aluminium, free after a torque of 0.8 s: an error of a rate becomes a drift."""
    links = [
        fl.Link(
            name=name, length=length, material="aluminium", section="strip", flex="z", segments=5,
            joint=fl.Joint(armature=rotor), end=fl.RigidBody(mass=mass),
        )
        for name, length, rotor, mass in (("upper", 0.6, 0.01, 0.8), ("fore", 0.5, 0.003, 0.3))
    ]  # fmt: skip
    arm = fl.Arm(
        links=tuple(links), materials={"aluminium": fl.Material(young=70e9, density=2700.0)}, sections={"strip": SOFT}
    )
    drive = fl.Drive(kind="table", times=(0.0, 0.4, 0.8), torques=((1.0, 0.25), (-1.0, -0.25), (0.0, 0.0)), hold=True)
    return fl.Scene(
        name="free", arm=arm, gravity=(0.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(0.0, 60.0)), drive=drive,
        run=fl.RunSettings(duration=2.0, sample=0.02),
    )  # fmt: skip


def true_error(run: fl.Trajectory, truth: fl.Trajectory) -> float:
    """Largest error of the tip, in tolerances."""
    assert run.stated is not None
    return float(apart(run.tip, truth.tip).max() / run.stated.allowed)


def truth_of(scene: fl.Scene, **settings: Any) -> fl.Trajectory:
    """A run by explicit steps, which damp nothing."""
    return fl.simulate(scene, method="DOP853", relative_tolerance=1e-10, **settings)


@pytest.mark.parametrize("scene", [robot(), robot(kd=(40.0, 4.0), rate=100.0), stiff_and_free()])
def test_a_run_keeps_its_tolerance_and_states_its_error(scene: fl.Scene) -> None:
    truth = truth_of(scene)
    for tolerance in (1e-3, 1e-4, 1e-5):
        run = fl.simulate(scene, relative_tolerance=tolerance)
        error = true_error(run, truth)
        assert error <= 3.0
        assert run.stated is not None and run.error is not None and run.error.shape == run.t.shape
        if error > 0.1:
            assert 0.2 < run.error.max() / (run.stated.allowed * error) < 5.0
        assert run.kept == (run.error.max() <= run.stated.allowed)
        assert str(run.stated) in str(run)
        late = run.stated._replace(tip=np.array([0.0, 2.0, 0.5]) * run.stated.allowed)
        assert not replace(run, stated=late).kept


def test_a_law_in_python_also_reads_vibrations() -> None:
    scene = robot()
    law = scene.drive
    kp, kd, target = (np.array(each) for each in (law.kp, law.kd, np.radians(law.target_deg)))
    bare, chain = scene.varied({"drive": None}), fl.lump(scene)

    def control(_t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return np.asarray(kp * (target - q[chain.active]) - kd * qd[chain.active])

    truth = truth_of(bare, control=control, rate=200.0)
    run = fl.simulate(bare, relative_tolerance=1e-4, control=control, rate=200.0)
    assert true_error(run, truth) <= 3.0


def test_fixed_steps_state_no_error() -> None:
    run = fl.simulate(robot(), method="Radau5", step=5e-3, sample=0.01)
    assert (run.error, run.kept, run.errors, str(run)) == (None, None, {}, repr(run))


def test_a_motion_in_pieces_carries_its_travel_and_its_error(tmp_path: Path) -> None:
    scene = stiff_and_free()
    truth = truth_of(scene)
    half = fl.simulate(scene, relative_tolerance=1e-4, duration=1.0)
    stored = fl.Trajectory.load(half.save(tmp_path / "half.npz"))
    rests = [fl.simulate(scene, relative_tolerance=1e-4, duration=1.0, after=run) for run in (half, stored)]
    assert np.array_equal(rests[0].tip, rests[1].tip)
    assert np.array_equal(rests[0].error, rests[1].error)
    for run in rests:
        assert run.stated is not None and half.stated is not None and stored.stated is not None
        assert str(stored.stated) == str(half.stated)
        assert run.stated.travelled > half.stated.travelled
        assert run.stated.start[0] == 0.0
        error = float(apart(run.tip, truth.tip[50:]).max() / run.stated.allowed)
        assert error <= 3.0 or run.warnings
        assert error <= 1.0 or not run.kept


def test_a_simulator_states_its_error_and_warns() -> None:
    scene = robot().varied({"run.relative_tolerance": 1e-4})
    arm, other = fl.Simulator(scene), fl.Simulator(scene)
    truth, off = truth_of(scene, sample=0.01), 0.0
    for k in range(1, 51):
        after = arm.step(duration=0.01)
        other.step(duration=0.01)
        off = max(off, float(np.linalg.norm(fl.tip_position(arm.chain, after.q) - truth.tip[k])))
        if k % 20 == 0:
            assert other.error is not None
    assert arm.error == other.error  # whenever a program asks
    assert off <= max(3e-4 * arm.chain.size, 3.0 * arm.error) or arm.warnings
    assert fl.Simulator(robot().varied({"run": fl.RunSettings(step=1e-5, sample=0.01)})).error is None


def test_sensors_of_a_default_run_are_within_their_stated_errors() -> None:
    sensors = (
        fl.Sensor(name="gauge", kind="strain", link="upper", x=0.1, fibre=(0.01, 0.0)),
        fl.Sensor(name="gyro", kind="gyroscope", link="upper", axis=(0.0, 0.0, 1.0)),
    )
    scene = robot(rate=None).varied({"sensor": sensors})
    run, truth = fl.simulate(scene), truth_of(scene)
    assert list(run.errors) == list(run.sensor_names)
    for name in run.sensor_names:
        off = np.abs(run.readings[name] - truth.readings[name])
        assert off.max() <= 3.0 * run.errors[name].max()
        assert off.max() <= 0.02 * np.abs(truth.readings[name]).max()


def test_loads_of_a_run_that_did_not_follow_vibrations_warn_and_name_the_remedy() -> None:
    scene = robot(rate=None)
    with pytest.warns(RuntimeWarning, match="outputs"):
        assert fl.simulate(scene).loads.moment.shape[0] == 101
    run = fl.simulate(scene.varied({"run.outputs": ("loads", "torques")}))
    truth = truth_of(scene.varied({"run.outputs": ("loads",)}))
    off = np.abs(run.loads.moment - truth.loads.moment).max()
    moment, _force, _torque = run.errors.values()
    assert off <= 3.0 * moment.max()


def test_a_tolerance_keeps_a_method_that_can_meet_it() -> None:
    tighter = {"run.relative_tolerance": 1e-3}
    scene = robot().varied({"run": fl.RunSettings(method="Radau9")})
    assert scene.varied(tighter).run.method == "Radau9"
    fixed = scene.varied({"run": fl.RunSettings(method="RK4", step=1e-5)})
    assert fixed.varied(tighter).run.method == "auto"
