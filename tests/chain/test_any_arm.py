"""Joints about any axis, beams along any line and bodies of any inertia agree with their equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.chain.rigid import turn_to
from flexlink.describe.directions import unit
from flexlink.dynamics.notes import notes
from tests.conftest import ALUMINIUM, SQUARE, make_scene
from tests.support.words import refused

EPS = np.finfo(float).eps
FLAT = fl.Section(shape="rectangle", height=0.03, width=0.01)
SLENDER = {"material": "aluminium", "section": "flat", "flex": "xyz", "segments": 3}

coordinate = st.floats(-1.0, 1.0)
directions = st.tuples(coordinate, coordinate, coordinate).filter(lambda v: max(map(abs, v)) > 1e-3)


def arm_of(*links: fl.Link, tip: fl.RigidBody | None = None, joint_deg: tuple[float, ...] = ()) -> fl.Scene:
    """A scene of the given links, with a flat section, and gravity outside all planes of symmetry."""
    arm = fl.Arm(
        links=links, materials={"aluminium": ALUMINIUM}, sections={"flat": FLAT, "square": SQUARE},
        tip=tip or fl.RigidBody(),
    )  # fmt: skip
    initial = fl.InitialState(joint_deg=joint_deg or (0.0,) * len(links))
    return fl.Scene(name="any", arm=arm, gravity=(1.0, -3.0, 9.0), initial=initial)


def body(rng: np.random.Generator) -> fl.RigidBody:
    """A body of a few kilograms made of points in a box, with all products of inertia."""
    points = rng.uniform(-0.1, 0.1, (5, 3))
    points -= points.mean(axis=0)
    covariance = points.T @ points
    I = np.trace(covariance) * np.eye(3) - covariance
    return fl.RigidBody(mass=5.0, center=tuple(rng.uniform(-0.1, 0.1, 3)), inertia=six(I))


def six(I: np.ndarray) -> tuple[float, ...]:
    return (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])


def turned(payload: fl.RigidBody, F: np.ndarray) -> fl.RigidBody:
    """The same body, expressed in axes rotated by F."""
    return fl.RigidBody(mass=payload.mass, center=F.T @ payload.center, inertia=six(F.T @ payload.matrix @ F))


def in_other_frames(links: list[fl.Link], tip: fl.RigidBody, frames: list[np.ndarray]) -> fl.Scene:
    """The same arm, with the frame of every link rotated independently."""
    before, out = np.eye(3), []
    for link, F in zip(links, frames, strict=True):
        R = Rotation.from_euler("xyz", link.mount.rpy_deg, degrees=True).as_matrix()
        rpy = Rotation.from_matrix(before.T @ R @ F).as_euler("xyz", degrees=True)
        line = np.array(link.line or ((0, 0, 0), (link.length, 0, 0)))
        up = link.up or link.joint.axis
        out.append(
            fl.Link(
                name=link.name, mount=fl.Mount(xyz=before.T @ link.mount.xyz, rpy_deg=rpy),
                joint=fl.Joint(axis=F.T @ link.joint.axis), hub=turned(link.hub, F), end=turned(link.end, F),
                line=line @ F, up=F.T @ up, **SLENDER,
            )
        )  # fmt: skip
        before = F
    return arm_of(*out, tip=turned(tip, before))


def test_the_dynamics_do_not_depend_on_the_choice_of_link_frames(rng) -> None:
    """M, T_GC and the tip position do not change if the frame of every link is rotated at random.

    The tolerance allows about ten roundings each of mounts in degrees, axes, centres and inertias of three links.
    """
    links = [
        fl.Link(
            name=f"l{k}", mount=fl.Mount(xyz=tuple(rng.uniform(-0.3, 0.3, 3)), rpy_deg=tuple(rng.uniform(-90, 90, 3))),
            length=0.5, hub=body(rng), end=body(rng), **SLENDER,
        )
        for k in range(3)
    ]  # fmt: skip
    tip = body(rng)
    own = fl.lump(arm_of(*links, tip=tip))
    other = fl.lump(in_other_frames(links, tip, list(Rotation.random(3, rng=1).as_matrix())))
    q, qd = rng.uniform(-0.5, 0.5, own.n), rng.uniform(-1, 1, own.n)
    M = fl.mass_matrix(own, q)
    np.testing.assert_allclose(fl.mass_matrix(other, q), M, rtol=0, atol=100 * EPS * abs(M).max())
    bias = fl.bias_torque(own, q, qd)
    np.testing.assert_allclose(fl.bias_torque(other, q, qd), bias, rtol=0, atol=100 * EPS * abs(bias).max())
    np.testing.assert_allclose(fl.tip_position(other, q), fl.tip_position(own, q), rtol=0, atol=100 * EPS)
    np.testing.assert_allclose(other.stiffness, own.stiffness, rtol=10 * EPS)


@given(axes=st.tuples(directions, directions), angles=st.tuples(coordinate, coordinate))
def test_a_joint_turns_its_link_about_its_axis(axes, angles) -> None:
    """R = R₁ R₂ by Rodrigues' formula (SciPy); the second joint is at the end of the first link's line."""
    ends = ((0.1, 0.2, 0.3), (0.4, -0.2, 0.1))
    load = fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
    links = [fl.Link(name=f"l{k}", joint=fl.Joint(axis=axis), line=ends, end=load) for k, axis in enumerate(axes)]
    first, second = (
        Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis)).as_matrix()
        for axis, angle in zip(axes, angles, strict=True)
    )
    wanted = first @ (np.array(ends[1]) + second @ ends[1])
    tip = fl.tip_position(fl.lump(arm_of(*links)), np.array(angles))
    np.testing.assert_allclose(tip, wanted, rtol=0, atol=16 * EPS)


def test_a_locked_joint_gives_the_kinematics_of_a_free_joint_at_that_angle() -> None:
    axis, load = (1.0, -2.0, 0.5), fl.RigidBody(mass=1.0, center=(0.1, 0.2, 0.3), inertia=(0.1, 0.2, 0.25, 0.01, 0, 0))
    base, free = fl.Link(name="a", length=0.5), fl.Link(name="b", joint=fl.Joint(axis=axis), length=0.4, hub=load)
    locked = fl.Link(name="b", joint=fl.Joint(axis=axis, locked=True), length=0.4, hub=load)
    loose, fast = (fl.lump(arm_of(base, link, joint_deg=(0.0, 35.0))) for link in (free, locked))
    q = np.radians([20.0, 35.0])
    np.testing.assert_allclose(fl.tip_position(fast, q[:1]), fl.tip_position(loose, q), rtol=0, atol=4 * EPS)
    np.testing.assert_allclose(fl.mass_matrix(fast, q[:1]), fl.mass_matrix(loose, q)[:1, :1], rtol=16 * EPS)


@pytest.mark.parametrize("axis", [tuple(row) for row in np.vstack([np.eye(3), -np.eye(3)])])
def test_coordinate_axes_are_exact_for_vectors_of_any_length(axis) -> None:
    nearest, R = turn_to(tuple(axis))
    assert R[:, nearest].tolist() == list(axis)
    assert set(R.ravel()) <= {0.0, 1.0, -1.0}
    assert np.linalg.det(R) == 1.0
    if min(axis) == 0:
        assert R.tolist() == np.eye(3).tolist()
    for size in (2.0, 5e-324, 1e-200, 0.1, 1e308):
        assert unit("axis", tuple(size * np.array(axis))).tolist() == list(axis)


@given(directions)
def test_the_rotation_onto_an_axis_is_orthogonal(axis) -> None:
    direction = unit("axis", axis)
    nearest, R = turn_to(tuple(axis))
    np.testing.assert_allclose(R[:, nearest], direction, rtol=0, atol=4 * EPS)
    np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0, atol=16 * EPS)


def test_a_link_length_is_equivalent_to_a_line_along_the_x_axis() -> None:
    by_length = fl.lump(arm_of(fl.Link(name="a", length=0.7, **SLENDER)))
    by_line = fl.lump(arm_of(fl.Link(name="a", line=((0, 0, 0), (0.7, 0, 0)), **SLENDER)))
    assert by_length.bodies.tobytes() == by_line.bodies.tobytes()
    assert by_length.hinges.tobytes() == by_line.hinges.tobytes()


def test_the_z_axis_of_the_section_points_along_the_given_up_direction() -> None:
    """A flat bar rotated by 90° about its line equals one with height and width exchanged."""
    tall = fl.Section(shape="rectangle", height=FLAT.width, width=FLAT.height)
    turned_ = arm_of(fl.Link(name="a", length=0.7, up=(0.3, 1.0, 0.0), **{**SLENDER, "flex": "z"}))
    exchanged = turned_.varied({"link.a.up": None, "section.flat": tall, "link.a.flex": "yz"})
    soft, both = fl.lump(turned_), fl.lump(exchanged)
    np.testing.assert_allclose(soft.stiffness[1], both.stiffness[both.index("a", 1, 2)], rtol=4 * EPS)
    np.testing.assert_allclose(soft.axes[1], [0.0, 1.0, 0.0], rtol=0, atol=EPS)  # section z: bends in the X-Z plane


@pytest.mark.parametrize(
    ("axis", "stop", "z"),
    [((0, 0, 1), (1, 0, 0), (0, 0, 1)), ((0, 1, 0), (1, 0, 0), (0, 1, 0)), ((0, 1, 0), (0, 0, -1), (0, 1, 0)),
     ((1, 0, 0), (1, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, 0, 1), (0, 1, 0)), ((0, 2, 0), (0, 1, 1e-9), (0, 0, 1))],
)  # fmt: skip
def test_without_up_the_section_is_aligned_with_the_joint_axis(axis, stop, z) -> None:
    link = fl.Link(name="a", joint=fl.Joint(axis=axis), line=((0, 0, 0), stop))
    np.testing.assert_allclose(link.beam.frame[:, 2], z, rtol=0, atol=2e-9)
    np.testing.assert_allclose(link.beam.frame.T @ link.beam.frame, np.eye(3), rtol=0, atol=4 * EPS)
    assert np.linalg.det(link.beam.frame) == pytest.approx(1.0)


@given(directions, st.floats(-5.9, 0.0))
def test_a_section_frame_is_orthogonal_even_if_up_is_nearly_along_the_line(line, digits) -> None:
    """The frame is a rotation even if `up` and the line are 1e-6 rad apart; FᵀF = 1 to 8 eps."""
    x = unit("line", line)
    across = np.cross(x, np.eye(3)[np.argmin(np.abs(x))])
    up = x + 10.0**digits * across / np.linalg.norm(across)
    F = fl.Link(name="a", line=((0, 0, 0), line), up=up).beam.frame
    np.testing.assert_allclose(F.T @ F, np.eye(3), rtol=0, atol=8 * EPS)


def test_a_body_at_the_end_of_a_link_equals_a_hub_on_a_locked_joint_there(rng) -> None:
    load, line = body(rng), ((0.0, 0.1, 0.0), (0.2, 0.3, 0.6))
    at_end = fl.lump(arm_of(fl.Link(name="a", line=line, end=load, **SLENDER)))
    behind = fl.Link(name="b", joint=fl.Joint(locked=True), hub=load)
    as_hub = fl.lump(arm_of(fl.Link(name="a", line=line, **SLENDER), behind))
    assert at_end.bodies.tobytes() == as_hub.bodies.tobytes()


def test_inertia_about_an_axis_includes_the_parallel_axis_term(rng) -> None:
    """The inertia of five points is Σ m d², with their distances d from the axis."""
    points = rng.uniform(-0.1, 0.1, (5, 3))
    center, axis = points.mean(axis=0), unit("axis", (1.0, 2.0, -1.0))
    spread = points - center
    I = (spread**2).sum() * np.eye(3) - spread.T @ spread
    load = fl.RigidBody(mass=5.0, center=center, inertia=six(I))
    distances = np.linalg.norm(np.cross(axis, points), axis=1)
    assert load.about(axis) == pytest.approx((distances**2).sum(), rel=1e-14, abs=0)
    M = fl.mass_matrix(fl.lump(arm_of(fl.Link(name="a", joint=fl.Joint(axis=axis), hub=load))), np.zeros(1))
    assert M[0, 0] == pytest.approx((distances**2).sum(), rel=1e-13, abs=0)


@given(directions, st.floats(0.1, 3.0))
def test_a_disc_is_a_real_body_in_any_orientation(axis, angle) -> None:
    """One principal moment equals the sum of the other two, except for rounding."""
    R = Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
    inertia = six(R @ np.diag([0.0037238, 0.0018619, 0.0018619]) @ R.T)
    assert fl.RigidBody(mass=2.0, inertia=inertia).excess == 0


@pytest.mark.parametrize(
    ("build", "wanted"),
    [
        (lambda: fl.Joint(axis=(0, 0, 0)), "zero-direction"),
        (lambda: fl.RigidBody(mass=1.0, inertia=(1, 1)), "inertia-form"),
        (lambda: fl.Link(name="a", line=((0, 0, 0), (0, 0, 0))), "no-length"),
        (lambda: fl.Link(name="a", line=((-1e308, 0, 0), (1e308, 0, 0))), "no-length"),
        (lambda: fl.Link(name="a", line=((0, 0, 0), (1, 0, 0)), length=1.0), "both-given"),
        (lambda: fl.Link(name="a", length=1.0, up=(1, 0, 0)), "up-along-line"),
        (lambda: fl.Link(name="a", length=1.0, up=(0, 0, 0)), "zero-direction"),
        (lambda: fl.Link(name="a", flex="z", segments=3, material="m", section="s"), "needs-a-length"),
    ],
)  # fmt: skip
def test_impossible_axes_and_lines_are_refused(build, wanted) -> None:
    with refused(fl.errors.SceneError, wanted):
        build()


@pytest.mark.parametrize(
    ("mass", "inertia", "excess"),
    [
        (1.0, (1, 1, 2.1), 0.1), (1.0, (1, 1, 2 + 1e-13), 1e-13), (1.0, (1, 1, 1, 0.9, 0, 0), 0.8), (1.0, (1, 1, 2), 0),
        (0.0, (1, 1, 1, 2, 0, 0), 1), (0.0, (1, -1, 1), 1), (0.0, (0, 0, 1), 0), (1.0, (-1, -1, -1), 1),
    ],
)  # fmt: skip
def test_the_excess_is_the_distance_to_a_real_body(mass, inertia, excess) -> None:
    assert fl.RigidBody(mass=mass, inertia=inertia).excess == pytest.approx(excess, rel=2e-3)


def test_variations_can_set_axes_end_bodies_and_lines() -> None:
    scene = make_scene(fl.Link(name="a", length=0.5), fl.Link(name="b", joint=fl.Joint(locked=True), length=0.4))
    varied = scene.varied({"link.*.joint.axis": (0, 1, 0), "link.a.end.mass": 2.0, "link.a.end.center": (0, 0, 1)})
    assert [link.joint.axis for link in varied.arm.links] == [(0, 1, 0)] * 2
    assert varied.arm.links[0].end == fl.RigidBody(mass=2.0, center=(0, 0, 1))
    line = scene.varied({"link.a.length": None, "link.a.line": ((0, 0, 0), (0, 0, 1))})
    assert line.arm.links[0].beam.length == 1.0


def test_values_without_effect_get_a_note() -> None:
    lost = fl.Link(name="a", length=0.5, up=(0, 1, 0), hub=fl.RigidBody(center=(0, 0, 1)), end=fl.RigidBody(mass=1.0))
    found = notes(make_scene(lost, gravity=(0.0, 9.81, 0.0)))
    assert [note.partition(" = ")[0].removeprefix("link.a.") for note in found] == ["up", "hub.center"]
