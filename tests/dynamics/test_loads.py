"""Internal loads, strain gauges and accelerometers of an arm at rest or in motion, in the documented axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexlink as fl
from flexlink.chain.coordinates import Kind
from tests.conftest import ALUMINIUM, SQUARE, flexible, make_scene, nasty_scene, random_state
from tests.support.words import refused
from validation.random_arms import random_arm, random_tree

NASTY = fl.lump(nasty_scene())
WRENCH = np.array([10.0, -20.0, 30.0, 5.0, -4.0, 3.0])


def moving(chain: fl.Chain, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return *random_state(chain, rng), rng.uniform(-50, 50, chain.n)


def jet(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """A constant transform with its first and second time derivative, (3, 4, 4)."""
    T = np.zeros((3, 4, 4))
    T[0] = np.eye(4)
    T[0, :3, :3], T[0, :3, 3] = R, p
    return T


def times(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    return np.array([A[0] @ B[0], A[1] @ B[0] + A[0] @ B[1], A[2] @ B[0] + 2 * A[1] @ B[1] + A[0] @ B[2]])


def moved(axis: int, s: float, v: float, a: float) -> np.ndarray:
    """Jet of a joint that turns about (0 … 2) or slides along (3 … 5) a coordinate axis."""
    e = np.eye(3)[axis % 3]
    if axis >= 3:
        T = jet(np.eye(3), e * s)
        T[1:, :3, 3] = np.outer([v, a], e)
        return T
    E, T = np.cross(np.eye(3), e), jet(Rotation.from_rotvec(e * s).as_matrix(), np.zeros(3))
    R = T[0, :3, :3]
    T[1, :3, :3], T[2, :3, :3] = v * E @ R, a * E @ R + v**2 * E @ E @ R
    return T


def of_the_cut_parts(chain: fl.Chain, q, qd, qdd, wrench) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment of the outboard part on the inboard part, in frame 0: Newton, for all points ξ of the bodies.

    ∫ ẍ xᵀ dm = T̈ J Tᵀ with x = T ξ and J = ∫ ξ ξᵀ dm, homogeneous; the moment is its antisymmetric part.
    """
    T, loads = [], np.zeros((len(chain.bodies), 2, 3))
    for body in chain.bodies:
        here = jet(body["rotation"], body["translation"])
        here = times(T[body["parent"] - 1], here) if body["parent"] else here
        for k in range(body["first"], body["stop"]):
            here = times(here, moved(int(chain.hinges["axis"][k]), q[k], qd[k], qdd[k]))
        T.append(here)
    for i in reversed(range(len(T))):
        m, c, I = chain.bodies[i]["mass"], chain.bodies[i]["center"], chain.bodies[i]["inertia"]
        J = m * np.outer([*c, 1.0], [*c, 1.0])
        J[:3, :3] += np.trace(I) / 2 * np.eye(3) - I
        seen = T[i][2].copy()
        seen[:3, 3] -= chain.gravity
        B = seen @ J @ T[i][0].T
        loads[i] -= B[:3, 3], [B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]]
        if i == chain.loaded:
            loads[i] += wrench[:3], wrench[3:] + np.cross(T[i][0, :3, 3], wrench[:3])
        if parent := chain.bodies["parent"][i]:
            loads[parent - 1] += loads[i]
    points = np.array([each[0, :3, 3] for each in T])
    return loads[:, 0], loads[:, 1] - np.cross(points, loads[:, 0])  # moments about the points of the cuts


def section_of(link: fl.Link) -> np.ndarray:
    """Axes of the section in the link's frame, as NOTATION.md defines them: x along the beam, z towards `up`."""
    start, stop = link.line or ((0.0, 0.0, 0.0), link.stop)
    if not any(np.subtract(stop, start)):
        return np.eye(3)
    x = np.subtract(stop, start) / np.linalg.norm(np.subtract(stop, start))
    up = np.array(link.up or link.joint.axis)
    if np.linalg.norm(np.cross(x, up)) < 1e-6 * np.linalg.norm(up):
        up = np.eye(3)[2 if x[2] ** 2 < 0.5 else 1]
    y = np.cross(up, x) / np.linalg.norm(np.cross(up, x))
    return np.stack([x, y, np.cross(x, y)], axis=1)


def turn(axis, angle: float) -> np.ndarray:
    return Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle).as_matrix()


def sections(scene: fl.Scene, chain: fl.Chain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes of section and link at every body in frame 0, from the keys of the scene alone, (bodies, 3, 3) each."""
    found = np.array([np.eye(3)] * len(chain.bodies))
    of_link, parent, ends, x = found.copy(), "base", {"base": np.eye(3)}, (1, 0, 0)
    if chain.has_free_base:
        found[:2] = of_link[:2] = fl.frames(chain, q).rotations[:2]
        ends["base"] = found[1]
    for number, link in enumerate(scene.arm.links, 1):
        F, row, rpy = section_of(link), link.dh, link.mount.rpy or np.radians(link.mount.rpy_deg)
        R = ends[link.on or parent] @ Rotation.from_euler("xyz", rpy).as_matrix()
        α, standard = (0.0, False) if row is None else (np.radians(row.alpha_deg), row.convention == "standard")
        if row is not None:
            R = R @ turn(x, 0.0 if standard else α) @ turn((0, 0, 1), np.radians(row.theta_deg))
        if link.joint.locked and not link.joint.slides:
            R = R @ turn(link.joint.axis, np.radians(scene.initial.joint_deg[number - 1]))
        for k, c in enumerate(chain.coordinates):
            if c.link == number:
                about = (
                    np.eye(3)[c.axis - 4]
                    if c.kind is Kind.ROOT
                    else F[:, (c.axis - 1) % 3]
                    if c.segment
                    else link.joint.axis
                )
                R = R if chain.slides[k] else R @ turn(about, q[k])
                found[chain.body(k)], of_link[chain.body(k)] = R @ F, R
        ends[link.name], parent = R @ turn(x, α if standard else 0.0), link.name
        if link.name in chain.tips:
            found[chain.tips[link.name]], of_link[chain.tips[link.name]] = R @ F, ends[link.name]
    return found, of_link


@pytest.mark.parametrize("make", [random_arm, random_tree])
@pytest.mark.parametrize("seed", range(6))
def test_named_loads_in_section_axes_are_those_of_the_cut_part_on_any_arm(make, seed: int, rng) -> None:
    """Trees, tables of Denavit and Hartenberg, axes, lines and sections of every direction, cut at every body."""
    scene = make(7000 + seed)
    scene = scene.varied({f"link.{link.name}.drag": None for link in scene.arm.links if link.drag is not None})
    chain = fl.lump(scene)
    state = moving(chain, rng)
    cuts = fl.strength.internal_loads(chain, *state, tip_wrench=WRENCH)
    found = np.stack([cuts.N, cuts.V_y, cuts.V_z, cuts.T, cuts.M_y, cuts.M_z], axis=1)
    S, L = sections(scene, chain, state[0])
    F, M = (np.einsum("bji,bj->bi", S, part) for part in of_the_cut_parts(chain, *state, WRENCH))
    scale = np.linalg.norm(F, axis=1).max(), np.linalg.norm(M, axis=1).max() + np.linalg.norm(F, axis=1).max()
    assert np.abs(found[:, :3] - F).max() <= 1e-10 * scale[0]
    assert np.abs(found[:, 3:] - M).max() <= 1e-10 * scale[1]
    place, point = fl.frames(chain, state[0]).points, np.array([0.3, -0.2, 0.1])
    for body in range(len(chain.bodies)):
        there = place[body] + L[body] @ point
        at = fl.point_motion(chain, *state, body=body, point=point)
        np.testing.assert_allclose(at.position, there, atol=1e-12)
        np.testing.assert_allclose(L[body] @ at.accelerometer, at.acceleration - chain.gravity, atol=1e-9 * scale[0])
        J = fl.jacobian(chain, state[0], body=body, point=point)
        np.testing.assert_allclose(J.linear @ state[1], at.velocity, atol=1e-12 * np.abs(state[1]).sum() * chain.size)


def cantilever(lumping: str, segments: int, **fields: object) -> fl.Scene:
    """A 1.25 m aluminium beam made a million times stiffer: its sag of a few nm does not affect the loads."""
    link = flexible("boom", "yz", segments, lumping=lumping, joint=fl.Joint(locked=True))
    return make_scene(link, **fields).varied({"material.aluminium.young": 7e16})


@pytest.mark.parametrize(("lumping", "segments"), [("gauss", 5), ("paper", 6), ("clamped", 4), ("legendre", 4)])
def test_a_cantilever_has_the_textbook_bending_moment_diagram(lumping: str, segments: int) -> None:
    """With a load q down and a tip force P up, M_z = −q (L − x)²/2 + P (L − x) and V_y = −q (L − x) + P."""
    P, H = 7.0, 11.0
    scene = cantilever(lumping, segments, gravity=(0.0, -9.81, 0.0), tip=fl.RigidBody(mass=0.5))
    chain = fl.lump(scene)
    wrench = [H, P, 0.0, 0.0, 0.0, 0.0]
    rest = fl.solve_static(chain, np.zeros(chain.n), tip_wrench=wrench)
    still = np.zeros(chain.n)
    loads = fl.strength.internal_loads(chain, rest.q, still, still, tip_wrench=wrench)
    gauge = fl.strength.beam_strain(scene, rest.q, link="boom", fibre=(0.02, -0.015))
    cuts = [chain.body(f"boom.{j}.z") for j in range(1, segments)]
    q, left = SQUARE.properties.area * ALUMINIUM.density * 9.81, 1.25 - gauge.x
    M = -q * left**2 / 2 + (P - 0.5 * 9.81) * left
    EI = 7e16 * SQUARE.properties.i_z
    assert loads.moment[cuts, 2] == pytest.approx(M, rel=1e-6)
    assert loads.force[cuts, 1] == pytest.approx(-q * left + P - 0.5 * 9.81, rel=1e-6)
    assert loads.force[cuts, 0] == pytest.approx(np.full(len(cuts), H), rel=1e-6)
    assert gauge.curvature[:, 2] == pytest.approx(M / EI, rel=1e-6)
    assert gauge.strain == pytest.approx(-0.02 * M / EI, rel=1e-6)
    assert not gauge.curvature[:, 0].any()


def test_a_fibre_on_the_convex_side_of_a_bend_is_stretched() -> None:
    scene = make_scene(flexible("boom", "xyz", 5, joint=fl.Joint(locked=True)), gravity=(0.0, 0.0, 0.0))
    chain = fl.lump(scene)
    for wrench, fibre in (([0, -1, 0, 0, 0, 0], (0.02, 0.0)), ([0, 0, -1, 0, 0, 0], (0.0, 0.02))):
        q = fl.solve_static(chain, np.zeros(chain.n), tip_wrench=wrench).q
        gauge = fl.strength.beam_strain(scene, q, link=1, fibre=fibre)  # the load points away from the fibre
        other = fl.strength.beam_strain(scene, q, link=1, fibre=np.negative(fibre))
        assert (gauge.strain > 0).all()
        assert np.array_equal(other.strain, -gauge.strain)
    q = fl.solve_static(chain, np.zeros(chain.n), tip_wrench=[0, 0, 0, 6.0, 0, 0]).q
    GJ = ALUMINIUM.shear * SQUARE.properties.torsion
    assert fl.strength.beam_strain(scene, q, link="boom", fibre=(0, 0)).curvature[:, 0] == pytest.approx(
        6.0 / GJ, rel=1e-9
    )


def test_an_accelerometer_reads_minus_gravity_at_rest_and_zero_in_free_fall() -> None:
    link = fl.Link(name="a", joint=fl.Joint(axis=(0.0, 0.0, 1.0)))
    chain = fl.lump(make_scene(link, tip=fl.RigidBody(mass=1.0, center=(1.0, 0.0, 0.0)), gravity=(0.0, -9.81, 0.0)))
    still = [0.0]
    assert fl.point_motion(chain, still, still, still).accelerometer.tolist() == [0.0, 9.81, 0.0]
    qdd = fl.forward_dynamics(chain, still, still, still)  # a mass on a massless rod begins to fall freely
    fall = fl.point_motion(chain, still, still, qdd, point=(1.0, 0.0, 0.0))
    assert np.abs(fall.accelerometer).max() <= 1e-15 * 9.81
    assert fall.acceleration == pytest.approx(chain.gravity, rel=1e-15)


def test_loads_along_a_run_use_the_accelerations_of_the_run() -> None:
    """The run has a tip wrench and a prescribed joint, whose acceleration follows from its motion."""
    motion = fl.PrescribedMotion(
        link="a", times=(0.0, 1.0), angle_deg=(0.0, 0.0), rate_deg=(0.0, 0.0), acceleration_deg=(90.0, 0)
    )
    links = fl.Link(name="a", length=0.5, material="aluminium", section="square"), flexible("b", "yz", 3)
    scene = make_scene(*links, motion=(motion,), wrench=fl.Wrench(force=(1.0, 2.0, 3.0)), gravity=(0.0, -9.81, 0.0))
    run = fl.simulate(scene, duration=0.02, step=1e-4, sample=1e-3)
    assert run.tip_wrench.tolist() == [[1.0, 2.0, 3.0, 0.0, 0.0, 0.0]] * len(run.t)
    s = run.t
    wanted = np.pi / 2 * (1 - 9 * s + 18 * s**2 - 10 * s**3)  # of the quintic whose other end values are 0
    assert run.qdd[:, 0] == pytest.approx(wanted, abs=1e-10)
    loads = run.loads
    one = fl.strength.internal_loads(run.chain, run.q[9], run.qd[9], run.qdd[9], tip_wrench=run.tip_wrench[9])
    assert np.array_equal(loads.moment[9], one.moment)
    assert loads.force.shape == (len(run.t), len(run.chain.bodies), 3)
    tip = fl.frames(run.chain, run.q).rotations[:, -1] @ loads.force[:, -1, :, None]
    assert np.abs(tip[..., 0] - run.tip_wrench[0, :3]).max() <= 1e-14
    bent = fl.strength.beam_strain(scene, run.q, link="b", fibre=(0.02, 0.0))
    assert bent.strain.shape == (len(run.t), 2)
    assert np.array_equal(bent.strain[7], fl.strength.beam_strain(scene, run.q[7], link="b", fibre=(0.02, 0.0)).strain)
    path = fl.point_motion(run.chain, run.q, run.qd, run.qdd)
    assert np.abs(path.position - run.tip).max() <= 1e-15
    assert [repr(one) for one in (loads, bent, path)] == [
        "<InternalLoads: 5 cuts in 21 states>",
        "<BeamStrain: 2 hinges in 21 states>",
        "<PointMotion: one point in 21 states>",
    ]


def test_invalid_load_queries_are_refused() -> None:
    q = np.zeros(NASTY.n)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.strength.internal_loads(NASTY, q, q, [0.0])
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.strength.internal_loads(NASTY, q, np.full(NASTY.n, 1e200), q)
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.point_motion(NASTY, q, np.outer([0, 1e200], np.ones(NASTY.n)), q)
    with refused(fl.errors.ArgumentError, "out-of-range"):
        fl.point_motion(NASTY, q, q, q, body=99)
    with refused(fl.errors.ArgumentError, "unknown-joint"):
        NASTY.body("elbow")
    with refused(fl.errors.ArgumentError, "link-is-rigid"):
        fl.strength.beam_strain(nasty_scene(), q, link="rigid", fibre=(0, 0))
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.strength.beam_strain(nasty_scene(), q, link="upper", fibre=(0, 0, 0))
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.strength.beam_strain(nasty_scene(), np.zeros((2, 3)), link="upper", fibre=(0, 0))
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.strength.beam_strain(nasty_scene(), np.full((2, NASTY.n), 1e308), link="upper", fibre=(0, 0))
