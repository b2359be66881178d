"""Prescribed joint motion: the joint follows it exactly, and the required torque is an output."""

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.motion.inputs.actuation import motion_arrays
from tests.conftest import flexible, make_scene
from tests.support.words import refused


def swing(link: str = "a", knots: int = 41, duration: float = 2.0) -> fl.PrescribedMotion:
    """θ = 30° (1 − cos 2t), with its exact rate and acceleration at the knots."""
    t = np.linspace(0, duration, knots)
    columns = (30 * (1 - np.cos(2 * t)), 60 * np.sin(2 * t), 120 * np.cos(2 * t))
    angle, rate, acceleration = (tuple(column.tolist()) for column in columns)
    return fl.PrescribedMotion(
        link=link, times=tuple(t.tolist()), angle_deg=angle, rate_deg=rate, acceleration_deg=acceleration
    )


def test_quintic_pieces_approximate_a_smooth_motion_to_sixth_order() -> None:
    scene = make_scene(fl.Link(name="a", length=1.0), tip=fl.RigidBody(mass=1.0), motion=(swing(),))
    motion = motion_arrays(scene, fl.lump(scene))
    q, qd, qdd = np.zeros((3, 1))
    for t in np.linspace(0, 1.99, 333):
        follow(motion, t, q, qd, qdd)
        exact = np.radians([30 * (1 - np.cos(2 * t)), 60 * np.sin(2 * t), 120 * np.cos(2 * t)])
        # Hermite error of the angle: (h/2)⁶/720 · max|θ⁽⁶⁾| = 2.5e-2⁶/720 · 30·64°; rates are less accurate
        np.testing.assert_allclose([q[0], qd[0], qdd[0]], exact, atol=2e-6)
        assert abs(q[0] - exact[0]) < 2e-11
    follow(motion, 3.0, q, qd, qdd)
    assert qdd[0] == 0
    assert qd[0] == pytest.approx(np.radians(60 * np.sin(4.0)))


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_torque_of_a_prescribed_joint_includes_rotor_friction_and_tip_load(solver: str) -> None:
    joint = fl.Joint(viscous=2.0, coulomb=0.5, coulomb_width=0.1, armature=0.25)
    scene = make_scene(
        fl.Link(name="a", joint=joint), tip=fl.RigidBody(mass=1.0, inertia=(2.0, 2.0, 3.0)), gravity=(0, 0, 0),
        motion=(swing(),), wrench=fl.Wrench(moment=(0.0, 0.0, 7.0)),
    )  # fmt: skip
    run = fl.simulate(scene, step=1e-2, sample=0.05, duration=2.0, solver=solver)
    ω, α = np.radians(60) * np.sin(2 * run.t), np.radians(120) * np.cos(2 * run.t)
    α[-1] = 0.0  # after the last knot, the rate is constant
    exact = 3.25 * α + 2.0 * ω + 0.5 * np.tanh(ω / 0.1) - 7.0
    np.testing.assert_allclose(run.tau[:, 0], exact, atol=1e-5)  # error h⁴ of Hermite's second derivative


@pytest.mark.parametrize("solver", SOLVERS)
def test_prescribed_joints_are_exactly_at_their_positions_in_every_sample(solver: str) -> None:
    """Stages integrated without correction deviate by 1e-5 rad if a step is a tenth of the motion.

    θ = s³ (10 − 15 s + 6 s²) is the quintic from rest to rest within 1 s; the run ends beyond its last knot.
    """
    at_rest = {"rate_deg": (0.0, 0.0), "acceleration_deg": (0.0, 0.0)}
    motion = (
        fl.PrescribedMotion(link="a", times=(0.0, 1.0), angle_deg=(0.0, 90.0), **at_rest),
        fl.PrescribedMotion(link="c", times=(0.0, 0.5), angle_deg=(0.0, -40.0), **at_rest),
    )
    heavy = fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
    links = [fl.Link(name=name, length=0.5, hub=heavy) for name in "abc"]
    run = fl.simulate(make_scene(*links, tip=heavy, motion=motion), step=0.1, sample=0.1, duration=1.3, solver=solver)
    for k, degrees, duration in ((0, 90.0, 1.0), (2, -40.0, 0.5)):
        s = np.minimum(run.t / duration, 1.0)
        angle, rate = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2 / duration
        np.testing.assert_allclose(run.q[:, k], np.radians(degrees) * angle, rtol=0, atol=1e-14)
        np.testing.assert_allclose(run.qd[:, k], np.radians(degrees) * rate, rtol=0, atol=1e-13)
    assert run.q[-1, 0] == pytest.approx(np.pi / 2, abs=1e-15)
    assert run.qd[-1, 0] == 0


@pytest.mark.parametrize("samples", [1, 5])
def test_a_prescribed_joint_of_a_planar_chain_may_be_reversed_and_have_a_rotor(samples: int) -> None:
    """The prescribed joint has a reversed axis inside the chain, so its sign and rotor affect the links before it."""
    over = fl.Mount(rpy_deg=(180, 0, 0))
    links = (
        flexible("a", segments=3),
        flexible("b", segments=3, mount=over, joint=fl.Joint(armature=0.5)),
        flexible("c", segments=2, mount=over, joint=fl.Joint(armature=0.1)),
    )
    scene = make_scene(*links, gravity=(1.0, 9.0, 2.0), motion=(swing("b", 401),))
    assert fl.lump(scene).is_planar
    sample = 2e-4 if samples == 1 else 1e-2
    settings = {"step": 2e-5, "sample": sample, "duration": samples * sample}
    runs = [fl.simulate(scene, **settings, solver=name) for name in SOLVERS]
    for run in runs[1:]:
        assert np.abs(run.q - runs[0].q).max() < 1e-11
        np.testing.assert_allclose(run.tau, runs[0].tau, rtol=0, atol=1e-7 * np.abs(runs[0].tau).max())
    assert np.abs(runs[0].q[:, 0]).max() > 0.04 * (samples * sample) ** 2  # the free inboard joint moves


@pytest.mark.parametrize(
    ("change", "wanted"), [({"link": "x"}, "unknown-link"), ({"angle_deg": (1.0, 2.0)}, "start-differs-from-motion")]
)
def test_a_motion_that_does_not_fit_the_scene_is_refused(change: dict, wanted: str) -> None:
    fields = {"link": "a", "times": (0.0, 1.0), "angle_deg": (0.0, 1.0), "rate_deg": (0.0, 0.0),
              "acceleration_deg": (0.0, 0.0)}  # fmt: skip
    with refused(fl.errors.SceneError, wanted):
        make_scene(
            fl.Link(name="a", length=1.0),
            tip=fl.RigidBody(mass=1.0),
            motion=(fl.PrescribedMotion(**{**fields, **change}),),
        )


def test_an_invalid_motion_table_is_refused() -> None:
    with refused(fl.errors.SceneError, "first-time"):
        fl.PrescribedMotion(link="a", times=(1.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
    rows = {"angle_deg": (0.0,) * 4, "rate_deg": (0.0,) * 4, "acceleration_deg": (0.0,) * 4}
    with refused(fl.errors.SceneError, "times-not-increasing"):
        fl.PrescribedMotion(link="a", times=(0.0, 1.0, 0.5, 2.0), **rows)
    with refused(fl.errors.SceneError, "not-finite"):
        fl.PrescribedMotion(link="a", times=(0.0, 1.0, 1.5, 2.0), **rows | {"rate_deg": (0.0, 0.0, 0.0, np.nan)})
    with refused(fl.errors.SceneError, "one-per-time"):
        fl.PrescribedMotion(link="a", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0, 0.0), acceleration_deg=(0.0,))
