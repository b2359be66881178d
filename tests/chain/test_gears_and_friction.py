"""Elastic gears, dry friction in hinges and joint limits: closed forms, engines, and refusals."""

from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.notes import notes
from tests.conftest import compiled, flexible, make_scene
from tests.support.words import refused, reviewed

EPS = np.finfo(float).eps
K, I_A, J = 300.0, 0.02, 0.5
GEAR = fl.Joint(gear_stiffness=K, armature=I_A)
WHEEL = fl.RigidBody(inertia=(0.0, 0.0, J))


def geared(joint: fl.Joint = GEAR, **fields: object) -> fl.Scene:
    """A wheel with inertia J about Z on a motor with an elastic gear, without external forces."""
    return make_scene(fl.Link(name="a", joint=joint, hub=WHEEL), **{"gravity": (0.0, 0.0, 0.0), **fields})


def test_motor_gear_and_wheel_behave_as_two_inertias_and_a_spring() -> None:
    """The coordinates are θ_motor and θ_link − θ_motor; ω² = k (1/I_rotor + 1/J), or k/J if it is locked."""
    chain = fl.lump(geared())
    assert chain.joint_names == ("a", "a.gear")
    assert chain.coordinate("a.gear") == (1, 0, 3)
    assert chain.active.tolist() == [0]
    np.testing.assert_array_equal(fl.mass_matrix(chain, np.zeros(2)), [[J + I_A, J], [J, J]])
    ω = fl.natural_frequencies(chain, np.zeros(2))
    assert ω[-1] == pytest.approx(np.sqrt(K * (1 / I_A + 1 / J)), rel=1e-13, abs=0)
    held = fl.natural_frequencies(chain, np.zeros(2), locked=["a"])
    assert held.tolist() == pytest.approx([np.sqrt(K / J)], rel=1e-14, abs=0)


def test_a_locked_motor_fixes_its_side_of_the_gear() -> None:
    chain = fl.lump(geared(fl.Joint(gear_stiffness=K, locked=True), initial=fl.InitialState(joint_deg=(90.0,))))
    assert chain.joint_names == ("a.gear",)
    assert fl.natural_frequencies(chain, np.zeros(1)).tolist() == pytest.approx([np.sqrt(K / J)], rel=1e-14, abs=0)
    np.testing.assert_array_equal(fl.frames(chain, np.zeros(1)).rotations[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


def test_gear_damping_acts_on_the_gear_and_motor_friction_on_the_motor() -> None:
    joint = fl.Joint(gear_stiffness=K, gear_damping=3.0, armature=I_A, viscous=2.0, coulomb=0.4, coulomb_width=0.1)
    torque = fl.friction_torque(fl.lump(geared(joint)), [0.1, 0.7])
    assert torque.tolist() == pytest.approx([2.0 * 0.1 + 0.4 * np.tanh(1.0), 3.0 * 0.7], rel=4 * EPS, abs=0)


def test_an_elastic_gear_deflects_under_the_weight_of_its_link() -> None:
    """With the motor locked k θ = m g r cos θ, and InitialState(passive="static") starts at this θ."""
    link = fl.Link(name="a", length=0.5, joint=fl.Joint(gear_stiffness=K, armature=I_A, axis=(0, 0, -1)))
    load = fl.RigidBody(mass=4.0, inertia=(0.1, 0.1, 0.1))
    start = fl.InitialState(joint_deg=(0.0,), passive="static")
    scene = make_scene(link, tip=load, gravity=(0.0, -9.81, 0.0), initial=start)
    assert not notes(scene)
    q, _ = fl.initial_state(scene, fl.lump(scene))
    assert q[0] == 0
    assert K * q[1] == pytest.approx(4.0 * 9.81 * 0.5 * np.cos(q[1]), rel=1e-12, abs=0)


def test_passive_hinges_have_damping_and_dry_friction(rng) -> None:
    """T_FR = d q̇ + c tanh(q̇/w), also in passive hinges."""
    rubbing = fl.Friction(coulomb=0.5, coulomb_width=0.2)
    chain = fl.lump(make_scene(flexible("a", "yz", 3, joint=GEAR, friction=rubbing), flexible("b", "xyz", 3)))
    hinges, qd = chain.hinges, rng.standard_normal(chain.n)
    wanted = hinges["damping"] * qd + hinges["coulomb"] * np.tanh(qd / hinges["coulomb_width"])
    np.testing.assert_allclose(fl.friction_torque(chain, qd), wanted, rtol=4 * EPS)
    passive = [k for k, c in enumerate(chain.coordinates) if c.link == 1 and c.segment]
    assert (hinges["coulomb"][passive] == 0.5).all()
    assert (hinges["coulomb_width"][passive] == 0.2).all()


def test_under_prescribed_motion_the_motor_follows_exactly_and_the_gear_deflects() -> None:
    """θ_gear = −(α/ω²)(1 − cos ω t), ω² = k/J, for a motor with constant acceleration α from rest."""
    α, end = 2.0, 0.2
    path = [(t, 0.5 * α * t * t, α * t, α) for t in (0.0, 2 * end)]
    times, angle, rate, acceleration = zip(*path, strict=True)
    motion = fl.PrescribedMotion(
        link="a", times=times, angle_deg=np.degrees(angle), rate_deg=np.degrees(rate),
        acceleration_deg=np.degrees(acceleration),
    )  # fmt: skip
    run = fl.simulate(geared(motion=(motion,)), step=1e-4, duration=end, sample=end)
    ω = np.sqrt(K / J)
    gear = -α / ω**2 * (1 - np.cos(ω * end))
    assert run.q[-1].tolist() == pytest.approx([0.5 * α * end**2, gear], rel=1e-8)
    assert run.tau[-1, 0] == pytest.approx(I_A * α - K * gear, rel=1e-8)


def test_the_bending_limit_of_beam_hinges_does_not_apply_to_gears() -> None:
    soft = geared(fl.Joint(gear_stiffness=0.1, armature=1.0, viscous=1e3), initial=fl.InitialState(joint_deg=(0.0,)))
    pushed = soft.varied({"wrench.moment": (0.0, 0.0, 1.0)})
    run = fl.simulate(pushed, step=1e-3, duration=2.0)
    assert np.degrees(run.q[-1, 1]) > 84
    assert not run.warnings


LIMITS = fl.Joint(limits_deg=(-90.0, 45.0))


def test_a_run_past_a_limit_gives_a_warning_and_is_not_stopped() -> None:
    scene = make_scene(
        flexible("a", joint=LIMITS), gravity=(0.0, 9.81, 0.0), initial=fl.InitialState(joint_deg=(45.0,))
    )
    free = fl.simulate(scene.varied({"link.a.joint.limits_deg": None}), step=5e-5, duration=0.1)
    run = fl.simulate(scene, step=5e-5, duration=0.1)
    np.testing.assert_array_equal(run.q, free.q)
    assert not free.warnings
    (warning,) = run.warnings
    reviewed("warning: joint past its limits", warning)
    for part in ("joint 'a'", " 45.0", "-90° … 45°"):
        assert part in warning


def test_exports_contain_limits_and_no_engine_enforces_them(rng) -> None:
    chain = fl.lump(make_scene(flexible("a", joint=LIMITS), flexible("b")))
    lower, upper = np.radians([-90.0, 45.0]).tolist()
    urdf, mjcf = ET.fromstring(fl.to_urdf(chain)), ET.fromstring(fl.to_mjcf(chain))
    ends = urdf.findall("joint/limit")
    assert [float(ends[0].attrib[key]) for key in ("lower", "upper")] == [lower, upper]
    assert {limit.attrib["lower"] for limit in ends[1:]} == {"-1e9"}
    written = [joint.attrib.get("range") for joint in mjcf.iter("joint")]
    assert written[0] == f"{lower!r} {upper!r}"
    assert not any(written[1:])
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain))
    assert model.jnt_range[0].tolist() == [lower, upper]
    assert not model.jnt_limited.any()


@pytest.mark.parametrize(
    ("build", "wanted"),
    [
        (lambda: fl.Joint(gear_stiffness=K), "needs-another-key"),
        (lambda: fl.Joint(gear_damping=1.0), "needs-another-key"),
        (lambda: fl.Joint(gear_stiffness=0.0, armature=1.0), "wrong-value"),
        (lambda: fl.Joint(limits_deg=(10, 10)), "limits-order"),
        (lambda: make_scene(fl.Link(name="a", joint=LIMITS), initial=fl.InitialState(joint_deg=(46.0,))),
         "outside-limits"),
        (lambda: make_scene(fl.Link(name="a", joint=LIMITS), motion=(fl.PrescribedMotion(
            link="a", times=(0, 1), angle_deg=(0, 46), rate_deg=(0, 0), acceleration_deg=(0, 0)),)),
         "outside-limits"),
        (lambda: fl.Friction(coulomb=-1.0), "wrong-value"),
    ],
)  # fmt: skip
def test_invalid_gear_limit_and_friction_values_are_refused(build, wanted) -> None:
    with refused(fl.errors.SceneError, wanted):
        build()


def test_hinge_friction_of_a_rigid_link_gets_a_note() -> None:
    scene = make_scene(fl.Link(name="a", length=0.5, friction=fl.Friction(coulomb=1.0)), gravity=(0.0, 9.81, 0.0))
    (note,) = notes(scene)
    reviewed("note: friction of a rigid link", note)
    assert note.partition(": ")[0].removeprefix("link.a.") == "friction.coulomb = 1.0"


@compiled
@pytest.mark.slow
def test_fixed_implicit_steps_handle_sharp_friction_like_adaptive_steps() -> None:
    """For a spinning free arm with friction width 1e-4 rad/s, the slope of friction fails in any fixed step."""
    dry = {"coulomb": 0.5, "coulomb_width": 1e-4}
    soft = fl.Section(shape="circle", diameter=0.01)
    link = flexible(
        "arm", segments=3, length=0.8, section="rod", joint=fl.Joint(**dry), friction=fl.Friction(0.05, 1e-4)
    )
    base = fl.Base(kind="free", mass=5.0, inertia=(0.2, 0.25, 0.3))
    material = fl.Material(young=70e9, density=2700.0)
    arm = fl.Arm(
        links=(link,), base=base, materials={"aluminium": material}, sections={"rod": soft}, tip=fl.RigidBody(mass=0.5)
    )
    initial = fl.InitialState(
        joint_deg=(30.0,), rate_deg=(100.0,), base=fl.details.BaseState(spin_deg=(200.0, 100.0, 50.0))
    )
    run = fl.RunSettings(method="Gauss4", step=1e-3, duration=0.2, sample=0.02)
    scene = fl.Scene(name="spinning", arm=arm, initial=initial, run=run, gravity=(0.0, 0.0, 0.0))
    exact = fl.simulate(scene.varied({"run": fl.RunSettings(tolerance=1e-6, duration=0.2, sample=0.02)})).tip
    run = fl.simulate(scene)
    assert not run.warnings
    assert np.linalg.norm(run.tip - exact, axis=1).max() <= 2e-6  # twice the tolerance of the adaptive run
