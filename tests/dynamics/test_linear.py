"""The linear model agrees with the nonlinear equation of motion near a state."""

import sys

import numpy as np
import pytest
from scipy import linalg
from scipy.linalg import solve_continuous_are

import flexlink as fl
from flexlink import Chain, Damping, Joint, PrescribedMotion
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.vibration.derived_models import slow_part
from flexlink.dynamics.vibration.linear_model import LinearModel, graded
from flexlink.dynamics.vibration.sensor_outputs import SensorOutputs
from flexlink.errors import ArgumentError
from tests.conftest import MODELS, flexible, make_scene
from tests.support.words import refused

EPS = np.finfo(float).eps


def hanging(chain: Chain) -> Equilibrium:
    """The static equilibrium of the arm with locked joints."""
    return fl.solve_static(chain, chain.rest, locked=chain.active.tolist())


@pytest.mark.parametrize(("name", "stiffer"), [("t2_spatial", 1.0), ("t3_spatial", 1.0), ("t3_spatial", 1e4)])
def test_slow_modes_of_stiff_arms_are_accurate(name: str, stiffer: float) -> None:
    """Eigenvalues λ range from 0.003 to 2e4 1/s, and to 2e6 1/s if the links are a hundred times as fast.

    A backward stable solver changes λ of 2n rows by 2n eps ‖A‖ times the condition number 1/|yᴴx|. With graded rows
    the slowest λ changes by 2n eps of the slowest joint's row; `numpy.linalg.eigvals(A)` of the stiffer arm exceeds
    this by a factor of 30. Compared with 60-digit arithmetic, eigenvalues of A are accurate to 6e-13 of λ, and `modes`
    to 1e-12. The condition number of fast pairs that nearly coincide is known only roughly, so 1e-10 of λ is also
    allowed, 20 times the error observed with OpenBLAS.
    """
    scene = fl.load_scene(next(path for path in MODELS if path.stem == name))
    used = {link.material: scene.arm.materials[link.material] for link in scene.arm.links if link.material}
    changes = {f"material.{name}.young": stiffer * material.young for name, material in used.items()}
    changes |= {f"material.{name}.loss_time": material.loss_time / stiffer for name, material in used.items()}
    chain = fl.lump(scene.varied(changes))
    for angle in (0.0, 0.7, -2.0):
        start = np.where(np.isin(np.arange(chain.n), chain.active), angle, 0.0)
        rest = fl.solve_static(chain, start, locked=chain.active.tolist())
        model = fl.linearize(chain, rest.q, tau=rest.tau)
        eigenvalues, modes = model.eigenvalues, fl.modes(chain, rest.q).eigenvalues
        rows = graded(model.A)
        off = np.abs(eigenvalues[:, None] - modes).min(axis=0)
        λ, y, x = linalg.eig(rows, left=True, right=True)
        condition = 1 / np.abs((y.conj() * x).sum(axis=0))[np.abs(λ[:, None] - modes).argmin(axis=0)]
        assert (off <= 2 * chain.n * EPS * np.linalg.norm(rows, 2) * condition + 1e-10 * np.abs(modes)).all()
        assert off[np.abs(modes).argmin()] <= 2 * chain.n * EPS * np.abs(rows[-2:]).sum(axis=1).max()
        assert len(eigenvalues) == 2 * chain.n and (np.diff(np.abs(eigenvalues)) >= 0).all()


@pytest.mark.parametrize("turned", [0.4, 3.6])
def test_rounding_errors_of_a_motor_on_a_gear_are_no_stiffness(turned: float) -> None:
    """No spring holds the motors: ∂q̈/∂q of 1e-28 1/s², taken for stiffness, changed slow eigenvalues by up to 30 %."""
    geared = Joint(armature=0.5, gear_stiffness=3000.0)
    tilted = fl.Mount(rpy=(turned, -0.7, 1.1))
    links = flexible("a", "z", 3, joint=geared), flexible("b", "z", 3, joint=geared, mount=tilted)
    chain = fl.lump(make_scene(*links, gravity=(0.0, -9.81, 0.0)))
    rest = fl.solve_static(chain, np.where(np.isin(np.arange(chain.n), chain.active), 0.7, 0.0), locked=chain.active)
    eigenvalues, modes = fl.linearize(chain, rest.q, tau=rest.tau).eigenvalues, fl.modes(chain, rest.q).eigenvalues
    assert (np.abs(eigenvalues[:, None] - modes).min(axis=0) <= 1e-11 * np.abs(modes)).all()


def test_a_scipy_lqr_regulator_stabilizes_the_linear_model() -> None:
    chain = fl.lump(make_scene(flexible("arm", damping=Damping(ratio=0.01, at_hz=10.0)), gravity=(0.0, 9.81, 0.0)))
    rest = hanging(chain)
    model = fl.linearize(chain, rest.q, tau=rest.tau)
    P = solve_continuous_are(model.A, model.B, np.eye(2 * chain.n), np.eye(1))
    closed = np.linalg.eigvals(model.A - model.B @ model.B.T @ P)
    assert closed.real.max() < np.linalg.eigvals(model.A).real.max() < 1e-6
    assert (model.inputs, model.outputs[0]) == (("tau arm [N m]",), "tip x [m]")
    assert model.u == pytest.approx(rest.tau[[0]]) and not model.A.flags.writeable


def test_the_input_of_a_prescribed_joint_is_its_acceleration() -> None:
    motion = PrescribedMotion(
        link="a", times=(0.0, 1.0), angle_deg=(0.0, 9.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
    )
    chain = fl.lump(make_scene(flexible("a"), flexible("b", joint=Joint(viscous=1.0)), motion=(motion,)))
    q = np.zeros(chain.n)
    model = fl.linearize(chain, q, q, np.ones(chain.n), outputs=("joints",))
    assert model.inputs == ("qdd a [rad/s²]", "tau b [N m]")
    assert model.u.tolist() == [0.0, 1.0]
    assert model.B[chain.n, 0] == 1.0 and not model.A[chain.n].any()
    assert model.B[chain.n + 1 :, 0].all(), "its acceleration bends the links"


def test_unknown_outputs_of_the_linear_model_are_refused() -> None:
    chain = fl.lump(make_scene(flexible("a")))
    q = np.zeros(chain.n)
    with refused(ArgumentError, "unknown-name"):
        fl.linearize(chain, q, q, q, outputs=("tipp",))
    with refused(ArgumentError, "empty"):
        fl.linearize(chain, q, q, q, outputs=())
    with refused(ArgumentError, "wrong-type"):
        fl.linearize(chain, q, q, q, outputs="tip")
    with refused(ArgumentError, "wrong-shape"):
        fl.linearize(chain, [q], q, q)


def test_rates_and_torques_default_to_zero_in_linearize() -> None:
    chain = fl.lump(make_scene(flexible("a")))
    q = np.full(chain.n, 0.1)
    short, whole = fl.linearize(chain, q), fl.linearize(chain, q, np.zeros(chain.n), np.zeros(chain.n))
    for name in ("A", "B", "x", "u", "rate"):
        assert np.array_equal(getattr(short, name), getattr(whole, name))


ONE_PERCENT = fl.Damping(ratio=0.01, at_hz=20.0)


def arm(segments: int, damping: fl.Damping | None = None, outputs: tuple[str, ...] = ("tip", "joints")) -> LinearModel:
    """The paper's arm at rest, with motors."""
    links = ("upper", "fore")
    changes = {
        f"link.{name}.{key}": value for name in links for key, value in (("segments", segments), ("lumping", "gauss"))
    }
    changes |= {"link.*.joint.armature": 0.2} | ({} if damping is None else {"link.*.damping": damping})
    scene = fl.load_scene("models/paper_fig5.toml").varied(changes)
    chain = fl.lump(scene)
    rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=chain.active)
    return fl.linearize(chain, rest.q, tau=rest.tau, outputs=outputs)


def off(model: LinearModel, other: LinearModel, hertz: list[float]) -> float:
    """Largest difference of two frequency responses, relative to the largest response at each frequency."""
    H, h = model.frequency_response(hertz), other.frequency_response(hertz)
    return float((np.abs(H - h).max(axis=(1, 2)) / np.abs(H).max(axis=(1, 2))).max())


@pytest.mark.parametrize("damping", [None, ONE_PERCENT], ids=["undamped", "1 % damped"])
@pytest.mark.parametrize("segments", [5, 21, 51])
def test_eight_states_are_right_to_a_ten_thousandth_up_to_8_hz(segments: int, damping: fl.Damping | None) -> None:
    model = arm(segments, damping)
    small = model.reduced(8)
    assert len(small.A) == 8
    assert off(model, small, [0.1, 0.5, 2.0, 8.0]) < 1e-4
    np.testing.assert_allclose(np.abs(small.eigenvalues), np.abs(model.eigenvalues[:8]), rtol=1e-7)
    assert len(model.reduced(hertz=1.1 * np.abs(model.eigenvalues[7]) / (2 * np.pi)).A) == 8


def test_the_static_response_is_that_of_the_full_model() -> None:
    model = arm(5, ONE_PERCENT, ("tip", "joint_rates"))
    small = model.reduced(6)
    static = model.D - model.C @ np.linalg.solve(model.A, model.B)
    np.testing.assert_allclose(
        small.D - small.C @ np.linalg.solve(small.A, small.B), static, rtol=0, atol=1e-9 * abs(static).max()
    )


def test_rigid_motions_with_a_double_eigenvalue_of_zero_are_kept() -> None:
    scene = make_scene(flexible("a", "yz", 4), flexible("b", "z", 4), gravity=(0.0, 0.0, 0.0))
    chain = fl.lump(scene)
    model = fl.linearize(chain, np.zeros(chain.n), outputs=("tip", "joints"))
    small = model.reduced(8)
    assert off(model, small, [0.01, 0.1, 1.0]) < 1e-3
    assert off(model, model.reduced(len(model.A)), [0.01, 1.0, 100.0]) < 1e-6
    rigid = model.reduced(1)  # the rigid states cannot be parted
    assert len(rigid.A) == 4  # two joints, each with its angle and its speed
    np.testing.assert_allclose(np.abs(rigid.eigenvalues), 0.0, atol=1e-4)


def test_rigid_motions_are_kept_whatever_rounding_makes_of_their_eigenvalues() -> None:
    chain = fl.lump(make_scene(flexible("a", "yz", 4), flexible("b", "z", 4), gravity=(0.0, 0.0, 0.0)))
    model = fl.linearize(chain, np.zeros(chain.n), outputs=("tip", "joints"))
    rng = np.random.default_rng(0)
    for _ in range(30):
        noisy = model.A * (1.0 + 4e-16 * rng.standard_normal(model.A.shape))
        assert slow_part(noisy, model.B, model.C, 1)[0].shape == (4, 4)


def discrete_response(fine: LinearModel, inputs: np.ndarray, per: int) -> np.ndarray:
    """Outputs at every `per`-th instant of a model sampled finely, whose input changes only at these instants."""
    x, found = np.zeros(len(fine.A)), []
    for u in inputs:
        for k in range(per):
            if k == 0:
                found.append(fine.C @ x + fine.D @ u)
            x = fine.A @ x + fine.B @ u
    return np.array(found)


@pytest.mark.parametrize("delay", [0.0, 0.003, 0.01, 0.025])
def test_a_sampled_model_equals_one_sampled_ten_times_as_fast(delay: float) -> None:
    """With fine sampling, all delays are whole; two sensors are 4 and 13 ms late, and one is filtered."""
    sensors = (
        fl.Sensor(name="encoder", kind="joint", link="a", delay=0.004),
        fl.Sensor(name="gyro", kind="gyroscope", link="b", delay=0.013, low_pass=20.0),
        fl.Sensor(name="load", kind="torque", link="a"),
    )
    scene = make_scene(flexible("a", segments=3), flexible("b", segments=3), gravity=(0.0, 0.0, 0.0), sensor=sensors)
    chain = fl.lump(scene)
    model = fl.linearize(chain, np.zeros(chain.n), outputs=("tip", SensorOutputs(scene)))
    slow = model.reduced(8)  # so that rounding is not amplified by stiff states
    inputs = np.random.default_rng(1).standard_normal((12, 2))
    coarse, fine = slow.sampled(100.0, delay), slow.sampled(1000.0, delay)
    wanted = discrete_response(fine, inputs, 10)
    np.testing.assert_allclose(discrete_response(coarse, inputs, 1), wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_sampled_models_and_their_poles_are_those_of_python_control() -> None:
    control = pytest.importorskip("control")
    model = arm(5, ONE_PERCENT)
    other, own = control.c2d(model.control(), 0.01), model.sampled(100.0)
    for name in "ABCD":
        np.testing.assert_allclose(getattr(own, name), getattr(other, name), rtol=0, atol=1e-9)
    late, T = model.sampled(100.0, 0.02), 0.01
    delayed = control.ss([], [], [], np.eye(2), T)
    for _ in range(2):
        step = control.ss(np.zeros((2, 2)), np.eye(2), np.eye(2), np.zeros((2, 2)), T)
        delayed = control.series(delayed, step)
    whole = control.series(delayed, other)
    for ω in (1.0, 30.0, 200.0):
        (H,) = late.frequency_response([ω / (2 * np.pi)])
        wanted = whole(np.exp(1j * ω * T))
        np.testing.assert_allclose(H, wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(5))
def test_python_control_designs_and_analyses_reduced_models(seed: int) -> None:
    control = pytest.importorskip("control")
    random = np.random.default_rng(seed)
    damping = ONE_PERCENT if seed % 2 else None
    model = arm(int(random.integers(3, 15)) * 2 + 1, damping).reduced(12)
    system = model.control()
    assert system.input_labels == list(model.inputs)
    assert system.output_labels == list(model.outputs)
    np.testing.assert_array_equal(system.operating_point["y"], model.y)
    K, _, poles = control.lqr(system, np.eye(len(model.A)), 1e-2 * np.eye(2))
    assert poles.real.max() < 0
    assert K.shape == (2, len(model.A))
    loop = control.ss(model.A, model.B[:, :1], K[:1], 0)
    assert np.isfinite(control.margin(loop)[1])
    assert np.isfinite(control.frequency_response(loop, np.logspace(-1, 3, 50)).magnitude).all()
    stable = control.ss(model.A - model.B @ K, model.B, model.C, model.D)
    assert np.isfinite(control.step_response(stable, np.linspace(0, 1, 20)).outputs).all()


def test_scipy_gets_the_same_matrices() -> None:
    model = arm(3)
    for one in (model, model.reduced(6).sampled(100.0)):
        system = one.scipy()
        np.testing.assert_array_equal(system.A, one.A)
        assert (system.dt or 0.0) == one.dt


def test_what_a_model_cannot_do_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    model = arm(3)
    with refused(fl.errors.ArgumentError, "wrong-type"):
        model.sampled(100.0).sampled(100.0)
    with refused(fl.errors.ArgumentError, "both-given"):
        model.reduced()
    with refused(fl.errors.ArgumentError, "out-of-range"):
        model.reduced(100)
    with refused(fl.errors.ArgumentError, "out-of-range"):
        model.sampled(0.0)
    late = fl.Sensor(name="encoder", kind="joint", link="a", delay=0.004)
    scene = make_scene(flexible("a", segments=3), sensor=(late,))
    chain = fl.lump(scene)
    delayed = fl.linearize(chain, np.zeros(chain.n), outputs=(SensorOutputs(scene),))
    with refused(fl.errors.ArgumentError, "delayed-output"):
        delayed.scipy()
    monkeypatch.setitem(sys.modules, "control", None)
    with refused(fl.errors.MissingDependencyError, "package-missing"):
        model.control()


def test_many_postures_give_the_models_of_single_ones(chain: fl.Chain, rng: np.random.Generator) -> None:
    q, qd, tau = rng.normal(size=(3, 5, chain.n)) * 0.3
    models = fl.linearize_many(chain, q, qd, tau, outputs=("tip", "joints"), tip_force=True)
    for model, *state in zip(models, q, qd, tau, strict=True):
        single = fl.linearize(chain, *state, outputs=("tip", "joints"), tip_force=True)
        for part in ("A", "B", "C", "D", "x", "u", "y", "rate"):
            np.testing.assert_allclose(getattr(model, part), getattr(single, part), rtol=1e-12, atol=1e-12)
        assert (model.states, model.inputs, model.outputs) == (single.states, single.inputs, single.outputs)
    still = fl.linearize_many(chain, q)
    np.testing.assert_allclose(still[1].A, fl.linearize(chain, q[1]).A, rtol=1e-12, atol=1e-9)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.linearize_many(chain, q[0])


def damped_arm() -> fl.Scene:
    """An arm in a horizontal plane whose links and joints, on springs, are damped."""
    joint = fl.Joint(armature=0.5, viscous=2.0, gear_stiffness=2e3, gear_damping=1.0)
    links = (flexible(name, "z", 6, joint=joint) for name in "ab")
    scene = make_scene(*links, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(-90.0, 0.0)))
    return scene.varied({"link.*.damping": fl.Damping(ratio=0.02, at_hz=5.0)})


@pytest.mark.parametrize("states", [2, 4, 6, 9])
def test_the_error_of_a_balanced_model_is_between_its_bounds(states: int) -> None:
    """It is at least the largest Hankel singular value left out, and at most twice the sum (Glover 1984)."""
    scene = damped_arm()
    chain = fl.lump(scene)
    q = fl.initial_state(scene, chain)[0]
    full = fl.linearize(chain, q, outputs=("joints", "tip_rate")).reduced(20)
    small, bound = full.balanced(states)
    hertz = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 4000)])
    error = np.linalg.norm(full.frequency_response(hertz) - small.frequency_response(hertz), ord=2, axis=(1, 2))
    _, next_bound = full.balanced(states + 1)
    σ = (bound - next_bound) / 2  # the largest one left out
    assert len(small.A) == states and small.states[0] == "balanced 1"
    assert 0.99 * σ < error.max() < 1.0001 * bound
    assert error[0] < 1e-9 * np.abs(full.frequency_response([0.0])).max(), "the static gain is kept"
    assert np.linalg.eigvals(small.A).real.max() < 0


def test_balancing_leaves_out_what_no_output_shows() -> None:
    """The joint of a link in the vertical plane moves the tip across the plane at no frequency."""
    scene = damped_arm()
    chain = fl.lump(scene)
    model = fl.linearize(chain, fl.initial_state(scene, chain)[0], outputs=("joints",))
    small, bound = model.balanced(8)
    hertz = np.geomspace(0.01, 20.0, 200)
    expected = model.frequency_response(hertz)
    error = np.linalg.norm(expected - small.frequency_response(hertz), ord=2, axis=(1, 2))
    assert error.max() < bound + 1e-3 * np.abs(expected).max()


def test_an_unstable_or_undamped_model_is_not_balanced() -> None:
    scene = damped_arm()
    chain = fl.lump(scene)
    standing = fl.linearize(chain, np.radians([90.0, *np.zeros(chain.n - 1)]), outputs=("joints",))
    with refused(fl.errors.ArgumentError, "not-stable"):
        standing.balanced(4)
    with refused(fl.errors.ArgumentError, "out-of-range"):
        standing.balanced(0)
