"""A problem that is prepared once: its runs are bit-equal to those of `simulate`, regardless of earlier runs."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.motion.inputs.problem import started_from
from tests.conftest import flexible, make_scene
from tests.motion.test_continued import DRIVES, MOTION, arm, law
from tests.support.words import refused

FIXED, IMPLICIT = {"run.step": 1e-4}, {"run.method": "Gauss4", "run.step": 2e-3}
STEPS: dict[str, dict[str, object]] = {
    "fixed": FIXED,
    "lu": {**FIXED, "run.solver": "lu"},
    "implicit": IMPLICIT,
    "tolerance": {"run.tolerance": 1e-4},
    "explicit with a tolerance": {"run.tolerance": 1e-4, "run.method": "DOP853"},
    "Radau5": {"run.tolerance": 1e-3, "run.method": "Radau5"},
}
WRENCH = fl.Wrench(times=(0.0, 0.03), forces=((0.0, 0.0, 0.0), (2.0, 1.0, 0.0)), frame="tip")


def same(one: fl.Trajectory, other: fl.Trajectory) -> None:
    """Check that two runs are bit-equal in samples, warnings and steps."""
    for name in ("t", "q", "qd", "tau", "tip", "work", "tip_wrench"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.energy.parts, other.energy.parts)
    assert (one.warnings, one.steps, one.scene) == (other.warnings, other.steps, other.scene)


def alone(scene: fl.Scene, **arguments: Any) -> fl.Trajectory:
    """A run that uses no cached preparation."""
    return fl.simulate(scene.varied({"name": scene.name}), **arguments)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("given", ["smooth", "computed, sampled", "motion", "wrench"])
def test_runs_of_a_problem_are_bit_equal_to_simulate_whatever_ran_before(given: str, steps: str) -> None:
    scene = arm(given if given in DRIVES else "linear", **{"run.unstable": "allow"}).varied(STEPS[steps])
    scene = scene.varied(
        {"motion": (MOTION,)} if given == "motion" else {"wrench": WRENCH} if given == "wrench" else {}
    )
    problem, first = fl.Problem(scene), alone(scene)
    q = first.q[0] + (0.0 if given == "motion" else 0.01)
    starts = [{}, {"q0": q}, {"qd0": 0.0 * q}, {"q0": first.q[3], "qd0": first.qd[3], "t0": float(first.t[3])}]
    for start in [*starts, {"duration": 0.03}, starts[1], {}]:
        same(problem.simulate(**start), alone(scene, **start))


@pytest.mark.parametrize("steps", ["fixed", "tolerance"])
def test_a_python_control_law_drives_a_problem_like_a_run(steps: str) -> None:
    scene = arm("none").varied(STEPS[steps])
    problem = fl.Problem(scene)
    for options in ({}, {"control": law, "rate": 500.0}, {}, {"control": law, "rate": 250.0}):
        same(problem.simulate(**options), alone(scene, **options))


def test_a_failed_run_does_not_affect_later_runs() -> None:
    scene = arm("pd").varied({"run.tolerance": 1e-5, "run.method": "Radau5"})
    wild = fl.Problem(scene.varied({"run.max_evaluations": 3000.0}))
    first = alone(wild.scene)
    with pytest.raises(fl.errors.EvaluationLimitError):
        wild.simulate(qd0=np.full(wild.chain.n, 200.0))
    same(wild.simulate(), first)


def test_a_problem_refuses_invalid_input_with_the_messages_of_simulate() -> None:
    scene = arm("none").varied(FIXED)
    problem, n = fl.Problem(scene), fl.lump(scene).n
    for wrong in ({"q0": np.zeros(n + 1)}, {"q0": np.full(n, np.nan)}, {"qd0": ["a"] * n}, {"t0": -1.0}, {"t0": 1.5e-4},
                  {"duration": 0.0123}, {"rate": 100.0}, {"progress": 3}, {"control": 3}):  # fmt: skip
        with pytest.raises(fl.FlexlinkError) as of_simulate:
            fl.simulate(scene, **wrong)
        with pytest.raises(type(of_simulate.value)) as of_problem:
            problem.simulate(**wrong)
        assert str(of_problem.value) == str(of_simulate.value)
    with refused(fl.errors.ArgumentError, "wrong-type"):
        fl.Problem(3)


def test_a_problem_refuses_a_reference_that_starts_elsewhere() -> None:
    reference = fl.Reference(profile="quintic", to_deg=(-60.0, 0.0), duration=0.05)
    scene = arm("none").varied({"drive": fl.Drive(kind="pd", kp=(40.0, 20.0), kd=(1.0, 0.5), reference=reference)})
    problem = fl.Problem(scene)
    with refused(fl.errors.SceneError, "missing-key"):
        problem.simulate(q0=np.zeros(problem.chain.n))


def test_stability_of_the_step_is_checked_at_every_start() -> None:
    """A string of point masses is stiffer, and its largest stable step shorter, the faster it turns."""
    scene = make_scene(flexible("a", segments=3), run=fl.RunSettings(step=1e-4, duration=0.01))
    step = 0.98 * fl.stable_step(fl.lump(scene))
    problem = fl.Problem(scene.varied({"run.step": step, "run.sample": step, "run.duration": 2 * step}))
    problem.simulate()
    with pytest.raises(fl.errors.UnstableStepError):
        problem.simulate(qd0=np.array([3e4, 0.0, 0.0]))
    problem.simulate()


def test_threads_may_share_a_problem() -> None:
    scene = arm("computed, sampled").varied({"run.tolerance": 1e-4})
    problem, rates = fl.Problem(scene), [np.full(fl.lump(scene).n, 0.1 * k) for k in range(6)]
    with ThreadPoolExecutor(3) as pool:
        runs = list(pool.map(lambda qd: problem.simulate(qd0=qd), rates))
    for qd, run in zip(rates, runs, strict=True):
        same(run, alone(scene, qd0=qd))


def test_copies_and_pickles_of_a_problem_give_equal_runs() -> None:
    problem = fl.Problem(arm("pd").varied({"run.tolerance": 1e-4}))
    first = problem.simulate()
    for other in (copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        same(other.simulate(), first)


def test_an_initial_state_from_arrays_equals_one_from_lists() -> None:
    scene = arm("none", **{"initial.passive": "static"})
    q, qd, t = np.linspace(0.1, 0.3, 6), np.linspace(-1.0, 1.0, 6), 0.01
    for start in ((q, None, None), (None, qd, None), (q, qd, t), (None, None, t)):
        lists = tuple(part if part is None or isinstance(part, float) else part.tolist() for part in start)
        assert started_from(scene, *start) == started_from(scene, *lists)
        assert started_from(scene, *start) != scene


def test_a_scene_is_prepared_once_unless_it_names_a_file(tmp_path, monkeypatch) -> None:
    """Cached data of a scene must not be used after the file of its method has changed."""
    file, scene = tmp_path / "mine.toml", arm("none")
    tableau = 'about = "Euler"\nsource = "-"\norder = 1\nc = ["0"]\nb = ["1"]\nA = [[]]\n'
    midpoint = 'about = "m"\nsource = "-"\norder = 2\nc = ["0", "1/2"]\nb = ["0", "1"]\nA = [[], ["1/2"]]\n'
    options = {"method": str(file), "step": 1e-5, "sample": 1e-3, "duration": 2e-3, "unstable": "allow"}
    file.write_text(tableau)
    one = fl.simulate(scene, **options)
    file.write_text(midpoint)
    assert np.abs(fl.simulate(scene, **options).q - one.q).max() > 0.0
    same(fl.simulate(scene, tolerance=1e-4), fl.simulate(scene, tolerance=1e-4))
    assert fl.simulate(scene, tolerance=1e-4).chain is fl.simulate(scene, tolerance=1e-4).chain
