"""A run reaches its end time or raises an error, also with a free base in implicit steps or if it stops early."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.motion import fixed_steps, floating_steps, sampled_control
from flexlink.motion.adaptive_steps import AdaptiveSteps
from flexlink.motion.batch import outcomes
from tests.conftest import compiled, flexible, make_scene
from tests.support.words import reviewed

pytestmark = compiled


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


@pytest.mark.parametrize(("method", "spin", "step"), FIXED)
def test_a_free_base_in_implicit_steps_reaches_its_end_or_fails_with_a_reason(
    method: str, spin: float, step: float
) -> None:
    try:
        run = fl.simulate(satellite(spin), method=method, step=step)
    except fl.errors.DivergenceError as error:
        assert error.id in {"diverged", "newton-failed"}
        reviewed("diverged: Newton's iteration", str(error), values=False)
        return
    assert run.t[-1] == 0.4
    assert run.steps is not None and run.steps.taken >= round(0.4 / step)


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


@pytest.mark.parametrize("kind", RUNS)
def test_a_run_that_stops_early_without_a_reason_is_an_error(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    RUNS[kind]()  # a complete run is not an error
    take, pieces, go = AdaptiveSteps.take, fixed_steps.pieces, floating_steps.advance

    def half_way(steps: AdaptiveSteps, most: int) -> int:
        return int(OUTCOME.ended) if most and steps.tries >= 2 else take(steps, min(most, 2))

    def half(*arguments: Any) -> Iterator[int]:
        return itertools.takewhile(lambda done: done <= 50, pieces(*arguments))

    def some(integrate: Any, fixed: Any, first: int, stop: int, *rest: Any) -> int:
        return go(integrate, fixed, first, min(stop, 50), *rest)

    monkeypatch.setattr(AdaptiveSteps, "take", half_way)
    monkeypatch.setattr(fixed_steps, "pieces", half)
    monkeypatch.setattr(sampled_control, "advance", some)
    monkeypatch.setattr(fixed_steps, "advance", some)
    with pytest.raises(fl.errors.DivergenceError) as caught:
        RUNS[kind]()
    assert caught.value.id == ("diverged" if kind == "Simulator, explicit" else "ended-early")
    reviewed(f"ends early: {kind}", str(caught.value), values=False)


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


@pytest.mark.slow
def test_the_spin_of_a_free_body_is_conserved_in_implicit_steps() -> None:
    """The spin is constant within the rounding of all steps; Newton residuals would add up to fifty times as much."""
    for method in ("Gauss6", "Radau9"):
        run = fl.simulate(satellite(1.0), method=method, step=0.002, sample=0.2, duration=6.0)
        assert run.base is not None
        spin = np.linalg.norm(run.base.momentum.spin - run.base.momentum.spin[0], axis=1)
        assert spin.max() < 1e-12 * np.linalg.norm(run.base.momentum.spin[0])
