"""Dense output of implicit steps gives accurate samples and work, also after torque jumps."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate._ivp import dop853_coefficients as published

import flexlink as fl
from flexlink.common.errors import SceneError
from flexlink.describe.schemes.methods import method
from flexlink.motion.step_workspace import dense_weights
from tests.campaigns.random_jumps import WRONG, outcome
from tests.conftest import ROOT, compiled, flexible, make_scene
from tests.describe.test_methods import from_file
from validation.oracles.rooted_trees import inside

pytestmark = compiled
IMPLICIT = ("Radau5", "Radau9")


def struck(tolerance: float, torque: float = 1.5) -> fl.Scene:
    """A 1 m beam with a tip mass of 2 kg falls from the horizontal; a torque starts at 0.5 s."""
    beam = fl.Link(name="beam", length=1.0, flex="z", segments=5, material="aluminium", section="bar",
                   mount=fl.Mount(rpy_deg=(90.0, 0.0, 0.0)))  # fmt: skip
    return fl.Scene(
        name="struck",
        arm=fl.Arm(
            links=(beam,), materials={"aluminium": fl.Material(young=70e9, density=2700.0)},
            sections={"bar": fl.Section(shape="rectangle", height=0.03, width=0.03)}, tip=fl.RigidBody(mass=2.0),
        ),
        gravity=(0.0, 0.0, -9.81),
        initial=fl.InitialState(joint_deg=(0.0,)),
        drive=fl.Drive(kind="table", times=(0.0, 0.5), torques=((0.0,), (torque,)), hold=True),
        run=fl.RunSettings(method="auto", tolerance=tolerance, duration=2.0, sample=0.05),
    )  # fmt: skip


@pytest.mark.parametrize("name", IMPLICIT)
def test_dense_output_at_the_end_of_a_step_equals_the_step_result(name: str) -> None:
    """β(1) = b, α(1) = b A and β(c) = A, with the coefficients A, b and c of the collocation method."""
    (A, b, c), s = method(name).arrays, method(name).stages
    once, twice = dense_weights(c)
    powers = c[:, None] ** np.arange(s)
    assert np.abs(once.sum(axis=1) - b).max() < 1e-12
    assert np.abs(twice.sum(axis=1) - b @ A).max() < 1e-12
    assert np.abs((powers * c[:, None]) @ once.T - A).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_every_sample_after_a_jump_of_torque_is_within_the_tolerance(name: str, tolerance: float) -> None:
    """An earlier version used q̈ at the jump, which is due to unresolved vibrations, and had errors of 1.1 m."""
    scene = struck(tolerance)
    run, exact = fl.simulate(scene, method=name), fl.simulate(scene, method="DOP853", tolerance=1e-9)
    assert np.linalg.norm(run.tip - exact.tip, axis=1).max() < tolerance
    assert np.abs(run.imbalance).max() < 0.01 * run.exchanged.max()
    assert not run.warnings


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [2e-3, 2e-4, 2e-6])
def test_a_small_move_of_a_heavy_rotor_causes_no_energy_warning(tolerance: float) -> None:
    """A rotor of 100 kg m² is moved by 0.9°; an earlier version computed the work from outdated stages."""
    wheel = fl.Link(name="wheel", length=0.2, flex="rigid", joint=fl.Joint(armature=100.0))
    scene = make_scene(wheel, tip=fl.RigidBody(mass=1.0)).varied({
        "drive": fl.Drive(kind="pd", kp=(4e4,), kd=(2.8e3,), reference=fl.Reference(
            profile="hold", times=(0.0, 0.7), angle_deg=((0.0,), (0.9,)))),
        "initial.joint_deg": (0.0,),
        "run": fl.RunSettings(method="Radau5", tolerance=tolerance, duration=2.0, sample=0.05),
    })  # fmt: skip
    run, exact = fl.simulate(scene), fl.simulate(scene, method="DOP853", tolerance=1e-10)
    assert np.linalg.norm(run.tip - exact.tip, axis=1).max() < tolerance
    assert not run.warnings
    if tolerance < 1e-3 * np.ptp(exact.tip[:, 1]):
        assert np.abs(run.imbalance).max() < 0.01 * run.exchanged.max()


@pytest.mark.slow
def test_a_loose_tolerance_does_not_cost_more_than_a_tight_one() -> None:
    """Errors of stiff vibrations shrink only once a step resolves them: steps that damp them are not rejected for them.

    An earlier version took 1,659 steps at 1e-2 m; without ignoring them 415 evaluations are needed at 3e-3 m.
    """
    loose, tight = (fl.simulate(struck(tolerance), method="Radau9").steps for tolerance in (1e-2, 3e-3))
    assert loose.evaluations <= tight.evaluations < 320


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 5, 295, 383])
def test_samples_stay_accurate_after_random_torque_jumps(seed: int) -> None:
    """In seeds 295 and 383, with fixed steps from rest, an earlier version computed the work from outdated stages."""
    found = outcome(seed)
    assert found.word == "right", found
    assert max(found.tip, found.rates, found.work) < WRONG


@pytest.mark.parametrize("change", [{"material.stuff.young": 1e3}, {"material.stuff.density": 1e-3}])
def test_stages_with_stiff_vibrations_are_solved_to_the_tolerance(change: dict[str, float]) -> None:
    """In an earlier version, the convergence rate of small Newton steps was assumed for large ones.

    The joints drifted: Radau9 had errors of 31 tolerances, with steps longer than the period of stiff vibrations.
    """
    (path, times), scene = next(iter(change.items())), fl.load_scene(ROOT / "validation/scenes/extreme_arm.toml")
    before = getattr(scene.arm.materials["stuff"], path.rsplit(".", 1)[1])
    arm = scene.varied(
        {"link.*.flex": "z", "link.fore.mount": {}, "initial.rate_deg": [90.0, -60.0], path: times * before,
         "run.duration": 0.1, "run.step": 0.005, "run.sample": 0.005}
    )  # fmt: skip
    exact = fl.simulate(arm, method="DOP853", relative_tolerance=1e-11)
    for tolerance in (5e-9, 1e-8, 4e-8):
        run = fl.simulate(arm, method="Radau9", relative_tolerance=tolerance)
        assert np.linalg.norm(run.tip - exact.tip, axis=1).max() <= tolerance * run.chain.reach


EPS = np.finfo(float).eps
FINE = {"run.method": "DOP853", "run.step": None}
PLACES = [Fraction(k, 7) for k in range(1, 7)]
DORMAND_PRINCE = ROOT / "flexlink" / "describe" / "data" / "methods" / "DOPRI5.toml"
OF_DOPRI5 = """
error = [["71/57600", "0", "-71/16695", "71/1920", "-17253/339200", "22/525", "-1/40"]]
dense = [["-12715105075/11282082432", "0", "87487479700/32700410799", "-10690763975/1880347072",
  "701980252875/199316789632", "-1453857185/822651844", "69997945/29380423"]]
"""
"""Hairer's error estimate and dense output of DOPRI5, which need no extra stages."""


def spring(**run: Any) -> fl.Scene:
    """One rigid link whose drive acts as a damped spring about its target: J q̈ = −k_p q − k_d q̇."""
    hub = fl.RigidBody(mass=1.0, center=(0.5, 0.0, 0.0), inertia=(0.01, 0.05, 0.05))
    scene = make_scene(
        fl.Link(name="a", length=1.0, hub=hub), initial=fl.InitialState(joint_deg=(30.0,)), gravity=(0.0, 0.0, 0.0)
    )
    drive = fl.Drive(kind="pd", kp=(30.0,), kd=(0.6,), target_deg=(0.0,))
    return scene.varied({"drive": drive, **FINE, **{f"run.{key}": value for key, value in run.items()}})


def swing(scene: fl.Scene, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exact angle and rate of the link of `spring`."""
    J, kp, kd = 0.05 + 0.25, scene.drive.kp[0], scene.drive.kd[0]
    λ = np.roots([J, kd, kp])
    weights = np.linalg.solve([[1.0, 1.0], λ], [np.radians(30.0), 0.0])
    parts = weights * np.exp(np.outer(t, λ))
    return parts.sum(axis=1).real, (parts * λ).sum(axis=1).real


def without_dense_output(folder: Path) -> str:
    """DOP853 without dense output coefficients, so that its steps end at samples."""
    text = (DORMAND_PRINCE.parent / "DOP853.toml").read_text("utf-8")
    path = folder / "ends_at_samples.toml"
    path.write_text(text[: text.index("dense_stages = [")], encoding="utf-8")
    return str(path)


def test_dense_output_coefficients_equal_the_published_ones() -> None:
    found = method("DOP853")
    A, c, _ = found.dense
    np.testing.assert_array_equal(A[:, :15], published.A[13:, :15])
    np.testing.assert_allclose(c, published.C[13:], rtol=0, atol=EPS)
    np.testing.assert_array_equal(np.array(found.dense_rows, dtype=float), published.D)


@pytest.mark.parametrize("x", PLACES)
def test_dense_rates_use_the_published_weights_and_dense_angles_their_integral(x: Fraction) -> None:
    """Angles are also corrected by a cubic with zero slope at both ends, to match the end of the step."""
    rule, at = method("DOP853"), float(x)
    _, _, (once, twice) = rule.dense
    powers = at ** np.arange(once.shape[1])
    with mp.workdps(40):
        wanted = np.array([float(weight * mp.mpf(at)) for weight in inside(rule, x)[1]])
    np.testing.assert_allclose(at * once @ powers, wanted, rtol=0, atol=1e-12)
    A, b, _ = rule.arrays
    whole = once / np.arange(2, once.shape[1] + 2)  # ∫ β dx, divided by x²
    left = np.append(b @ A, np.zeros(4)) - whole.sum(axis=1)
    np.testing.assert_allclose(twice @ powers, whole @ powers + left * (3 - 2 * at), rtol=0, atol=1e-12)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-8])
def test_every_sample_of_a_spring_is_within_the_tolerance(tolerance: float) -> None:
    """The samples are compared with the closed form; a step contains more than three samples on average."""
    run = fl.simulate(spring(duration=2.0, sample=0.005, tolerance=tolerance))
    q, qd = swing(run.scene, run.t)
    assert run.steps.taken < len(run.t) / 3
    assert np.abs(run.q[:, 0] - q).max() <= 0.5 * tolerance
    assert np.abs(run.qd[:, 0] - qd).max() <= 10.0 * tolerance  # [rad/s]; the natural frequency is 10 rad/s
    assert np.abs(run.imbalance).max() <= 5.0 * tolerance  # [J]; the stiffness is 30 N m/rad
    assert not run.warnings


def test_only_steps_with_an_inner_sample_take_the_extra_stages() -> None:
    """A step takes twelve evaluations, and three more if it contains a sample; the motion is the same."""
    ends, many = (fl.simulate(spring(duration=2.0, sample=sample, tolerance=1e-6)) for sample in (2.0, 0.005))
    assert ends.steps.evaluations == 12 * (ends.steps.taken + ends.steps.rejected)
    assert many.steps.taken == ends.steps.taken
    inner = many.steps.evaluations - ends.steps.evaluations
    assert inner % 3 == 0
    assert 0.8 * many.steps.taken <= inner / 3 <= many.steps.taken  # the first steps contain no sample
    np.testing.assert_array_equal(ends.q[-1], many.q[-1])
    np.testing.assert_array_equal(ends.work[-1], many.work[-1])


@pytest.mark.parametrize("drive", [None, fl.Drive(kind="pd", kp=(9.0,), kd=(0.3,), target_deg=(10.0,), rate=50.0)])
def test_steps_end_at_samples_if_samples_are_sparse(drive: fl.Drive | None, tmp_path: Path) -> None:
    """Results, evaluations and work are bitwise equal to those of the method without dense output."""
    scene = make_scene(flexible("a", segments=3), initial=fl.InitialState(joint_deg=(40.0,)))
    joint = {"link.a.joint.armature": 0.5}
    scene = scene.varied({**FINE, **joint, "drive": drive, "run.duration": 0.2, "run.sample": 0.02})
    runs = [
        fl.simulate(scene.varied({"run.method": name, "run.tolerance": 1e-5}))
        for name in ("DOP853", without_dense_output(tmp_path))
    ]
    one, other = runs
    assert one.steps.taken > 4 * len(one.t)
    for part in ("q", "qd", "tau", "work"):
        np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
    assert one.steps[1:5] == other.steps[1:5]


def test_steps_end_at_torque_jumps_with_any_sampling() -> None:
    """The torque jumps at 0.0731 s, between two samples; without the jump, a step would pass over this time."""
    jump = fl.Drive(kind="table", times=(0.0, 0.0731), torques=((0.0,), (2.0,)), hold=True)
    scene = spring(duration=0.2, sample=0.005, tolerance=1e-8).varied({"drive": jump, "initial.rate_deg": (10.0,)})
    run = fl.simulate(scene)
    angle, rate = np.radians((30.0, 10.0))
    after = np.maximum(run.t - 0.0731, 0.0)
    np.testing.assert_allclose(run.q[:, 0], angle + rate * run.t + 0.5 * (2.0 / 0.3) * after**2, rtol=0, atol=1e-12)
    assert run.steps.taken < 20


def test_a_user_loop_gives_the_results_of_a_run_with_dense_output() -> None:
    """The law is evaluated eight times a second; the run stores 16 samples in between, which the loop does not read."""

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> list[float]:
        return [6.0 * float(np.radians(30.0) - q[0]) - 0.5 * float(qd[0])]  # no torque at the start: equal first steps

    scene = spring(duration=1.0, sample=1 / 128, tolerance=1e-7).varied({"drive": None, "gravity": (0.0, -9.81, 0.0)})
    run, stepped = fl.simulate(scene, control=law, rate=8.0), fl.Simulator(scene)
    states = [stepped.state]
    for _ in range(8):
        states.append(stepped.step(law(*stepped.state), duration=0.125))
    np.testing.assert_array_equal([state.q for state in states], run.q[::16])
    np.testing.assert_array_equal([state.qd for state in states], run.qd[::16])
    assert stepped._steps.steps[1:3] == run.steps[1:3]
    assert run.steps.taken < len(run.t) / 3


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
def test_a_step_with_a_large_inner_error_is_shortened(tolerance: float) -> None:
    """Near the stability limit of a decay, the error is small at the end of a step but not inside the step.

    This inner error was 3.3 tolerances for an arm that follows a slow reference.
    """
    scene = spring(duration=2.0, sample=0.02, tolerance=tolerance).varied({"drive.kp": (2.0,), "drive.kd": (15.0,)})
    run = fl.simulate(scene)
    q, _ = swing(run.scene, run.t)
    assert np.abs(run.q[:, 0] - q).max() <= 0.5 * tolerance


def test_a_user_method_has_dense_output_without_extra_stages(tmp_path: Path) -> None:
    """DOPRI5 gets Hairer's error estimate and dense output of seven weights, with which samples have order 4."""
    text = DORMAND_PRINCE.read_text("utf-8")
    path = tmp_path / "dopri5.toml"
    path.write_text(text + OF_DOPRI5, encoding="utf-8")
    run = fl.simulate(spring(duration=2.0, sample=0.005, tolerance=1e-4).varied({"run.method": str(path)}))
    q, _ = swing(run.scene, run.t)
    assert run.steps.taken < len(run.t) / 3
    assert run.steps.evaluations == 6 * (run.steps.taken + run.steps.rejected)
    assert np.abs(run.q[:, 0] - q).max() <= 1e-4


ONE_STAGE = {"A": ((), ("1",)), "b": ("1/2", "1/2"), "c": ("0", "1"), "error": (("1", "-1"),)}


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        (
            {"dense": (("1", "-1"),)},
            "dense[0] has 2 weights: expected 3, one per stage, one for q̈ at the end of the step",
        ),
        ({"dense": (("1", "-1", "1"),)}, "dense[0] = ('1', '-1', '1'): must sum to 0"),
        ({"dense": (("1", "-1", "x"),)}, "dense[0]: 'x': expected"),
        ({"dense_stages": (("0", "0", "1/2"),)}, "dense_stages"),
        ({"dense": (("1", "-1", "0", "0"),), "dense_stages": (("1/2",),)}, "dense_stages[0] has 1 numbers: expected 3"),
        ({"dense": (("1", "-1", "0", "0"),), "dense_stages": (("0", "y", "0"),)}, "dense_stages[0]: 'y': expected"),
        ({"A": (("0", "0"), ("1/2", "1/2")), "error": (), "dense": (("1", "-1", "0"),)}, "dense"),
    ],
)
def test_invalid_dense_output_coefficients_are_refused_in_one_line(fields: dict[str, Any], wanted: str) -> None:
    with pytest.raises(SceneError) as refused:
        from_file(ONE_STAGE | fields)
    assert wanted in str(refused.value)


def test_steps_with_dense_output_stay_within_the_stability_limit() -> None:
    """A beam rests in equilibrium: steps above the stability limit would amplify rounding up to the tolerance."""
    clamped = flexible("a", segments=3, joint=fl.Joint(locked=True))
    beam = make_scene(clamped, gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(passive="static"))
    run = fl.simulate(beam.varied({**FINE, "run.tolerance": 1e-2, "run.duration": 0.05, "run.sample": 5e-4}))
    assert np.abs(run.qd).max() < 1e-9
