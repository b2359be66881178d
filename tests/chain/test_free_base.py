"""Free-floating base: momentum is conserved, and runs continue through every attitude."""

import pickle

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.chain.rigid import matrix_from_quaternion, rates_matrices, rates_matrices_changing, rotations_of
from flexlink.common.types import Array
from flexlink.dynamics.floating_base import FloatingBase
from tests.conftest import make_scene
from tests.support.words import refused

BASE = fl.Base(kind="free", mass=3.0, center=(0.05, -0.02, 0.03), inertia=(0.2, 0.25, 0.3))
ARM = fl.Arm(
    links=(
        fl.Link(name="left", mount=fl.Mount(xyz=(0.2, 0.0, 0.0)), length=0.6, material="soft", section="rod", flex="yz",
                segments=3, joint=fl.Joint(viscous=0.01)),
        fl.Link(name="right", on="base", mount=fl.Mount(xyz=(-0.2, 0.0, 0.0), rpy_deg=(0.0, 0.0, 180.0)),
                joint=fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0)), hub=fl.RigidBody(mass=0.5)),
    ),
    materials={"soft": fl.Material(young=2e9, density=1500.0)},
    sections={"rod": fl.Section(shape="circle", diameter=0.01)},
    tip=fl.RigidBody(mass=0.2), base=BASE,
)  # fmt: skip
SPIN = fl.details.BaseState(spin_deg=(30.0, 300.0, 60.0), velocity=(0.3, -0.2, 0.1))
"""The base spins mostly about Y, whose angle reaches 90° after 0.3 s."""
START = fl.InitialState(joint_deg=(20.0, 0.0), joint_m=(0.0, 0.1), rate_deg=(50.0, 0.0), base=SPIN)


def scene(**changes: object) -> fl.Scene:
    """An arm on a free base tumbles for a second."""
    run = fl.RunSettings(method="RK4", step=5e-4, duration=1.0, sample=0.05)
    made = fl.Scene(name="tumbler", arm=ARM, initial=START, gravity=(0.0, 0.0, 0.0), run=run)
    return made.varied(changes) if changes else made


@pytest.fixture(scope="module")
def run() -> fl.Trajectory:
    """A run of the tumbling arm."""
    return fl.simulate(scene())


def test_attitude_angles_give_a_rotation_and_their_rates_the_angular_velocity() -> None:
    φ, φd, φdd, h = *np.random.default_rng(1).uniform(-1, 1, (3, 3)), 1e-6
    R, base = rotations_of(φ), FloatingBase(fl.lump(scene()))
    q, qd = np.zeros((2, 1, base.chain.n))
    q[0, 3:6], qd[0, 3:6] = φ, φd
    angles, rates, attitudes, spins = base.from_the_start(q, qd)
    assert np.abs(angles - q).max() < 1e-15 and np.abs(rates - qd).max() < 1e-15
    assert np.abs(matrix_from_quaternion(attitudes[0].tolist()) - R).max() < 1e-15
    assert np.abs(rates_matrices(φ) @ φd - spins).max() < 1e-15

    def spin(t: float) -> Array:
        angles, rates = φ + t * φd + t**2 / 2 * φdd, φd + t * φdd
        return np.asarray(rates_matrices(angles) @ rates)

    turning = R.T @ (rotations_of(φ + h * φd) - rotations_of(φ - h * φd)) / (2 * h)  # ω as a skew matrix
    assert np.abs([turning[2, 1], turning[0, 2], turning[1, 0]] - spin(0.0)).max() < 1e-9
    changing = rates_matrices(φ) @ φdd + rates_matrices_changing(φ, φd) @ φd
    assert np.abs((spin(h) - spin(-h)) / (2 * h) - changing).max() < 1e-9


def test_momentum_energy_and_quaternion_norm_are_conserved(run: fl.Trajectory) -> None:
    assert run.base is not None and run.momentum_error is not None
    assert np.abs(np.linalg.norm(run.base.attitude, axis=1) - 1).max() < 1e-15
    size, spin = np.linalg.norm(run.base.momentum.linear[0]), np.linalg.norm(run.base.momentum.spin[0])
    assert run.momentum_error[0] < 1e-11 * size and run.momentum_error[1] < 1e-11 * spin
    assert run.work is not None and np.abs(run.imbalance).max() < 1e-10 * run.energy.kinetic.max()


def test_momentum_is_that_of_its_run_whenever_it_is_first_used(run: fl.Trajectory) -> None:
    problem = fl.Problem(scene())
    first, _ = problem.simulate(), problem.simulate()
    assert run.base is not None and first.base is not None
    again = pickle.loads(pickle.dumps(first)).base.momentum
    for wanted, *found in zip(run.base.momentum, first.base.momentum, again, strict=True):
        assert all(each.tobytes() == wanted.tobytes() for each in found)
    assert "momentum" not in repr(run.base) and np.isfinite(run.columns["momentum x [N s]"]).all()


def test_the_base_passes_through_attitudes_at_which_its_angles_are_singular(run: fl.Trajectory) -> None:
    assert run.base is not None
    assert np.abs(run.q[:, 4]).max() > np.radians(80.0) and np.abs(run.qd[:, 3:6]).max() > 8.0
    before, after = run.base.attitude[:-1], run.base.attitude[1:]
    assert np.abs(np.sum(before * after, axis=1)).min() > 0.97  # cosine of half the rotation between samples


def test_coordinates_of_a_free_base_give_its_attitude_and_spin(run: fl.Trajectory) -> None:
    assert run.base is not None
    for q, qd, attitude, spin in zip(run.q, run.qd, run.base.attitude, run.base.spin, strict=True):
        R = run.chain.bodies["rotation"][1] @ rotations_of(q[3:6])
        assert np.abs(R - matrix_from_quaternion(attitude.tolist())).max() < 1e-14
        assert np.abs(rates_matrices(q[3:6]) @ qd[3:6] - spin).max() < 1e-10


@pytest.mark.parametrize("solver", ["articulated", "lu", "cholesky"])
def test_singular_attitude_angles_are_refused_by_name(solver: str) -> None:
    """The angles are singular at 90° about Y; 1e-3 rad away, accelerations are accurate to eps / cos² = 2e-10."""
    chain = fl.lump(scene())
    q, qd, tau = np.full(chain.n, 0.1), np.full(chain.n, 0.3), np.zeros(chain.n)
    for angle in (np.pi / 2, -np.pi / 2, np.pi / 2 + 1e-9, 2.5 * np.pi):
        q[4] = angle
        with refused(fl.errors.SingularMassError, "attitude-singular"):
            fl.forward_dynamics(chain, q, qd, tau, solver=solver)
        with refused(fl.errors.SingularMassError, "attitude-singular"):
            fl.forward_dynamics(chain, np.array([0 * q, q]), qd, tau, solver=solver)
    q[4] = np.pi / 2 - 1e-3
    qdd = fl.forward_dynamics(chain, q, qd, tau, solver=solver)
    left = fl.inverse_dynamics(chain, q, qd, qdd) + fl.elastic_torque(chain, q) + fl.friction_torque(chain, qd) - tau
    assert np.abs(left).max() < 1e-6 * np.abs(qdd).max()


def test_the_motion_does_not_depend_on_initial_attitude_and_velocity(run: fl.Trajectory) -> None:
    turn = np.array([0.3, -0.5, 0.7, 0.2]) / np.linalg.norm([0.3, -0.5, 0.7, 0.2])
    R, boost = matrix_from_quaternion(turn.tolist()), np.array([1.0, -2.0, 0.5])
    state = fl.details.BaseState(
        quaternion=(0.3, -0.5, 0.7, 0.2), spin_deg=SPIN.spin_deg, velocity=tuple((R @ SPIN.velocity + boost).tolist())
    )
    other = fl.simulate(scene(**{"initial.base": state}))
    moved = run.tip @ R.T + np.multiply.outer(run.t, boost)
    assert np.abs(other.tip - moved).max() < 1e-11
    assert run.base is not None and other.base is not None
    for one, turned in zip(run.base.attitude.tolist(), other.base.attitude.tolist(), strict=True):
        assert np.abs(R @ matrix_from_quaternion(one) - matrix_from_quaternion(turned)).max() < 1e-11


def test_a_simulator_and_a_law_use_base_coordinates_relative_to_the_start(run: fl.Trajectory) -> None:
    arm = fl.Simulator(scene())
    for _ in range(15):
        state = arm.step(duration=0.05)
    assert np.abs(fl.tip_position(arm.chain, state.q) - run.tip[15]).max() < 1e-12
    seen = []

    def law(t: float, q: Array, qd: Array) -> Array:
        seen.append((t, fl.tip_position(arm.chain, q)))
        return np.zeros(2)

    fl.simulate(scene(), control=law, rate=20.0)
    assert max(np.abs(tip - run.tip[round(t / 0.05)]).max() for t, tip in seen) < 1e-12


def test_a_falling_base_gains_the_momentum_of_its_weight() -> None:
    falling = fl.simulate(scene(gravity=(0.0, 0.0, -9.81)))
    assert falling.base is not None and falling.momentum_error is not None
    gained = falling.base.momentum.linear[-1] - falling.base.momentum.linear[0]
    assert np.abs(gained - [0.0, 0.0, -9.81 * falling.chain.mass]).max() < 1e-9
    assert max(falling.momentum_error) < 1e-9


def test_momentum_equals_mass_matrix_times_rates() -> None:
    chain = fl.lump(scene())
    q, qd = np.random.default_rng(3).uniform(-1, 1, (2, chain.n))
    p, found = fl.mass_matrix(chain, q) @ qd, fl.momentum(chain, q, qd)
    assert np.abs(found.linear - p[:3]).max() < 1e-14
    about_base = found.angular - np.cross(q[:3], found.linear)
    R = chain.bodies["rotation"][1] @ rotations_of(q[3:6])
    assert np.abs(rates_matrices(q[3:6]).T @ R.T @ about_base - p[3:6]).max() < 1e-14
    assert np.abs(found.center - chain.com(q)).max() < 1e-15


def test_sensitivities_stay_accurate_through_all_rotations_of_the_base() -> None:
    for changes in ({"run.duration": 0.1, "initial.base.spin_deg": (30.0, 60.0, 20.0)}, {}):
        changed = scene(**changes)
        found, h = fl.sensitivities(changed, ["tip.mass"]), 1e-5
        ahead, behind = (fl.simulate(changed.varied({"tip.mass": 0.2 + side * h})).tip for side in (1, -1))
        error = np.abs((ahead - behind) / (2 * h) - found.tip[:, :, 0]).max()
        assert error < 1e-6 * np.abs(found.tip).max() + found.tip_error[0]
    assert np.abs(found.run.q[:, 4]).max() > np.radians(70)


def test_sensitivities_of_a_base_angle_are_continuous_at_half_a_turn() -> None:
    """The sensitivity must not jump where the angle wraps around to the next turn."""
    spun = fl.InitialState(base=fl.details.BaseState(spin_deg=(0.0, 0.0, 180.0)))
    alone = fl.Arm(
        links=(fl.Link(name="a", joint=fl.Joint(locked=True), end=fl.RigidBody(mass=1.0)),),
        base=fl.Base(kind="free", mass=3.0, inertia=(0.2, 0.25, 0.3)),
    )
    found = fl.sensitivities(replace(scene(), arm=alone, initial=spun), ["initial.base.spin_deg.z"])
    np.testing.assert_allclose(np.abs(found.run.q[-1, 5]), np.pi, rtol=1e-6)
    np.testing.assert_allclose(found.q[:, 5, 0], np.radians(found.run.t), atol=1e-4)


def test_a_force_on_the_base_acts_through_a_zero_length_link() -> None:
    thruster = fl.Link(name="thruster", on="base", joint=fl.Joint(locked=True))
    left, right = ARM.links
    links = thruster, replace(left, on="base"), right
    arm = fl.Arm(links=links, materials=ARM.materials, sections=ARM.sections, tip=ARM.tip, base=BASE)
    start = fl.InitialState(joint_deg=(0.0, 0.0, 0.0))
    pushed = fl.Scene(
        name="pushed", arm=arm, initial=start, gravity=(0, 0, 0), run=scene().run,
        wrench=fl.Wrench(force=(3.0, 0.0, 0.0), on="thruster"),
    )  # fmt: skip
    pushed = fl.simulate(pushed)
    assert pushed.base is not None and pushed.momentum_error is None
    assert np.abs(pushed.base.momentum.linear[-1] - [3.0, 0.0, 0.0]).max() < 1e-9


ROD = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))


def test_the_momentum_of_a_falling_base_is_relative_to_the_start_of_its_run() -> None:
    base = fl.Base(kind="free", mass=3.0, inertia=(0.2, 0.25, 0.3))
    falling = replace(ROD, arm=replace(ROD.arm, base=base), gravity=(0.0, 0.0, -9.81))
    later = fl.simulate(falling.varied({"run.duration": 0.01, "initial.time": 2.0}))
    assert later.momentum_error is not None and max(later.momentum_error) < 1e-9
