"""Notes explain a probably unintended initial state; a divergence message names an unstable control loop."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.notes import notes
from tests.conftest import flexible, make_scene
from tests.support.words import refused, reviewed

DOWN = (0.0, -9.81, 0.0)
PD = {"kind": "pd", "kp": (2e4, 2e4), "kd": (1e3, 1e3), "target_deg": (0.0, 0.0)}


def arm(drive: Any = None, **fields: Any) -> fl.Scene:
    links = flexible("upper", segments=3), flexible("fore", segments=3)
    fields = {"gravity": DOWN, **fields}
    return make_scene(*links, drive=fl.Drive(**(drive or {})), **fields)


@pytest.mark.parametrize("gravity", ["static", "rigid", None])
def test_springs_initially_slack_under_feedforward_are_noted_with_the_tip_drop(gravity: str | None) -> None:
    law = {**PD, "gravity": gravity} if gravity else {**PD, "kind": "computed_torque"}
    (note,) = notes(arm(law))
    reviewed(note.id, note)
    assert "initial.passive" in note and "'static'" in note
    drop = float(re.search(r" (\S+) mm", note)[1])
    sagged = fl.initial_state(arm(initial=fl.InitialState(passive="static")), fl.lump(arm()))[0]
    tip = fl.tip_position(fl.lump(arm()), np.array([sagged, np.zeros(6)]))
    assert drop == pytest.approx(1e3 * np.linalg.norm(tip[0] - tip[1]), rel=0.05)
    assert notes(arm(law, initial=fl.InitialState(joint_deg=(0.0, 0.0), passive="static"))) == ()


@pytest.mark.parametrize("change", [{"gravity": (0.0, 0.0, 0.0)}, {"drive": fl.Drive(**PD)}])
def test_without_gravity_or_feedforward_there_is_no_note(change: dict[str, Any]) -> None:
    assert notes(arm({**PD, "gravity": "static"}).varied(change)) == ()


def test_gains_that_the_weight_overcomes_by_a_radian_are_noted() -> None:
    (note,) = notes(arm({**PD, "kp": (2e4, 30.0)}))
    assert note.id == "weak-drive" and "1719" in note  # 30 N m/deg
    reviewed(note.id, note)
    assert notes(arm({**PD, "kp": (2e4, 30.0), "gravity": "rigid"}, initial=fl.InitialState(passive="static"))) == ()


def test_a_target_of_a_locked_joint_is_noted() -> None:
    locked = {**PD, "kp": (2e4, 0.0), "kd": (1e3, 0.0), "target_deg": (0.0, 30.0)}
    (note,) = notes(arm(locked).varied({"link.fore.joint.locked": True}))
    assert note.id == "no-effect" and "target_deg" in note
    reviewed(note.id, note)


def test_an_undriven_falling_joint_next_to_a_driven_one_is_noted() -> None:
    (note,) = notes(arm({"kind": "constant", "torque": (200.0, 0.0)}))
    reviewed(note.id, note)
    assert "'constant'" in note and " fore" in note
    braked = arm({"kind": "constant", "torque": (200.0, 0.0)}).varied({"link.fore.joint.viscous": 1.0})
    assert notes(braked) == ()
    assert notes(arm()) == ()  # an arm without a drive is expected to fall


@pytest.mark.parametrize(("angle", "stable"), [(90.0, False), (-90.0, True)])
def test_an_initial_state_in_balance_is_noted(angle: float, stable: bool) -> None:
    (note,) = notes(arm(initial=fl.InitialState(joint_deg=(angle, 0.0))))
    assert ("unstable" in note) != stable
    reviewed(note.id, note)
    assert notes(arm(initial=fl.InitialState(joint_deg=(angle - 5.0, 0.0)))) == ()


@pytest.mark.slow
def test_advice_on_a_free_fall_recommends_a_drive() -> None:
    run = fl.RunSettings(duration=0.2, sample=0.01, step=0.01)
    found = fl.advise(arm(run=run), tip=0.05)
    (free_fall,) = (line for line in found.lines if "free fall" in line)
    reviewed("advice: free fall", free_fall)
    driven = arm({**PD, "gravity": "rigid"}, initial=fl.InitialState(joint_deg=(0.0, 0.0), passive="static"), run=run)
    assert "free fall" not in str(fl.advise(driven, tip="5mm"))


STIFF = {**PD, "kp": (1e6, 1e6), "kd": (3e4, 3e4), "rate": 200.0}


def test_divergence_of_an_unstable_sampled_law_names_its_rate() -> None:
    scene = arm(STIFF, initial=fl.InitialState(joint_deg=(5.0, 0.0)), run=fl.RunSettings(step=2e-5, duration=1.0))
    with refused(fl.errors.DivergenceError, "diverged") as caught:
        fl.simulate(scene)
    assert "200 Hz" in str(caught.value)
    assert "smaller step" not in str(caught.value)


def test_divergence_of_an_unstable_python_law_is_not_attributed_to_the_step() -> None:
    scene = arm(initial=fl.InitialState(joint_deg=(5.0, 0.0)), run=fl.RunSettings(step=2e-5, duration=1.0))
    active = fl.lump(scene).active

    def law(t: float, q: Any, qd: Any) -> Any:
        return -1e6 * q[active] - 3e4 * qd[active]

    with refused(fl.errors.DivergenceError, "diverged"):
        fl.simulate(scene, control=law, rate=200.0)
    simulator = fl.Simulator(scene)
    with refused(fl.errors.DivergenceError, "diverged"):
        for _ in range(200):
            simulator.step(law(*simulator.state), duration=5e-3)


def test_divergence_without_a_control_loop_recommends_a_smaller_step(models: Path) -> None:
    wild = fl.load_scene(models / "paper_fig5.toml").varied({"run": {"step": 1e-3, "unstable": "allow"}})
    with refused(fl.errors.DivergenceError, "diverged"):
        fl.simulate(wild)
