"""Results do not depend on when a run is checked: after every step, occasionally, or only at its end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.motion.batch import outcomes
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.monitor import Monitor
from flexlink.results.record import Record
from tests.conftest import ROOT, flexible, make_scene
from tests.support.looking import digests, in_every_way
from tests.support.words import reviewed

TUMBLER = fl.Arm(
    links=(flexible("a", "yz", 2, joint=fl.Joint(viscous=0.1), section="rod", material="soft"),),
    materials={"soft": fl.Material(young=2e9, density=1500.0)},
    sections={"rod": fl.Section(shape="circle", diameter=0.02)},
    tip=fl.RigidBody(mass=0.2), base=fl.Base(kind="free", mass=3.0, inertia=(0.2, 0.25, 0.3)),
)  # fmt: skip
SPIN = fl.InitialState(joint_deg=(20.0,), base=fl.details.BaseState(spin_deg=(30.0, 300.0, 60.0)))


def pendulum(**changes: Any) -> fl.Scene:
    """A soft link that bends and swings beyond its joint limits."""
    joint = fl.Joint(limits_deg=(-30.0, 60.0))
    link = flexible("a", "z", 4, joint=joint)
    scene = make_scene(link, gravity=(0.0, 9.81, 0.0), initial=fl.InitialState(joint_deg=(50.0,)))
    return scene.varied({"material.aluminium": fl.Material(young=1e8, density=2700.0), "run.duration": 0.5, **changes})


def driven(**changes: Any) -> fl.Scene:
    """A flexible link that a PD drive turns by 5° from static equilibrium."""
    pd = fl.Drive(kind="pd", kp=(2000.0,), kd=(120.0,), target_deg=(-10.0,))
    start = fl.InitialState(joint_deg=(-15.0,), passive="static")
    scene = make_scene(flexible("a", "z", 5), gravity=(0.0, 9.81, 0.0), drive=pd, initial=start)
    return scene.varied({"run.duration": 0.3, "run.sample": 0.01, **changes})


def slow_start() -> fl.Scene:
    """A link of spring steel that a stiff motor turns along a quintic: little energy is exchanged at first."""
    link = fl.Link(
        name="a", length=0.6271443245261225, material="steel", section="blade", flex="z", segments=5,
        mount=fl.Mount(rpy_deg=(90.0, 0.0, 0.0)), joint=fl.Joint(viscous=0.014072308992832272, armature=0.02),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), materials={"steel": fl.Material(young=205e9, density=7840.0, loss_time=5e-5)},
        sections={"blade": fl.Section(shape="rectangle", height=0.011924457975022196, width=0.03)},
        tip=fl.RigidBody(mass=0.8416351233032555),
    )  # fmt: skip
    to = fl.Reference(profile="quintic", to_deg=(23.058306634987986,), duration=0.6)
    return fl.Scene(
        name="slow start", arm=arm, gravity=(0.0, 0.0, -9.81), run=fl.RunSettings(duration=0.9, sample=0.03),
        initial=fl.InitialState(joint_deg=(-15.520856018662947,), passive="static"),
        drive=fl.Drive(kind="pd", kp=(2000.0,), kd=(120.0,), reference=to),
    )  # fmt: skip


def tumbler(**changes: Any) -> fl.Scene:
    """A scene of an arm on a tumbling free base."""
    scene = fl.Scene(name="tumbler", arm=TUMBLER, initial=SPIN, gravity=(0.0, 0.0, 0.0))
    return scene.varied({"run.duration": 0.5, "run.sample": 0.05, **changes})


def wild(**changes: Any) -> fl.Scene:
    """A rod released nearly upright, with such long steps that the method loses or gains energy."""
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    scene = make_scene(rod, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)))
    return scene.varied({"run.step": 0.35, "run.sample": 0.35, "run.duration": 35.0, **changes})


def bent(**changes: Any) -> fl.Scene:
    """A soft link that bends beyond 84°."""
    soft = flexible("a", "xyz", 2, joint=fl.Joint(locked=True), lumping="midpoint")
    scene = make_scene(soft, gravity=(0.0, 0.0, -60.0))
    material = fl.Material(young=2e6, density=1000.0)
    return scene.varied({"material.aluminium": material, "run.duration": 1.0, "run.sample": 0.01, **changes})


def law(_t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """A control law in Python that acts as a damper and a spring."""
    return np.asarray([-50.0 * q[0] - 5.0 * qd[0]])


TOLERANCE = {"run.step": None, "run.relative_tolerance": 1e-3}
KINDS: dict[str, Callable[[], Any]] = {
    "fixed explicit": lambda: fl.simulate(pendulum(**{"run.sample": 1e-3})),
    "fixed explicit, coarse": lambda: fl.simulate(wild()),
    "fixed explicit, insisted": lambda: fl.simulate(wild(**{"run.unstable": "allow"})),
    "fixed explicit, free base": lambda: fl.simulate(tumbler(**{"run.step": 1e-3})),
    "fixed implicit, free base": lambda: fl.simulate(tumbler(**{"run.step": 5e-3, "run.method": "Gauss6"})),
    "fixed implicit, coarse": lambda: fl.simulate(wild(**{"run.method": "Radau5", "run.step": 0.175})),
    "implicit": lambda: fl.simulate(driven(**TOLERANCE, **{"run.method": "Radau5"})),
    "explicit": lambda: fl.simulate(driven(**TOLERANCE, **{"run.method": "DOP853"})),
    "explicit, slow start": lambda: fl.simulate(slow_start(), method="DOP853", tolerance=4e-3),
    "of a deflection": lambda: fl.simulate(
        pendulum(**TOLERANCE, **{"run.method": "DOP853", "run.accuracy": "deflection", "run.sample": 0.01})
    ),
    "picked, with trials": lambda: fl.simulate(tumbler(**TOLERANCE, **{"run.method": "auto", "run.sample": 2e-3})),
    "no further": lambda: fl.simulate(
        driven(**TOLERANCE, **{"run.method": "Radau5", "run.max_evaluations": 60, "run.sample": 1e-3})
    ),
    "bent far": lambda: fl.simulate(bent(**TOLERANCE, **{"run.method": "Radau5"})),
    "a law": lambda: fl.simulate(pendulum(**{"run.sample": 0.01}), control=law, rate=200.0),
    "a law, adaptive": lambda: fl.simulate(
        pendulum(**TOLERANCE, **{"run.method": "Radau5", "run.sample": 0.01}), control=law, rate=200.0
    ),
    "side by side": lambda: fl.simulate_many(
        [pendulum(**{"run.sample": 5e-3, "initial.joint_deg": (angle,)}) for angle in (30.0, 50.0, 59.0)]
    ),
    "a sweep's members": lambda: outcomes([wild(), driven(**TOLERANCE), pendulum()], Stop()),
    "a model": lambda: fl.simulate(fl.load_scene(ROOT / "models" / "satellite.toml"), duration=0.2),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_results_and_warnings_do_not_depend_on_the_checking_times(kind: str) -> None:
    first, *others = in_every_way(KINDS[kind], kind)
    assert others == [first, first]


def test_the_compared_runs_cover_every_kind_of_ending() -> None:
    """If a kind of ending were missing, the comparison would not test it."""
    parts = {
        "fixed explicit": "joint 'a'",  # joint beyond its limits
        "fixed explicit, coarse": "E − E(0) − W",
        "no further": "max_evaluations = 60",
        "bent far": "'a.1.y'",
    }
    for kind, part in parts.items():
        assert any(part in text for each in digests(KINDS[kind]) for text in texts_of(each)), kind


def texts_of(found: object) -> Iterator[str]:
    """The error or the warnings of a run."""
    yield from [found] if isinstance(found, str) else found[2]  # type: ignore[index]


def test_a_run_with_little_energy_at_first_is_not_refused() -> None:
    run = fl.simulate(slow_start(), method="DOP853", tolerance=4e-3)
    exact = fl.simulate(slow_start(), method="Radau9", tolerance=1e-7)
    assert run.warnings == ()
    assert np.abs(run.tip - exact.tip).max() < 0.1 * 4e-3


@pytest.mark.parametrize("pieces", [(0, 20), (0, 1, 2, 3, 4, 5, 6, 7, 8, 20), (0, 4, 9, 20), (0, 7, 8, 20)])
def test_checks_of_configurations_do_not_depend_on_the_piece_size(pieces: tuple[int, ...]) -> None:
    """A joint beyond its limit and hinges that bend by 10° per sample until M is indefinite are both reported."""
    links = (
        flexible("a", "xyz", 9, lumping="gauss_matched"),
        flexible("b", "rigid", 1, joint=fl.Joint(limits_deg=(-9, 9))),
    )
    problem = problem_of(make_scene(*links).varied({"run.duration": 0.0, "run.unstable": "allow"}))
    chain, rows = problem.chain, np.arange(20.0)
    q = np.radians(np.multiply.outer(10.0 * rows, chain.stiffness > 0))
    q[2:, chain.index("b", 0, 0)] = 1.0
    monitor = Monitor(Record(problem, rows, q, np.zeros_like(q)))
    for stop in pieces[1:]:
        monitor.check(stop)
    firsts = [float(np.linalg.eigvalsh(fl.mass_matrix(chain, row))[0]) <= 0 for row in q]
    assert 3 < monitor.n_valid == firsts.index(True)
    unbalanced, past = monitor.warnings
    assert unbalanced.startswith("t = 1 s: ") and "E − E(0) − W" in unbalanced
    assert past.startswith("t = 2 s: ") and "joint 'b'" in past
    ids = {"mass-not-positive-definite": monitor.failure, "energy-imbalance": unbalanced, "joint-past-limits": past}
    for id, text in ids.items():
        assert (getattr(text, "id", "") or id) == id
        reviewed(id, text)
