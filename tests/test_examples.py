"""Every script in `examples/` runs, is short, and shows what it says."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

import flexlink as fl

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def figures(name: str) -> dict[str, Any]:
    """What a script has computed, by the names that it gives."""
    return runpy.run_path(str(ROOT / "examples" / f"{name}.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_tested_and_named_in_the_readme(path: Path) -> None:
    longest = {"gym_environment": 50}.get(path.stem, 40)  # a class, with the methods that Gymnasium asks for
    assert len(path.read_text(encoding="utf-8").splitlines()) <= longest
    assert f'figures("{path.stem}")' in Path(__file__).read_text(encoding="utf-8")
    assert f"examples/{path.name}" in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_input_shaping_leaves_a_twentieth_of_the_vibration() -> None:
    found = figures("ptp_move")
    left, settled = found["left"], found["settled"]
    assert left["unshaped"] > 5e-3, "there is something to be shaped away"
    assert left["ZVD"] < left["ZV"] < 0.05 * left["unshaped"]
    assert settled["ZV"] < settled["ZVD"] < 2.0 < settled["unshaped"] < np.inf
    assert not any(run.warnings for run in found["runs"].values())
    own = found["move"].shaper
    np.testing.assert_allclose(own.frequency_hz, np.abs(found["slow"]) / (2 * np.pi), rtol=1e-4)
    np.testing.assert_allclose(own.damping, -found["slow"].real / np.abs(found["slow"]), rtol=2e-3)


@pytest.mark.slow
def test_computed_torque_is_exact_on_the_rigid_arm_but_for_its_sampling() -> None:
    """A held torque is half a sample late: ë + kd ė + kp e = jerk/(2 rate), jerk ≤ 60 |goal − start|/s³."""
    found = figures("computed_torque")
    (rigid, _), (bending, away) = found["found"]["rigid"], found["found"]["bending"]
    scene, (goal, _, _) = found["bending"], found["reference"](1.0)
    start = np.radians(scene.initial.joint_deg)
    late = 60.0 * np.abs(goal - start).max() / (2 * scene.drive.rate * scene.drive.kp[0])
    assert 0.1 * late < rigid < late
    assert bending > 10 * rigid
    there = scene.varied({"initial.joint_deg": tuple(np.degrees(goal)), "drive": fl.Drive()})
    chain = fl.lump(there)
    bent = fl.tip_position(chain, fl.initial_state(there, chain)[0])
    sag = np.linalg.norm(bent - fl.tip_position(found["model"], goal))
    assert sag / 2 < away[-1] < 2 * sag, "the rigid model knows nothing of it"


@pytest.mark.slow
def test_poles_of_the_regulated_nonlinear_arm_are_those_of_the_linear_model() -> None:
    """What is left is the integrator's, |λh|⁴/120 of RK4, largest for the fastest pole: far below the 1 % asked for."""
    found = figures("lqr")
    designed, poles, step = found["designed"], found["poles"], found["scene"].run.step
    fastest = np.abs(designed).max() * step
    assert designed.real.max() < 0, "stable"
    for one, other in ((designed, poles), (poles, designed)):
        assert np.all(np.abs(one[:, None] - other).min(axis=1) < np.minimum(0.01, fastest**4 / 60) * np.abs(one))
    assert found["away"][-1] < 1e-3 * found["away"][0], "and far from there"
    assert not found["far"].warnings


def test_an_elastic_gear_swings_as_the_closed_form_says() -> None:
    """RK10's own error, (ωh)¹¹ a step, is below rounding: that of the rates, ε twist ω a step, carried to the end."""
    found = figures("two_mass_joint")
    assert found["free"] == pytest.approx(found["omega"], rel=1e-12)
    assert found["held"] == pytest.approx(np.sqrt(found["k"] / found["inertia"]), rel=1e-12)
    t, rates = found["run"].t, found["twist"] * found["omega"]
    assert found["error"] < len(t) * np.finfo(float).eps * rates * t[-1]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*Box observation space")  # joints may turn without end
def test_the_arm_is_an_environment_of_gymnasium() -> None:
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    found = figures("gym_environment")
    env = found["ArmEnv"]()
    checker.check_env(env, skip_render_check=True)
    chain = env.arm.chain
    most = np.abs(fl.gravity_torque(chain, np.zeros(chain.n))[chain.active]).max(initial=0.0)
    assert 2.0 * most < found["EFFORT"].max(), "what gravity takes of the stretched arm"
    first, _ = env.reset(seed=7)
    assert np.linalg.norm(first[-6:-3] - first[-3:]) > 0.1
    rewards, ended = [], False
    while not ended:
        _, q, qd = env.arm.state
        hold = fl.gravity_torque(chain, q)[chain.active] - 50.0 * qd[chain.active]
        _, reward, lost, ended, _ = env.step(hold / found["EFFORT"])
        rewards.append(reward)
        assert not lost
    assert len(rewards) == round(found["EPISODE"] / found["PERIOD"])
    assert rewards[-1] == pytest.approx(rewards[0], abs=0.02), "gravity is held, and nothing else moves the arm"
