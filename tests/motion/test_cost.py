"""Predicted CPU times agree with measured ones."""

import re
import time
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.common.interruption import Stop
from flexlink.motion import evaluation_cost
from flexlink.motion.evaluation_cost import (
    machine_factor,
    operation_costs,
    parts_of,
    run_cost,
    step_cost,
)
from flexlink.motion.inputs.drives import held_torques
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.conftest import flexible, make_scene
from validation.speed import cost_list


def chain_of(flex: str, segments: int = 12) -> Chain:
    return fl.lump(make_scene(flexible("a", flex, segments)))


def test_the_cost_table_has_the_header_that_its_program_writes() -> None:
    text = (Path(evaluation_cost.__file__).parent / "data" / "evaluation_costs.toml").read_text()
    head, _ = text.split("\n\n", 1)
    date = re.search(r"Measured on (\S+) by", head)
    seeds = re.search(r"cost_list (\d+)", head)
    assert date and seeds
    assert head == cost_list.HEAD.format(date=date[1], seeds=seeds[1])


def test_the_cost_of_a_step_is_the_sum_over_its_stages() -> None:
    chain = chain_of("z")
    evaluation = run_cost(chain, "RK4", 1)
    assert step_cost(chain, "RK4") == pytest.approx(4 * evaluation)
    assert step_cost(chain, "RK10") == pytest.approx(17 * evaluation)


def test_the_machine_factor_is_the_ratio_of_measured_to_tabulated_time(monkeypatch) -> None:
    scene = make_scene(flexible("a", "z", 12))
    chain = fl.lump(scene)
    monkeypatch.setattr("flexlink.motion.evaluation_cost.evaluation_time", lambda *_: 3 * run_cost(chain, "RK2", 1))
    assert machine_factor(problem_of(scene)) == pytest.approx(3.0)


def test_a_sampled_law_costs_per_step_start_and_a_continuous_law_per_stage() -> None:
    law = {"kind": "computed_torque", "kp": (1.0,), "kd": (1.0,), "target_deg": (0.0,)}
    stage, sampled = (problem_of(make_scene(flexible("a", "z", 3), drive=fl.Drive(**law, **more)))
                      for more in ({}, {"rate": 100.0}))  # fmt: skip
    alone = operation_costs(stage.chain, explicit=True)
    per_stage = operation_costs(stage.chain, explicit=True, drive=stage.inputs.drive)
    held = operation_costs(stage.chain, explicit=True, drive=sampled.inputs.drive)
    assert alone[0] == held[0] < per_stage[0]
    assert alone[2] == per_stage[2] < held[2]


def test_constant_external_torques_add_no_predicted_cost() -> None:
    chain = chain_of("z", 3)
    held = held_torques(chain, np.zeros(1), np.zeros((1, 1)), np.full(1, np.inf))
    assert parts_of(chain, held).tolist() == parts_of(chain, None).tolist()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tolerance"), [("t3_spatial", 1e-4), ("paper_fig5", 1e-6)])  # a few hundred steps
def test_an_implicit_step_takes_about_the_predicted_time(models, name: str, tolerance: float) -> None:
    """A factor of four is allowed: two for the number of Newton iterations, times two for other running programs."""
    scene = fl.load_scene(models / f"{name}.toml")
    chain = fl.lump(scene)
    predicted = machine_factor(problem_of(scene)) * step_cost(chain, "Radau5")
    run = {"method": "Radau5", "relative_tolerance": tolerance, "sample": 0.1}
    short, long = (scene.varied({"run": run | {"duration": duration}}) for duration in (0.1, 1.0))
    fl.simulate(short)  # compiles the kernels, before the timing
    times, steps = [], []
    for part in (short, long):
        started = time.thread_time()
        steps.append(SingleRun(problem_of(part)).finish(Stop(), compared=False).steps.taken)
        times.append(time.thread_time() - started)
    assert 1 / 4 < (times[1] - times[0]) / (steps[1] - steps[0]) / predicted < 4


@pytest.mark.parametrize(("flex", "least", "most"), [("z", 2.7, 6.8), ("xyz", 4.9, 15.0)])
@pytest.mark.parametrize("segments", [3, 12, 48])
def test_predicted_cost_ratio_of_implicit_to_explicit_stages_is_in_measured_range(flex, segments, least, most) -> None:
    chain, stages = chain_of(flex, segments), 3  # Radau5 has three stages
    assert least < step_cost(chain, "Radau5") / (stages * run_cost(chain, "RK4", 1)) < most
