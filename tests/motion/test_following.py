"""Drives that follow a reference: exact solutions, adaptive steps, and gravity compensation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import flexlink as fl
from flexlink.motion.inputs.references import reference_arrays
from flexlink.motion.inputs.static_feedforward import holding_torque
from tests.conftest import flexible, make_scene

INERTIA, KP, KD = 4.0, 40.0, 6.0
ZVD = fl.InputShaper(kind="ZVD", frequency_hz=(2.0,), damping=(0.05,))
REFERENCES = {
    "quintic": fl.Reference(profile="quintic", to_deg=(50.0,), start=0.1, duration=0.6),
    "trapezoidal": fl.Reference(profile="trapezoidal", to_deg=(50.0,), duration=0.6),
    "s_curve": fl.Reference(profile="s_curve", to_deg=(50.0,), duration=0.9),
    "linear": fl.Reference(profile="linear", times=(0.1, 0.4, 0.8), angle_deg=((0.0,), (40.0,), (20.0,))),
    "smooth": fl.Reference(profile="smooth", times=(0.1, 0.4, 0.8), angle_deg=((0.0,), (40.0,), (20.0,))),
    "hold": fl.Reference(profile="hold", times=(0.1, 0.4, 0.8), angle_deg=((0.0,), (40.0,), (20.0,))),
    "shaped": fl.Reference(profile="quintic", to_deg=(50.0,), duration=0.3, shaper=ZVD),
}


def wheel(reference: fl.Reference, **run: object) -> fl.Scene:
    """A wheel that follows a reference: I q̈ = kp (r − q) + kd (ṙ − q̇)."""
    drive = fl.Drive(kind="pd", kp=(KP,), kd=(KD,), reference=reference)
    tip = fl.RigidBody(mass=1.0, inertia=(2.0, 2.0, INERTIA - 1.0))
    return make_scene(fl.Link(name="a", length=1.0), tip=tip, gravity=(0, 0, 0), drive=drive, run=fl.RunSettings(**run))


def exact(course: fl.ReferenceTrajectory, times: np.ndarray) -> np.ndarray:
    """Angles at these times by matrix exponentials of (q, q̇, x⁰, x¹, …), piece by piece."""
    order = course.coefficients.shape[1]
    ends, states, y = np.union1d(course.knots, times), {}, np.zeros(2)
    ends = ends[ends >= 0.0]
    c = course.restated(ends)[:, :, 0]
    for t, later, piece in zip(ends, [*ends[1:], ends[-1]], c, strict=True):
        states[t] = y[0]
        A = np.zeros((2 + order, 2 + order))
        A[0, 1], A[1, :2] = 1.0, (-KP / INERTIA, -KD / INERTIA)
        A[range(3, 2 + order), range(2, 1 + order)] = np.arange(1, order)
        A[1, 2:] = (KP * piece + KD * np.append(piece[1:] * np.arange(1, order), 0.0)) / INERTIA
        y = (expm(A * (later - t)) @ np.concatenate([y, np.eye(order)[0]]))[:2]
    return np.array([states[t] for t in times])


@pytest.mark.slow
@pytest.mark.parametrize("profile", REFERENCES)
def test_a_pd_driven_wheel_follows_the_exact_solution(profile: str) -> None:
    """Knots at ends of steps cost no accuracy: the error is due to RK4, about (ωh)⁴/120 = 1e-12 per step.

    If a knot is inside a step, the polynomial at the midpoint is used, which is wrong for h/2 at most: a jump j of the
    jerk causes an impulse of kd j h³/48, which turns the wheel by at most this impulse over I ω. The jumps of a shaped
    move add up to the jumps of the unshaped move at its start and its end.
    """
    scene = wheel(REFERENCES[profile], method="RK4", step=1e-3, sample=0.05, duration=1.5)
    run = fl.simulate(scene)
    off = np.abs(run.q[:, 0] - exact(scene.course, run.t)).max()
    jumps = 2 * 60.0 * np.radians(50.0) / 0.3**3 if profile == "shaped" else 0.0
    assert off < 1e-10 + KD * jumps * 1e-3**3 / 48 / np.sqrt(KP * INERTIA)
    assert not run.warnings


@pytest.mark.slow
@pytest.mark.parametrize("profile", REFERENCES)
def test_adaptive_steps_end_at_the_knots_of_a_reference(profile: str) -> None:
    scene = wheel(REFERENCES[profile], tolerance=1e-6, sample=0.5, duration=1.5)
    for method in ("auto", "Radau5"):
        jumps = method == "Radau5" and profile == "hold"  # the work in the first step from rest is not yet accurate
        run = fl.simulate(scene, method=method, unstable="allow" if jumps else "refuse")
        assert np.abs(run.q[:, 0] - exact(scene.course, run.t)).max() < 1e-6  # [rad]; the tip is at 1 m
        assert not run.warnings or jumps


def arm(reference: fl.Reference, **drive: object) -> fl.Scene:
    """Two joints with PD drives and a flexible link between them, under gravity."""
    law = {"kind": "pd", "kp": (3e3, 1e3), "kd": (60.0, 20.0), "reference": reference, **drive}
    return make_scene(
        flexible("upper", "z", 3), fl.Link(name="fore", length=0.5, material="aluminium", section="square"),
        tip=fl.RigidBody(mass=1.0), drive=fl.Drive(**law), initial=fl.InitialState(joint_deg=(30.0, -20.0)),
        gravity=(0.0, -9.81, 0.0), run=fl.RunSettings(step=1e-4, sample=0.01, duration=0.2),
    )  # fmt: skip


@pytest.mark.slow
def test_gravity_compensation_of_the_bent_arm_follows_the_reference() -> None:
    """Interpolation between equilibria is accurate to 1e-6 of the largest torque, as documented."""
    reference = fl.Reference(profile="quintic", to_deg=(-120.0, 90.0), duration=1.0, shaper=ZVD)
    scene = arm(reference, gravity="static")
    chain = fl.lump(scene)
    own = chain.active
    held = holding_torque(chain, reference_arrays(scene, chain))
    times = np.linspace(-0.1, scene.course.knots[-1] + 0.1, 60)
    pieces = np.maximum(np.searchsorted(held.knots, times, side="right") - 1, 0)
    x = np.maximum(times - held.knots[pieces], 0.0)
    found = (held.coefficients[pieces] * x[:, None, None] ** np.arange(6)[:, None]).sum(axis=1)
    for torque, angles in zip(found, scene.course(times)[0], strict=True):
        q = np.zeros(chain.n)
        q[own] = angles
        wanted = fl.gravity_torque(chain, fl.solve_static(chain, q, locked=own.tolist()).q)[own]
        assert np.abs(torque - wanted).max() < 1e-6 * np.abs(found).max()
