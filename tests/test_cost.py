"""What a second of motion is said to cost is what it costs."""

from __future__ import annotations

import time

import numpy as np
import pytest
from conftest import flexible, make_scene

import flexlink as fl
from flexlink.dynamics.vibration.stability import fastest_eigenvalues
from flexlink.motion.cost import cost, evaluation_time, step_time


def test_a_cost_is_stages_a_step_times_the_time_of_an_evaluation() -> None:
    λ = np.array([1000j, -1000j])
    rk4, rk10 = cost("RK4", λ, 1e-6, planar=True), cost("RK10", λ, 1e-6, planar=True)
    assert rk4.step == pytest.approx(2.828427522e-3)
    assert rk4.seconds == pytest.approx(4 * 1e-6 / 2.828427522e-3)
    assert rk10.seconds == pytest.approx(17 * 1e-6 / 1.188515114e-3)
    assert cost("Radau5", λ, 1e-6, planar=True).step == np.inf
    assert np.isnan(cost("Radau5", λ, 1e-6, planar=True).seconds)


@pytest.mark.slow
@pytest.mark.parametrize("flex", ["z", "xyz"])
def test_a_run_takes_the_time_that_was_predicted(flex: str) -> None:
    """Within a factor of three: the run also judges its samples, and other programs share core and caches."""
    scene = make_scene(flexible("a", flex, 12), initial=fl.InitialState(joint_deg=(30.0,)))
    chain = fl.lump(scene)
    λ, evaluation = fastest_eigenvalues(chain, np.zeros(chain.n)), evaluation_time(scene, chain)
    step, seconds = cost("RK4", λ, evaluation, planar=chain.is_planar)
    samples, steps = 10, 2000
    fl.simulate(scene, step=step / 2, sample=step, duration=step)  # compiles
    started = time.thread_time()
    fl.simulate(scene, step=step / 2, sample=steps / samples * step / 2, duration=steps * step / 2)
    taken = time.thread_time() - started
    # what a run does once, however long it is: lump, judge the step
    started = time.thread_time()
    fl.simulate(scene, step=step / 2, sample=step / 2, duration=samples * step / 2)
    taken -= time.thread_time() - started
    assert 1 / 3 < taken / steps / (seconds * step) < 3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tolerance"), [("t3_spatial", 1e-4), ("paper_fig5", 1e-6)])  # some hundred steps
def test_an_implicit_step_takes_about_the_time_that_was_predicted(models, name: str, tolerance: float) -> None:
    """Within a factor of four: two for the passes of Newton's iteration, and two for other programs beside it."""
    scene = fl.load_scene(models / f"{name}.toml")
    chain = fl.lump(scene)
    predicted = step_time("Radau5", evaluation_time(scene, chain), planar=chain.is_planar)
    run = {"method": "Radau5", "relative_tolerance": tolerance, "sample": 0.1}
    short, long = (scene.varied({"run": run | {"duration": duration}}) for duration in (0.1, 1.0))
    fl.simulate(short)  # compiles
    times, steps = [], []
    for part in (short, long):
        started = time.thread_time()
        steps.append(fl.simulate(part).steps.taken)
        times.append(time.thread_time() - started)
    assert 1 / 4 < (times[1] - times[0]) / (steps[1] - steps[0]) / predicted < 4


@pytest.mark.parametrize(("planar", "least", "most"), [(True, 2.7, 6.8), (False, 4.9, 15.0)])
def test_a_stage_of_an_implicit_step_costs_what_was_measured_of_the_trade_s_scenes(
    planar: bool, least: float, most: float
) -> None:
    stages = 3  # of Radau5
    assert least < step_time("Radau5", 1e-6, planar=planar) / (stages * 1e-6) < most
