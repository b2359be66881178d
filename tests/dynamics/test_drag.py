"""Air drag: closed forms, virtual work, derivatives, power, loads, and functions that do not support it."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from tests.conftest import flexible, make_scene, nasty_scene, random_state
from tests.support.words import refused
from validation.random_arms import random_tree

RHO, C, B, OMEGA = 1.2, 2.0, 0.3, 3.0
BAR = make_scene(
    fl.Link(
        name="bar", length=1.0, drag=fl.Drag(coefficient=C, breadth=(B, 0.1)),
        hub=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1)),
    ),
    gravity=(0.0, 0.0, 0.0),
    air_density=RHO,
    initial=fl.InitialState(rate_deg=(math.degrees(OMEGA),)),
    run=fl.RunSettings(duration=2.0, method="RK4", step=1e-3),
)  # fmt: skip
BRAKE = 0.5 * RHO * C * B / 4  # drag torque over ω², ∫ ½ ρ c_d b x³ dx over 1 m [N m s²]


def dragged(scene: fl.Scene) -> fl.Scene:
    """The arm with drag on every link that has a length, in a dense fluid."""
    drag = fl.Drag(coefficient=1.5, breadth=(0.2, 0.1))
    paths = {f"link.{link.name}.drag": drag for link in scene.arm.links if link.beam.length}
    return scene.varied({**paths, "air_density": 40.0})


def without_drag(scene: fl.Scene) -> fl.Scene:
    """The same arm in a vacuum."""
    return scene.varied({**{f"link.{k.name}.drag": None for k in scene.arm.links}, "air_density": None})


def by_virtual_work(chain: fl.Chain, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Drag torques −Σ Jᵀ f, computed with `jacobian` at every point where drag acts."""
    torque = np.zeros(chain.n)
    rotations = fl.frames(chain, q).rotations
    for body, point, across, drag in chain.drag.tolist():
        J = fl.jacobian(chain, q, body=body, point=point @ chain.described["link"][body]).linear
        y, z = np.asarray(across) @ rotations[body].T
        u, w = y @ J @ qd, z @ J @ qd
        torque += J.T @ (math.hypot(u, w) * (drag[0] * u * y + drag[1] * w * z))
    return torque


def test_drag_torque_of_a_rotating_bar_equals_the_integral_over_its_length() -> None:
    chain = fl.lump(BAR)
    for rate in (OMEGA, -OMEGA):
        torque = fl.drag_torque(chain, [0.4], [rate])
        np.testing.assert_allclose(torque, [BRAKE * rate * abs(rate)], rtol=4e-15)


@pytest.mark.parametrize(
    ("settings", "close"),
    [
        ({"method": "RK4", "step": 1e-3}, 1e-11),
        ({"method": "Gauss4", "step": 1e-3}, 3e-8),  # residual of Newton's iteration: 1e-13 of the reach per step
        ({"method": "DOP853", "tolerance": 1e-9}, 1e-8),
        ({"method": "Radau5", "tolerance": 1e-9}, 1e-8),
    ],
)
def test_drag_slows_a_rotating_bar_by_the_closed_form(settings: dict[str, Any], close: float) -> None:
    run = fl.simulate(BAR.varied({f"run.{key}": value for key, value in settings.items()}))
    inertia = fl.mass_matrix(run.chain, [0.0])[0, 0]
    np.testing.assert_allclose(run.qd[:, 0], OMEGA / (1 + BRAKE * OMEGA * run.t / inertia), rtol=close)
    assert abs(run.imbalance).max() < close * run.energy.kinetic[0]


def test_drag_widths_follow_the_section_and_its_taper() -> None:
    cone = fl.Section(shape="circle", diameter=0.1), fl.Section(shape="circle", diameter=0.02)
    link = fl.Link(
        name="cone", length=2.0, material="steel", section="root", section_tip="tip", drag=fl.Drag(coefficient=1.0)
    )
    arm = fl.Arm(
        links=(link,), sections=dict(zip(("root", "tip"), cone, strict=True)),
        materials={"steel": fl.Material(young=2e11, density=7800.0)},
    )  # fmt: skip
    chain = fl.lump(fl.Scene(name="cone", arm=arm, air_density=2.0))
    # ∫ b x³ dx, b = 0.1 − 0.04 x, from 0 to 2
    np.testing.assert_allclose(fl.drag_torque(chain, [0.0], [1.0]), [0.1 * 4 - 0.04 * 32 / 5], rtol=1e-13)


@pytest.mark.parametrize("seed", range(6))
def test_drag_torques_agree_with_virtual_work_on_any_arm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = dragged(random_tree(seed) if seed else nasty_scene())
    chain = fl.lump(scene)
    q, qd = random_state(chain, rng)
    torque = fl.drag_torque(chain, q, qd)
    np.testing.assert_allclose(torque, by_virtual_work(chain, q, qd), atol=1e-12 * abs(torque).max())
    assert qd @ torque > 0
    tau = rng.normal(size=chain.n)
    expected = fl.forward_dynamics(fl.lump(without_drag(scene)), q, qd, tau - torque)
    ulp = np.spacing(abs(expected).max())  # a small component is rounded like those from which it follows
    np.testing.assert_allclose(fl.forward_dynamics(chain, q, qd, tau), expected, rtol=1e-13, atol=ulp)
    np.testing.assert_allclose(fl.forward_dynamics(chain, [q, q], qd, tau)[1], expected, rtol=1e-11, atol=1e-9)


def test_the_drive_of_a_prescribed_joint_works_against_drag() -> None:
    turning = fl.PrescribedMotion(
        link="bar", times=(0.0, 1.0), angle_deg=(0.0, 90.0), rate_deg=(90.0, 90.0), acceleration_deg=(0.0, 0.0)
    )
    initial = fl.InitialState(rate_deg=(90.0,))
    run = fl.simulate(BAR.varied({"motion": (turning,), "run.duration": 1.0, "initial": initial}))
    ω = math.pi / 2
    np.testing.assert_allclose(run.tau[:, 0], BRAKE * ω * ω, rtol=1e-12)
    np.testing.assert_allclose(run.work[-1], 0.0, atol=1e-12)  # drag dissipates all work of the drive


@pytest.mark.parametrize(
    ("changes", "error_id"),
    [
        ({"link.bar.drag": None}, "no-effect"),
        ({"link.bar.drag.breadth": None}, "missing-key"),
        ({"link.bar.drag.coefficient": -1.0}, "wrong-value"),
        ({"link.bar.length": 0.0}, "needs-a-length"),
        ({"air_density": 0.0}, "wrong-value"),
    ],
)
def test_invalid_drag_settings_are_refused(changes: dict[str, Any], error_id: str) -> None:
    with refused(fl.errors.SceneError, error_id):
        BAR.varied(changes)


def test_drag_of_a_general_section_needs_a_width() -> None:
    section = fl.Section(shape="general", area=1e-4, i_y=1e-9, i_z=1e-9, torsion=1e-9)
    link = fl.Link(name="a", length=1.0, material="m", section="s", drag=fl.Drag(coefficient=1.0))
    with refused(fl.errors.SceneError, "missing-key"):
        fl.Arm(links=(link,), sections={"s": section}, materials={"m": fl.Material(young=1e9, density=1e3)})


HELD = fl.Joint(locked=True)


def test_a_link_fixed_in_frame_0_has_no_drag(rng: np.random.Generator) -> None:
    rod = {"length": 1.0, "material": "aluminium", "section": "square"}
    drag = fl.Drag(coefficient=1.2, breadth=(0.1, 0.1))
    fixed = make_scene(fl.Link(name="post", joint=HELD, **rod), fl.Link(name="arm", **rod))
    q, qd, tau = rng.normal(size=(3, 1))
    still = fl.forward_dynamics(fl.lump(fixed), q, qd, tau)
    np.testing.assert_array_equal(
        fl.forward_dynamics(fl.lump(fixed.varied({"link.post.drag": drag})), q, qd, tau), still
    )
    moved = fl.forward_dynamics(fl.lump(fixed.varied({"link.arm.drag": drag})), q, qd, tau)
    assert abs(moved - still).max() > 1e-3


def test_air_density_is_part_of_the_chain() -> None:
    scene = make_scene(flexible("beam", drag=fl.Drag(coefficient=1.2)))
    thin, dense = (fl.lump(replace(scene, air_density=ρ)) for ρ in (1.0, 3.0))
    np.testing.assert_allclose(dense.drag["drag"], 3 * thin.drag["drag"], rtol=1e-14)
