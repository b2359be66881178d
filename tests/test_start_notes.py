"""A scene that starts otherwise than meant is told why and what to change; an unstable loop is not the step's fault."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import flexible, make_scene

import flexlink as fl
from flexlink.dynamics.notes import notes
from tests.words import refused

DOWN = (0.0, -9.81, 0.0)
PD = {"kind": "pd", "kp": (2e4, 2e4), "kd": (1e3, 1e3), "target_deg": (0.0, 0.0)}


def arm(drive: Any = None, **fields: Any) -> fl.Scene:
    links = flexible("upper", segments=3), flexible("fore", segments=3)
    fields = {"gravity": DOWN, **fields}
    return make_scene(*links, drive=fl.Drive(**(drive or {})), **fields)


@pytest.mark.parametrize("gravity", ["static", "rigid", None])
def test_springs_that_start_slack_under_a_feedforward_are_told_with_the_drop(gravity: str | None) -> None:
    law = {**PD, "gravity": gravity} if gravity else {**PD, "kind": "computed_torque"}
    (note,) = notes(arm(law))
    assert "the springs start slack while drive." in note
    assert note.endswith("take initial.passive = 'static'")
    drop = float(note.split("about ")[1].split(" mm")[0])
    sagged = fl.initial_state(arm(initial=fl.InitialState(passive="static")), fl.lump(arm()))[0]
    tip = fl.tip_position(fl.lump(arm()), np.array([sagged, np.zeros(6)]))
    assert drop == pytest.approx(1e3 * np.linalg.norm(tip[0] - tip[1]), rel=0.05)
    assert notes(arm(law, initial=fl.InitialState(joint_deg=(0.0, 0.0), passive="static"))) == ()


@pytest.mark.parametrize("change", [{"gravity": (0.0, 0.0, 0.0)}, {"drive": fl.Drive(**PD)}])
def test_without_gravity_or_feedforward_there_is_nothing_to_tell(change: dict[str, Any]) -> None:
    assert notes(arm({**PD, "gravity": "static"}).varied(change)) == ()


def test_a_joint_that_falls_beside_one_that_is_driven_is_told() -> None:
    (note,) = notes(arm({"kind": "constant", "torque": (200.0, 0.0)}))
    assert note.startswith("drive.kind = 'constant': nothing drives or brakes fore, which gravity makes fall; give")
    braked = arm({"kind": "constant", "torque": (200.0, 0.0)}).varied({"link.fore.joint.viscous": 1.0})
    assert notes(braked) == ()
    assert notes(arm()) == ()  # all of it falls: that is what was asked for


@pytest.mark.parametrize(("angle", "how"), [(90.0, "stands in unstable balance"), (-90.0, "is in balance, and stays")])
def test_an_arm_that_starts_in_balance_is_told(angle: float, how: str) -> None:
    (note,) = notes(arm(initial=fl.InitialState(joint_deg=(angle, 0.0))))
    assert f"the arm {how}" in note
    assert notes(arm(initial=fl.InitialState(joint_deg=(angle - 5.0, 0.0)))) == ()


@pytest.mark.slow
def test_advice_on_a_free_fall_says_that_it_is_one() -> None:
    run = fl.RunSettings(duration=0.2, sample=0.01, step=0.01)
    found = fl.advise(arm(run=run), tip=0.05)
    assert "none: this is a free fall; give the scene its drive" in str(found)
    held = arm({**PD, "gravity": "rigid"}, initial=fl.InitialState(joint_deg=(0.0, 0.0), passive="static"), run=run)
    assert "free fall" not in str(fl.advise(held, tip="5mm"))


STIFF = {**PD, "kp": (1e6, 1e6), "kd": (3e4, 3e4), "rate": 200.0}


def test_an_unstable_sampled_law_is_not_blamed_on_the_step() -> None:
    scene = arm(STIFF, initial=fl.InitialState(joint_deg=(5.0, 0.0)), run=fl.RunSettings(step=2e-5, duration=1.0))
    with pytest.raises(fl.errors.DivergenceError) as caught:
        fl.simulate(scene)
    assert "the control loop is unstable at drive.rate = 200 Hz" in str(caught.value)
    assert "smaller step" not in str(caught.value)


def test_an_unstable_law_in_python_is_not_blamed_on_the_step() -> None:
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


def test_a_run_without_a_loop_still_advises_a_smaller_step(models: Path) -> None:
    wild = fl.load_scene(models / "paper_fig5.toml").varied({"run": {"step": 1e-3, "unstable": "allow"}})
    with refused(fl.errors.DivergenceError, "diverged"):
        fl.simulate(wild)
