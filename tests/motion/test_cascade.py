"""Cascade drives: P position loop, PI rate loop, limits and filters, sampled and delayed."""

from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import scipy

import flexlink as fl
from tests.conftest import flexible, make_scene
from tests.motion.test_loop import arm
from tests.support.words import refused

RATE = 500.0
FILTERS = (fl.details.DriveFilter(notch=30.0, damping=0.4), fl.details.DriveFilter(low_pass=90.0, order=2, link="a"))
MOVE = fl.Reference(profile="quintic", to_deg=(20.0, -10.0), duration=0.08)


def cascaded(scene: fl.Scene, **changes: Any) -> fl.Scene:
    """A two-link arm under cascade control with a position bandwidth of 5 1/s."""
    chain = fl.lump(scene)
    M = np.diag(fl.mass_matrix(chain, np.zeros(chain.n)))[chain.active]
    kd, ki = tuple((10.0 * M).tolist()), tuple((30.0 * M).tolist())
    parts = {"kp": (5.0,) * len(kd), "kd": kd, "ki": ki, "target_deg": (0.0,) * len(kd), "rate": RATE} | changes
    drive = fl.Drive(kind="cascade", **{key: value for key, value in parts.items() if value is not None})
    run = fl.RunSettings(method="RK4", step=1e-4, duration=0.1, sample=0.002)
    return scene.varied({"drive": drive, "run": run})


class Servo:
    """A cascade in plain Python, for one joint; its filter b/a is that of scipy, with a hold of first order."""

    def __init__(self, drive: fl.Drive, i: int, b: Any, a: Any, limit: float) -> None:
        self.kp, self.kd, self.ki = drive.kp[i], drive.kd[i], drive.ki[i]
        self.inertia = drive.inertia[i] if drive.inertia else 0.0
        self.limit, self.integral, self.x = limit, 0.0, None
        A, B, C, D, _ = scipy.signal.cont2discrete(scipy.signal.tf2ss(b, a), 1 / RATE, method="foh")
        self.filter = A, B[:, 0], C[0], float(D[0, 0])

    def torque(self, r: tuple[float, float, float], q: float, qd: float, given: float, fastest: float) -> float:
        v = min(max(self.kp * (r[0] - q) + r[1], -fastest), fastest)
        integral = self.integral + self.ki * (v - qd) / RATE
        y = self.kd * (v - qd) + integral + self.inertia * r[2] + given
        A, B, C, D = self.filter
        x = np.linalg.pinv(np.eye(len(A)) - A) @ B * y if self.x is None else self.x
        y, self.x = C @ x + D * y, A @ x + B * y
        held = min(max(y, -self.limit), self.limit)
        if (y - held) * (v - qd) <= 0:
            self.integral = integral
        return float(held)


def in_python(scene: fl.Scene, g: tuple[float, ...], fastest: float = np.inf) -> Any:
    """The law of a scene's cascade drive in Python, with feed-forward torques g."""
    drive, chain = scene.drive, fl.lump(scene)
    ω = 2 * np.pi * np.array([30.0, 90.0])
    notch = ([1, 0, ω[0] ** 2], [1, 0.8 * ω[0], ω[0] ** 2])
    butterworth = ([ω[1] ** 2], [1, np.sqrt(2) * ω[1], ω[1] ** 2])
    both = tuple(np.polymul(*pair) for pair in zip(notch, butterworth, strict=True))
    each = [both, notch] if drive.filter else [([1.0], [1.0])] * 2
    limits = drive.effort or (np.inf, np.inf)
    servos = [Servo(drive, i, *each[i], limits[i]) for i in range(2)]
    active = chain.active

    def law(t: float, q: Any, qd: Any) -> list[float]:
        r = np.zeros((3, 2)) if scene.course is None else np.array(scene.course(t))
        states = zip(servos, r.T.tolist(), q[active], qd[active], g, strict=True)
        return [servo.torque(r, q, qd, torque, fastest) for servo, r, q, qd, torque in states]

    return law


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"ki": (0.0, 0.0), "filter": FILTERS},
        {"filter": FILTERS, "reference": MOVE, "target_deg": None, "inertia": (2.0, 0.5)},
        {"reference": MOVE, "target_deg": None, "effort": (700.0, 200.0), "filter": FILTERS},
        {"reference": MOVE, "target_deg": None, "max_rate_deg": (100.0, 100.0)},
        {"delay": 0.003, "filter": FILTERS, "reference": MOVE, "target_deg": None},
    ],
    ids=["plain", "filters", "feedforward", "saturated", "rate limit", "delay"],
)
def test_a_run_is_that_of_the_same_law_in_plain_python(changes: dict[str, Any]) -> None:
    scene = cascaded(arm("z", "z"), **changes).varied({"gravity": (0.0, -9.81, 0.0)})
    bare = scene.varied({"drive": fl.Drive(effort=scene.drive.effort)})
    fastest = np.radians(100.0) if "max_rate_deg" in changes else np.inf
    law = in_python(scene, (0.0, 0.0), fastest)
    ours = fl.simulate(scene)
    other = fl.simulate(bare, control=law, rate=RATE, delay=scene.drive.delay)
    assert np.abs(ours.q).max() > 0.01
    if scene.drive.effort:
        limited = np.abs(ours.tau[:, ours.chain.active]) == scene.drive.effort
        assert (limited.sum(axis=0) > 5).all() and not limited[-1].all()
    np.testing.assert_allclose(ours.q, other.q, atol=1e-12)
    np.testing.assert_allclose(ours.tau, other.tau, atol=1e-9)


@pytest.mark.parametrize("gravity", ["static", "rigid"])
def test_gravity_is_fed_forward(gravity: str) -> None:
    """Without an integrator, an arm that starts at rest in equilibrium stays there."""
    scene = cascaded(arm("z", "z"), gravity=gravity, ki=None)
    held = scene.varied({"gravity": (0.0, -9.81, 0.0), "initial.passive": "static"})
    run, chain = fl.simulate(held), fl.lump(held)
    exact = fl.gravity_torque(fl.lump(held.rigidified()), np.zeros(2))
    expected = exact if gravity == "rigid" else fl.solve_static(chain, locked=chain.active).tau[chain.active]
    np.testing.assert_allclose(run.tau[0, chain.active], expected, rtol=1e-9)
    assert bool(np.abs(run.q - run.q[0]).max() < 1e-9) is (gravity == "static")
    moving = held.varied({"drive.target_deg": None, "drive.reference": MOVE})
    np.testing.assert_allclose(fl.simulate(moving).tau[0, chain.active], expected, rtol=1e-6)


def test_poles_are_those_of_python_control() -> None:
    scene = cascaded(arm("z", "z"), filter=FILTERS, delay=0.004)
    chain = fl.lump(scene)
    plant = fl.linearize(chain, np.zeros(chain.n), outputs=("state",)).sampled(RATE, delay=0.004).control()
    z = control.tf([1, 0], [1], 1 / RATE)
    one = control.tf([1], [1], 1 / RATE)
    ω = 2 * np.pi * np.array([30.0, 90.0])
    notch = control.tf([1, 0, ω[0] ** 2], [1, 0.8 * ω[0], ω[0] ** 2])
    low = control.tf([ω[1] ** 2], [1, np.sqrt(2) * ω[1], ω[1] ** 2])
    drive, laws = scene.drive, []
    for i, filters in enumerate((control.series(notch, low), notch)):
        sampled = control.c2d(control.ss(filters), 1 / RATE, "foh")
        rates = drive.kd[i] * one + drive.ki[i] / RATE * z / (z - 1)
        own = control.ss(control.minreal(rates, verbose=False))
        laws.append(control.series(control.append(own), control.ss(sampled)))
    gains = np.array([[5.0, 0, 1, 0], [0, 5.0, 0, 1]])  # v − q̇ from (q, q̇)
    rows = [
        plant.output_labels.index(f"{kind} {name} [rad{unit}]")
        for kind, unit in (("q", ""), ("qd", "/s"))
        for name in "ab"
    ]
    seen = control.ss(plant.A, plant.B, gains @ plant.C[rows], 0, 1 / RATE)
    closed = control.feedback(control.series(seen, control.append(*laws)), control.ss([], [], [], np.eye(2), 1 / RATE))
    found = np.array([pole.z for pole in fl.loop(scene).poles])
    for pole in closed.poles():
        assert min(np.abs(found - pole).min(), np.abs(found.conj() - pole).min()) < 1e-7 or abs(pole) < 1e-3


@pytest.mark.parametrize("delay", [0.0, 0.003])
def test_a_continued_run_is_the_same_to_the_bit(delay: float, tmp_path: Path) -> None:
    scene = cascaded(arm("z", "z"), filter=FILTERS, delay=delay, reference=MOVE, target_deg=None)
    whole = fl.simulate(scene)
    first = fl.simulate(scene, duration=0.04)
    stored = fl.Trajectory.load(first.save(tmp_path / "run.npz"))
    assert stored.delayed.shape[1] == 1 + 2 + 2 * (2 + 4)
    for before in (first, stored):
        second = fl.simulate(scene, after=before, duration=0.06)
        np.testing.assert_array_equal(second.q, whole.q[20:])
    problem = fl.Problem(scene)
    np.testing.assert_array_equal(problem.simulate(after=stored, duration=0.06).q, whole.q[20:])


def test_a_memory_of_another_drive_is_refused() -> None:
    first = fl.simulate(cascaded(arm("z", "z")))
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.simulate(cascaded(arm("z", "z"), filter=FILTERS), after=first)


@pytest.mark.parametrize(
    ("changes", "id"),
    [
        ({"rate": None}, "missing-key"),
        ({"filter": (fl.details.DriveFilter(notch=30.0, damping=0.1, link="c"),)}, "unknown-name"),
        ({"ki": (1.0,)}, "one-per-link"),
        ({"rate_feedforward": 2.0}, "wrong-value"),
        ({"max_rate_m": (1.0, 0.0)}, "unit-of-joint"),
    ],
)
def test_mistakes_are_refused(changes: dict[str, Any], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        cascaded(arm("z", "z"), **changes)


def test_keys_of_a_cascade_are_refused_elsewhere() -> None:
    for changes in ({"ki": (1.0,)}, {"filter": FILTERS}, {"inertia": (1.0,)}):
        with refused(fl.errors.SceneError, "key-of-another-kind"):
            fl.Drive(kind="pd", kp=(1.0,), kd=(1.0,), target_deg=(0.0,), **changes)


def test_prismatic_joints_have_limits_in_metres() -> None:
    slide = flexible("a", "z", 2, joint=fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), armature=1.0))
    move = fl.Reference(profile="quintic", to_m=(0.5,), duration=0.05)
    drive = fl.Drive(
        kind="cascade", kp=(20.0,), kd=(400.0,), rate=RATE, reference=move, max_rate_m=(0.3,), rate_feedforward=0.0
    )
    run = fl.RunSettings(duration=1.0, sample=0.01, tolerance=1e-6)
    scene = make_scene(slide, gravity=(0.0, 0.0, 0.0)).varied({"drive": drive, "run": run})
    rates = fl.simulate(scene).qd[:, fl.lump(scene).active]
    assert rates[40:80].mean() == pytest.approx(0.3, rel=0.01)


def test_the_loop_at_another_rate_has_the_law_of_that_rate() -> None:
    loop = fl.loop(cascaded(arm("z", "z"), filter=FILTERS))
    assert loop.growth_with(rate=250.0) == pytest.approx(fl.loop(loop.scene.varied({"drive.rate": 250.0})).growth)


def test_a_rate_limit_does_not_change_the_loop() -> None:
    limited, free = (fl.loop(cascaded(arm("z", "z"), max_rate_deg=most)) for most in ((1.0, 1.0), None))
    assert limited.growth == pytest.approx(free.growth, rel=1e-12)
