"""O(n) forward dynamics agrees with the LU solution, within bounds for rounding errors, for every kind of chain."""

import dataclasses

import mpmath
import msgspec
import numpy as np
import pytest

from flexlink import (
    Chain,
    Joint,
    Link,
    Mount,
    RigidBody,
    bias_torque,
    elastic_torque,
    forward_dynamics,
    friction_torque,
    inverse_dynamics,
    lump,
    mass_matrix,
)
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import EPS
from flexlink.kernels.forward import solvers
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT, layout_of
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.lanes import LANES, put_at
from flexlink.kernels.tools.sincos import LIMIT, cos_sin_all
from tests.conftest import compiled, flexible, make_scene, random_state
from validation.oracles import spatial_chain
from validation.random_arms import random_arm, random_tree

SKEW = Mount(rpy_deg=(-75.0, 20.0, 30.0), xyz=(0.1, -0.2, 0.3))
ROTOR = Joint(viscous=0.3, coulomb=0.7, armature=0.4)


def spatial(chain: Chain, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Accelerations by the spatial recursion, even for planar chains."""
    return solvers.ARTICULATED.accelerations(chain.arrays, wrench, q, qd, tau)


def assert_as_lu(chain: Chain, rng: np.random.Generator, states: int = 5) -> None:
    """Check that the chain's usual recursion and the spatial one agree with LU within the bound for rounding."""
    for _ in range(states):
        q, qd = random_state(chain, rng)
        tau, wrench = rng.normal(size=chain.n), rng.normal(size=6)
        lu = forward_dynamics(chain, q, qd, tau, solver="lu", tip_wrench=wrench)
        chosen = forward_dynamics(chain, q, qd, tau, solver="articulated", tip_wrench=wrench)
        for solution in (chosen, spatial(chain, q, qd, tau, wrench)):
            assert (
                rounding.acceleration_error(chain, q, qd, tau, solutions=(solution, lu), tip_wrench=wrench).max() <= 1
            )


@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
@pytest.mark.parametrize("segments", [2, 3, 10])
@pytest.mark.parametrize("mount", [Mount(rpy_deg=(-90.0, 0.0, 0.0)), SKEW])
@pytest.mark.parametrize("joint", [Joint(), ROTOR])
def test_two_flexible_links_agree_with_lu(flex: str, segments: int, mount: Mount, joint: Joint, rng) -> None:
    links = flexible("upper", flex, segments, mount=mount, joint=joint), flexible("fore", flex, segments, joint=joint)
    assert_as_lu(lump(make_scene(*links, gravity=(3.0, -4.0, 8.0))), rng)


def test_rotors_and_friction_on_passive_hinges_agree_with_lu(rng: np.random.Generator) -> None:
    chain = lump(make_scene(flexible("upper", "xyz", 5, mount=SKEW), flexible("fore", "z", 4)))
    hinges = chain.hinges.copy()
    hinges["armature"] = rng.uniform(0.0, 1e-3, chain.n) * (rng.uniform(size=chain.n) < 0.4)
    hinges["coulomb"], hinges["coulomb_width"], hinges["rest"] = 0.3, 0.1, rng.normal(size=chain.n)
    assert_as_lu(dataclasses.replace(chain, hinges=hinges), rng)


@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
def test_prescribed_hinges_keep_their_accelerations(flex: str, rng: np.random.Generator) -> None:
    """Prescribed accelerations are unchanged; free accelerations and torques at prescribed hinges agree with LU.

    With prescribed hinges p and free hinges f, the bound for rounding applies to M_ff Δq̈_f and Δτ_p − M_pf Δq̈_f.
    """
    chain = lump(make_scene(flexible("upper", flex, 5, mount=SKEW, joint=ROTOR), flexible("fore", flex, 4)))
    hinges = chain.hinges.copy()
    hinges["prescribed"] = rng.uniform(size=chain.n) < 0.4
    hinges["prescribed"][0] = 1  # this joint has a rotor and friction
    chain = dataclasses.replace(chain, hinges=hinges)
    p, f = (np.flatnonzero(hinges["prescribed"] == value) for value in (1, 0))
    q, qd, tau, given = rng.uniform(-0.5, 0.5, (4, chain.n))
    wrench = rng.normal(size=6)
    every = [solvers.LU, solvers.ARTICULATED] + [solvers.PLANAR] * chain.is_planar
    taus, results = ([part.copy() for _ in every] for part in (tau, given))
    for solver, torque, qdd in zip(every, taus, results, strict=True):
        solve(wrench, q, qd, torque, qdd, solver.workspace(chain.arrays), np.empty(1))
    M, explained = mass_matrix(chain, q), rounding.of_residual(chain, q, qd, results[0], taus[0], tip_wrench=wrench)
    amplification = 1 + np.abs(M[np.ix_(p, f)] @ np.linalg.inv(M[np.ix_(f, f)])).sum(axis=1)
    for torque, qdd in zip(taus, results, strict=True):
        np.testing.assert_array_equal(qdd[p], given[p])
        np.testing.assert_array_equal(torque[f], tau[f])
        assert np.abs(M[np.ix_(f, f)] @ (qdd - results[0])[f]).max() <= explained
        assert (np.abs(torque - taus[0])[p] <= amplification * explained).all()
        residual = (
            inverse_dynamics(chain, q, qd, qdd, tip_wrench=wrench)
            + elastic_torque(chain, q)
            + friction_torque(chain, qd)
        )
        assert (np.abs(residual - torque)[p] <= amplification * explained).all()


@kernel
def solve(wrench, q, qd, tau, qdd, work, power):
    put_at(power, solvers.forward_dynamics(wrench, q, qd, tau, qdd, work), 0)


@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
def test_returned_power_equals_the_power_of_drive_friction_and_tip_moment_torques(flex: str, rng) -> None:
    chain = lump(make_scene(flexible("upper", flex, 5, mount=SKEW, joint=ROTOR), flexible("fore", flex, 4)))
    q, qd, tau = rng.uniform(-1, 1, (3, chain.n))
    wrench = rng.normal(size=6)
    moment = np.concatenate([np.zeros(3), wrench[3:]])
    power = qd @ (bias_torque(chain, q, qd) - bias_torque(chain, q, qd, tip_wrench=moment))
    explained = np.abs(qd).sum() * rounding.of_bias_torque(chain, q, qd, tip_wrench=moment)
    assert abs(power) > 1e6 * explained
    given = qd @ (tau - friction_torque(chain, qd))
    explained += 10 * chain.n * rounding.EPS * np.abs(qd * tau).sum()
    for solver in [solvers.LU, solvers.ARTICULATED] + [solvers.PLANAR] * chain.is_planar:
        work = solver.workspace(chain.arrays)
        solve(wrench, q, qd, tau.copy(), np.zeros(chain.n), work, found := np.empty(1))
        assert abs(found[0] - (given + power)) <= explained


TURNED_BY = (0.0, 35.0, 0.0, 1.0, 180.0, 90.0, 1e-7, 0.0)  # rotation [°] of the last link's mount about X, per lane
TURNED_ARMS = {
    "T1": (Link(name="waist"), flexible("a", "z", 3, mount=SKEW), flexible("b", "z", 3)),
    "T2 and T1": (flexible("a", "yz", 3), flexible("b", "z", 3)),
    "T3 and T2": (flexible("a", "xyz", 3), flexible("b", "yz", 3)),
}


@pytest.mark.parametrize("name", TURNED_ARMS)
@pytest.mark.parametrize("order", [1, -1])
def test_arms_with_and_without_rotated_mounts_run_side_by_side(name: str, order: int, rng: np.random.Generator) -> None:
    """Working axes restart in some lanes only; in every lane the accelerations equal those of a single run exactly."""
    *links, last = TURNED_ARMS[name]
    mounts = [Mount(rpy_deg=(angle, 0.0, 0.0), xyz=(0.1, 0.0, 0.2)) for angle in TURNED_BY[::order]]
    chains = [lump(make_scene(*links, msgspec.structs.replace(last, mount=mount))) for mount in mounts]
    assert len({tuple(chain.bodies["turned"]) for chain in chains}) == 2
    q, qd, tau = rng.uniform(-3, 3, (3, LANES, chains[0].n))
    for chain, row, *state in zip(chains, forward_dynamics(chains, q, qd, tau), q, qd, tau, strict=True):
        np.testing.assert_array_equal(row, forward_dynamics(chain, *state))


def ways(*links: Link, **fields: object) -> list[int]:
    chain = lump(make_scene(*links))
    hinges = chain.hinges.copy()
    for name, value in fields.items():
        hinges[name] = value
    return layout_of(chain.bodies, hinges)[:, LAYOUT.group].tolist()


def test_each_kind_of_hinge_group_is_eliminated_by_its_own_algorithm() -> None:
    """The first body is at the joint, and the last is the tip frame."""
    assert ways(flexible("a", "z", 3)) == [GROUP.along, GROUP.along, GROUP.along, GROUP.tip]
    assert ways(flexible("a", "yz", 3)) == [GROUP.along, GROUP.pair, GROUP.pair, GROUP.tip]
    assert ways(flexible("a", "xyz", 3)) == [GROUP.along, GROUP.triple, GROUP.triple, GROUP.tip]
    assert ways(flexible("a", "yz", 3, lumping="gauss")) == [
        GROUP.along,
        GROUP.pair,
        GROUP.pair,
        GROUP.tip,
    ]  # hinges Y, Z at one point, and Z, Y at the next
    assert ways(flexible("a", "z", 3), armature=0.1) == [GROUP.along, GROUP.along, GROUP.along, GROUP.tip]
    for flex in ("yz", "xyz"):
        assert ways(flexible("a", flex, 3), armature=0.1) == [GROUP.along, GROUP.hinges, GROUP.hinges, GROUP.tip]
        assert ways(flexible("a", flex, 3), prescribed=1) == [GROUP.hinges, GROUP.hinges, GROUP.hinges, GROUP.tip]
        for axis in (0, 1, 2):  # all hinges about the same axis
            assert ways(flexible("a", flex, 3), axis=axis)[1:3] == [GROUP.hinges, GROUP.hinges]


def test_working_axes_begin_where_a_single_hinge_is_not_about_z() -> None:
    roll, yaw = Mount(rpy_deg=(-90.0, 0.0, 0.0)), Mount(rpy_deg=(0.0, 0.0, 30.0))
    bending = flexible("a", "z", 3, mount=roll), flexible("b", "z", 2, mount=yaw)
    chain = lump(make_scene(Link(name="waist"), *bending, flexible("c", "yz", 2), flexible("d", "z", 2)))
    begin = np.flatnonzero(layout_of(chain.bodies, chain.hinges)[:, LAYOUT.restart])
    assert [chain.joint_name(chain.bodies["first"][i]) for i in begin] == ["a", "d"]


def test_hinge_pairs_in_either_order_handle_bodies_with_products_of_inertia(rng: np.random.Generator) -> None:
    chain = lump(make_scene(flexible("a", "yz", 5, mount=SKEW, lumping="gauss")))
    assert {tuple(chain.hinges["axis"][b["first"] : b["stop"]]) for b in chain.bodies} >= {(1, 2), (2, 1)}
    bodies = chain.bodies.copy()
    B = rng.normal(size=(len(bodies), 3, 3))
    bodies["inertia"][:-1] += (0.1 * B @ B.transpose(0, 2, 1))[:-1]
    assert_as_lu(dataclasses.replace(chain, bodies=bodies), rng)


def test_hinge_groups_of_every_kind_may_follow_each_other_without_a_joint(rng: np.random.Generator) -> None:
    """Groups of two, three and two axes follow each other; data from the outer pair must not reach the inner pair."""
    held = Joint(locked=True)
    a, b, c = (
        flexible(name, flex, 3, mount=SKEW, joint=held) for name, flex in zip("abc", ("yz", "xyz", "yz"), strict=True)
    )
    chain = lump(make_scene(a, b, c))
    assert layout_of(chain.bodies, chain.hinges)[:, LAYOUT.group].tolist() == [
        GROUP.pair,
        GROUP.pair,
        GROUP.triple,
        GROUP.triple,
        GROUP.pair,
        GROUP.pair,
        GROUP.tip,
    ]
    assert_as_lu(chain, rng)


@pytest.mark.parametrize("axes", [(0, 1, 0), (2, 0, 2), (1, 2, 0), (2, 1, 0), (0, 2, 1)])
def test_groups_of_three_hinges_work_in_any_axis_order(axes: tuple[int, ...], rng: np.random.Generator) -> None:
    chain = lump(make_scene(flexible("a", "xyz", 5, mount=SKEW)))
    hinges = chain.hinges.copy()
    hinges["axis"][4:7], hinges["axis"][10:13] = axes, axes
    assert_as_lu(dataclasses.replace(chain, hinges=hinges), rng)


def test_chains_with_and_without_rotors_in_hinge_groups_do_not_run_side_by_side() -> None:
    chain = lump(make_scene(flexible("a", "xyz", 3)))
    for k, alike in ((0, True), (2, False)):  # hinge 0, the joint, is not part of a group
        hinges = chain.hinges.copy()
        hinges["armature"][k] = 0.1
        assert chain.same_layout(dataclasses.replace(chain, hinges=hinges)) is alike


def test_tips_with_and_without_inertia_run_side_by_side(rng: np.random.Generator) -> None:
    """In a hand-made chain the last body, normally a massless tip frame, may have inertia."""
    light = lump(make_scene(flexible("a", "xyz", 3, mount=SKEW)))
    bodies = light.bodies.copy()
    bodies[-1]["mass"] = 0.5
    heavy = dataclasses.replace(light, bodies=bodies)
    q, qd, tau = rng.uniform(-1, 1, (3, 2, light.n))
    for pair in ((light, heavy), (heavy, light)):
        for chain, row, *state in zip(pair, forward_dynamics(pair, q, qd, tau), q, qd, tau, strict=True):
            lu = forward_dynamics(chain, *state, solver="lu")
            assert rounding.acceleration_error(chain, *state, solutions=(row, lu)).max() <= 1


def relative_error(chain: Chain, *state: np.ndarray) -> float:
    [truth] = spatial_chain.accelerations(chain, state)
    return float(np.abs(forward_dynamics(chain, *state) - truth).max() / np.abs(truth).max())


@pytest.mark.parametrize(("flex", "segments"), [("z", 16), ("yz", 8)])
@pytest.mark.parametrize("bend", [0.01, 1.0])
def test_long_arms_on_a_vertical_first_joint_keep_their_accuracy(flex: str, segments: int, bend: float, rng) -> None:
    """The limit n eps is one rounding per body. An earlier version, which mixed inertia axes, had errors of 100 eps."""
    links = flexible("a", flex, segments, mount=Mount(rpy_deg=(-90.0, 0.0, 0.0))), flexible("b", flex, segments)
    chain = lump(make_scene(Link(name="waist"), *links))
    passive = chain.stiffness > 0
    q, qd = rng.uniform(-1, 1, (2, chain.n)) * np.where(passive, bend, 1.0)
    assert relative_error(chain, q, qd, rng.normal(size=chain.n)) <= chain.n * EPS


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-8, 0.0])
def test_unsprung_hinge_groups_at_gimbal_lock_keep_their_accuracy(distance: float, rng: np.random.Generator) -> None:
    """Hinges X and Z of a group are aligned: M is singular to within rounding, but the motion is regular."""
    chain = lump(make_scene(flexible("a", "xyz", 4, mount=SKEW, joint=ROTOR), flexible("b", "xyz", 3)))
    q, qd, tau = rng.uniform(-0.3, 0.3, (3, chain.n))
    q[[2, 8]], q[11] = np.pi / 2 - distance, distance - np.pi / 2
    assert relative_error(chain, q, qd, tau) <= 1e-14


def test_accelerations_with_a_fixed_body_within_the_chain_agree_with_lu(rng: np.random.Generator) -> None:
    chain = lump(make_scene(flexible("upper", "xyz", 5, mount=SKEW), flexible("fore", "z", 4)))
    fixed = chain.bodies[3:4].copy()
    fixed["first"], fixed["stop"] = chain.bodies["first"][4], chain.bodies["first"][4]
    bodies = np.concatenate([chain.bodies[:4], fixed, chain.bodies[4:]])
    assert_as_lu(dataclasses.replace(chain, bodies=bodies), rng)


@compiled
@pytest.mark.parametrize("make", [random_arm, random_tree])
@pytest.mark.parametrize("seed", range(20))
def test_random_arms_and_trees_agree_with_lu(make, seed: int) -> None:
    assert_as_lu(lump(make(seed)), np.random.default_rng(seed), states=2)


PLANAR = {
    "one link": ((flexible("a", "z", 6),), True),
    "skew base": ((flexible("a", "z", 6, mount=SKEW), flexible("b", "z", 3)), True),
    "opposite axes": ((flexible("a", "z", 4), flexible("b", "z", 4, mount=Mount(rpy_deg=(180.0, 0.0, 25.0)))), True),
    "offset along the axes": ((flexible("a", "z", 3), flexible("b", "z", 3, mount=Mount(xyz=(0.1, 0.2, 0.7)))), True),
    "rigid links": ((flexible("a", "rigid", 1), flexible("b", "rigid", 1)), True),
    "locked cross joint": (
        (Link(name="waist", joint=Joint(locked=True)), flexible("a", "z", 4, mount=Mount(rpy_deg=(-90.0, 0.0, 0.0)))),
        True,
    ),
    "free cross joint": ((Link(name="waist"), flexible("a", "z", 4, mount=Mount(rpy_deg=(-90.0, 0.0, 0.0)))), False),
    "slightly skew": ((flexible("a", "z", 4), flexible("b", "z", 4, mount=Mount(rpy_deg=(1e-9, 0.0, 0.0)))), False),
    "two bending planes": ((flexible("a", "yz", 4),), False),
    "twist": ((flexible("a", "xyz", 4),), False),
}


@pytest.mark.parametrize("name", PLANAR)
def test_planar_chains_are_recognised_and_agree_with_the_spatial_recursion(name: str, rng: np.random.Generator) -> None:
    links, planar = PLANAR[name]
    for joint in (Joint(), ROTOR):
        free = [link if link.joint.locked else msgspec.structs.replace(link, joint=joint) for link in links]
        tip = RigidBody(mass=0.5, inertia=(0.1, 0.2, 0.3))
        chain = lump(make_scene(*free, tip=tip, gravity=(3.0, -4.0, 8.0)))
        assert chain.is_planar is planar
        assert_as_lu(chain, rng)


@compiled
@pytest.mark.parametrize("flex", ["z", "xyz"])
def test_accelerations_of_a_long_chain_satisfy_its_equation_of_motion(flex: str, rng: np.random.Generator) -> None:
    """For n = 10,000, inverse dynamics returns the torques with an error of at most eps |M| |q̈| ≤ eps m L² Σ |q̈|."""
    chain = lump(make_scene(flexible("a", flex, 3334 if flex == "xyz" else 10_000, mount=SKEW)))
    q, qd, tau = rng.uniform(-0.01, 0.01, chain.n), rng.uniform(-0.1, 0.1, chain.n), rng.normal(size=chain.n)
    qdd = forward_dynamics(chain, q, qd, tau)
    residual = inverse_dynamics(chain, q, qd, qdd) + elastic_torque(chain, q) + friction_torque(chain, qd) - tau
    inertia = chain.bodies["mass"].sum() * 1.25**2
    assert np.abs(residual).max() <= EPS * inertia * np.abs(qdd).sum()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0, LIMIT, 1e9])
def test_cosine_and_sine_are_accurate_to_one_ulp(scale: float, rng: np.random.Generator) -> None:
    """Results are compared with 60-digit values, also close to multiples of π/2, where all digits of π/2 matter."""
    x = np.concatenate([rng.uniform(-scale, scale, 500), np.rint(rng.uniform(-scale, scale, 500)) * np.pi / 2])
    cosines, sines = np.empty_like(x), np.empty_like(x)
    cos_sin_all(x, cosines, sines)
    with mpmath.workdps(60):
        for computed, exact in ((cosines, mpmath.cos), (sines, mpmath.sin)):
            for angle, value in zip(x.tolist(), computed.tolist(), strict=True):
                assert abs(value - exact(mpmath.mpf(angle))) <= np.spacing(abs(value))
