"""Sensitivities of a run to numbers of its scene agree with a closed form, SciPy and runs of varied scenes."""

from typing import Any

import numpy as np
import pytest
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

import flexlink as fl
from flexlink import Damping, Drive, InitialState, Joint, Link, Mount, RigidBody, RunSettings
from flexlink.errors import ArgumentError
from flexlink.motion.slopes_of_runs import weights
from tests.conftest import flexible, make_scene
from tests.support.words import refused

Array = NDArray[np.float64]

STATIC = {"initial": InitialState(joint_deg=(-60.0, 25.0), passive="static")}
PD = {"drive": Drive(kind="pd", kp=(40.0, 20.0), kd=(1.0, 0.5), target_deg=(-80.0, -10.0))}
TABLE = {"drive": Drive(kind="table", times=(0.0, 0.01), torques=((1.0, 0.0), (-3.0, 1.0)))}
CONSTANT = {"drive": Drive(kind="constant", torque=(2.0, -1.0))}


def arm(flex: str = "z", **changes: Any) -> fl.Scene:
    """Two links that bend, with rotors, dry friction, an elastic gear, a load and a wrench: RK4, 1000 steps."""
    joint = Joint(viscous=0.1, coulomb=0.3, coulomb_width=0.5, armature=0.01)
    gear = Joint(armature=0.02, gear_stiffness=800.0, gear_damping=0.1)
    scene = make_scene(
        flexible("upper", flex, 3, joint=joint, damping=Damping(ratio=0.01, at_hz=3.0)),
        flexible("fore", flex, 3, joint=gear, end=RigidBody(mass=0.2), mount=Mount(xyz=(0.0, 0.1, 0.0))),
        tip=RigidBody(mass=0.5, inertia=(0.01, 0.01, 0.01)),
        gravity=(0.0, 9.81, 0.0),
        wrench=fl.Wrench(force=(1.0, -2.0, 0.5)),
        initial=InitialState(joint_deg=(-60.0, 25.0)),
        run=RunSettings(step=2e-5, sample=0.01, duration=0.02),
    )
    return scene.varied(changes)


def by_runs(scene: fl.Scene, path: str, value: float, part: float) -> tuple[Array, Array]:
    """∂(q, q̇, tip)/∂p at the last sample by a polynomial through 13 runs of varied scenes, and its error.

    The error is estimated from the last two terms, which contain truncation and, mostly, rounding errors; term j
    affects the slope with a weight of up to j².
    """
    x = np.cos(np.pi * (np.arange(13) + 0.5) / 13)
    Δ = part * (abs(value) or 1.0)
    middle, at = (value, 0.0) if value else (Δ, -1.0)
    runs = [fl.simulate(scene.varied({path: middle + Δ * point})) for point in x]
    c = chebyshev.chebfit(x, np.array([np.concatenate([r.q[-1], r.qd[-1], r.tip[-1]]) for r in runs]), 12)
    return chebyshev.chebval(at, chebyshev.chebder(c)) / Δ, np.abs(c[-2:]).max(axis=0) * (np.arange(13) ** 2).sum() / Δ


def check(scene: fl.Scene, path: str, limit: float = 1e-5) -> None:
    """Check that sensitivities equal differences of runs within the errors of both, which `limit` bounds."""
    found = fl.sensitivities(scene, [path])
    value = float(found.values[0])
    wanted, left = by_runs(scene, path, value, 0.01 if value else 1e-4)
    ours, n = np.concatenate([found.q[-1, :, 0], found.qd[-1, :, 0], found.tip[-1, :, 0]]), found.q.shape[1]
    for rows, error in (
        (slice(0, n), found.q_error), (slice(n, 2 * n), found.qd_error), (slice(2 * n, None), found.tip_error)
    ):  # fmt: skip
        size = np.abs(wanted[rows]).max()
        assert np.abs(ours - wanted)[rows].max() <= left[rows].max() + 4 * error[0] + 1e-11 * size
        assert error[0] <= 50 * limit * size
    rates = slice(n, 2 * n)
    assert left[rates].max() <= limit * np.abs(wanted[rates]).max(), "differences of runs are accurate enough"


def test_difference_weights_are_exact_for_polynomials() -> None:
    for at in ((1, -1, 2), (1, -1, 2, -2, 3), (-2, -1, 1, 2), (1, 2, 3, 4, 5), (-1, -2)):
        for degree in range(1, len(at) + 1):
            assert np.array(weights(at)) @ np.array(at) ** degree == pytest.approx(float(degree == 1), abs=1e-13)
    assert weights((-2, -1, 1, 2)) == (1 / 12, -2 / 3, 2 / 3, -1 / 12)


def oscillator(**changes: Any) -> fl.Scene:
    """q = q₀ cos ωt, ω² = k/I, k = 50 N m/rad, I = 2 kg m²; RK10 with ωh = 0.02 has only rounding errors."""
    joint = Joint(locked=True, gear_stiffness=50.0)
    scene = make_scene(
        Link(name="a", length=1.0, joint=joint), tip=RigidBody(mass=2.0), gravity=(0.0, 0.0, 0.0),
        initial=InitialState(q=(0.1,)), run=RunSettings(method="RK10", step=4e-3, sample=0.04, duration=2.0),
    )  # fmt: skip
    return scene.varied(changes)


@pytest.mark.parametrize(
    ("changes", "limit"), [({}, 1e-8), ({"run": RunSettings(sample=0.04, duration=2.0, relative_tolerance=1e-4)}, 1e-5)]
)
def test_an_oscillator_has_the_sensitivity_of_its_closed_form(changes: dict[str, Any], limit: float) -> None:
    """∂q/∂k = −q₀ t sin(ωt)/(2 √(k I)), with an error within the estimate."""
    found = fl.sensitivities(oscillator(**changes), ["link.a.joint.gear_stiffness", "tip.mass"])
    t, ω = found.run.t, np.sqrt(50.0 / 2.0)
    exact = -0.1 * t * np.sin(ω * t) / 2
    for j, wanted in enumerate((exact / np.sqrt(50.0 * 2.0), -exact * ω / 2.0)):  # m ω² = k
        error = np.abs(found.q[:, 0, j] - wanted).max()
        assert error <= limit * np.abs(wanted).max()
        assert error <= 2 * found.q_error[j] <= 20 * limit * np.abs(wanted).max()
    assert found.run.warnings == () and repr(found.run) in repr(found)


def test_sensitivity_at_a_lower_bound_is_a_one_sided_derivative() -> None:
    """For an undamped oscillator ∂q/∂d = q₀ (sin ωt/ω − t cos ωt)/(2 I)."""
    found = fl.sensitivities(oscillator(), ["link.a.joint.gear_damping"])
    t, ω = found.run.t, np.sqrt(50.0 / 2.0)
    exact = 0.1 * (np.sin(ω * t) / ω - t * np.cos(ω * t)) / (2 * 2.0)
    assert np.abs(found.q[:, 0, 0] - exact).max() <= min(1e-7 * np.abs(exact).max(), 2 * found.q_error[0])


def test_a_number_without_effect_has_zero_sensitivity() -> None:
    found = fl.sensitivities(oscillator(), ["link.a.joint.coulomb_width"])
    assert not found.q.any() and not found.tip_error.any()


def test_the_run_is_bit_equal_to_simulate() -> None:
    scene = arm(**PD)
    found, run = fl.sensitivities(scene, ["tip.mass"]), fl.simulate(scene)
    assert np.array_equal(found.run.q, run.q) and np.array_equal(found.run.qd, run.qd)
    assert found.run.warnings == run.warnings
    assert found.q.shape == (3, run.chain.n, 1) and found.tip.shape == (3, 3, 1)
    assert not found.q[0].any(), "the sensitivity run starts from the same state"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "changes"),
    [
        *((path, {}) for path in (
            "material.aluminium.young", "material.aluminium.density", "tip.mass", "link.fore.end.mass",
            "link.fore.length", "link.upper.damping.ratio", "link.upper.joint.coulomb",
            "link.upper.joint.coulomb_width", "link.upper.joint.armature", "link.fore.joint.gear_stiffness",
            "link.fore.joint.gear_damping", "section.square.height", "initial.joint_deg.upper",
        )),
        ("drive.kp.upper", PD), ("drive.kd.fore", PD), ("drive.target_deg.upper", PD), ("tip.mass", PD),
        ("drive.torque.fore", CONSTANT), ("tip.mass", TABLE),
        ("material.aluminium.young", STATIC), ("tip.mass", STATIC), ("initial.joint_deg.upper", STATIC),
        ("link.fore.length", STATIC), ("link.fore.damping.ratio", {"link.fore.damping": Damping(ratio=0.0, at_hz=3.0)}),
    ],
)  # fmt: skip
def test_sensitivities_agree_with_differences_of_runs(path: str, changes: dict[str, Any]) -> None:
    check(arm(**changes), path)


def test_overlapping_paths_are_each_varied_separately() -> None:
    found = fl.sensitivities(arm(), ["link.*.length", "link.upper.length", "link.fore.length"])
    np.testing.assert_allclose(found.tip[-1, :, 0], found.tip[-1, :, 1:].sum(axis=1), rtol=0, atol=1e-6)


def test_keys_that_cannot_be_differentiated_are_refused_by_name() -> None:
    scene = arm()
    for path, id in (
        ("run.step", "not-a-parameter"),
        ("initial.time", "not-a-parameter"),
        ("link.upper.segments", "parameter-cannot-vary"),
        ("link.upper.name", "not-a-number"),
        ("drive.kp.upper", "parameter-cannot-vary"),
        ("tip.maß", "cannot-set"),
    ):
        with pytest.raises((ArgumentError, fl.errors.SceneError)) as caught:
            fl.sensitivities(scene, [path])
        assert caught.value.id == id and path in str(caught.value), path
    with refused(ArgumentError, "wrong-type"):
        fl.sensitivities(scene, "tip.mass")
    with refused(ArgumentError, "empty"):
        fl.sensitivities(scene, [])
    with pytest.raises(fl.errors.UnstableStepError):
        fl.sensitivities(scene.varied({"run.step": 0.01, "run.sample": 0.02}), ["tip.mass"])
    lengths = scene.varied({"link.fore.length": 2.0})
    with refused(ArgumentError, "paths-differ"):
        fl.sensitivities(lengths, ["link.*.length"])


SENSORS = (
    fl.Sensor(name="gauge", kind="strain", link="boom", x=0.1, fibre=(0.02, 0.0), low_pass=30.0, order=2, delay=0.003,
              noise=1e-3, resolution=1e-3),
    fl.Sensor(name="imu", kind="accelerometer", link="boom", x=0.7, axis=(0, 1, 0)),
)  # fmt: skip
RUN = fl.RunSettings(method="RK4", step=2e-4, duration=0.1, sample=0.01)
COLUMNS = "gauge [1]", "imu [m/s²]", "tip y [m]", "tau boom [N m]", "kinetic [J]"


def scene_of(ratio: float) -> fl.Scene:
    boom = flexible("boom", segments=3, damping=fl.Damping(ratio=ratio, at_hz=5.0), joint=fl.Joint(armature=0.5))
    drive = fl.Drive(kind="pd", kp=(300.0,), kd=(20.0,), target_deg=(30.0,))
    return make_scene(boom, drive=drive, sensor=SENSORS, gravity=(0, -9.81, 0), run=RUN, tip=fl.RigidBody(mass=2.0))


@pytest.mark.parametrize("path", ["tip.mass", "material.aluminium.young", "drive.kp.boom", "link.boom.length"])
def test_column_sensitivities_agree_with_finite_differences_of_runs(path: str) -> None:
    scene = scene_of(0.01)
    slopes = fl.sensitivities(scene, [path])
    smooth = scene.varied({"sensor.gauge.noise": None, "sensor.gauge.resolution": None})
    h = 1e-4 * slopes.values[0]
    runs = [fl.simulate(smooth.varied({path: slopes.values[0] + step * h})).columns for step in (1, -1, 2, -2)]
    for name in COLUMNS:
        near, nearer, far, farther = (columns[name] for columns in runs)
        exact = (8 * (near - nearer) - (far - farther)) / (12 * h)
        np.testing.assert_allclose(
            slopes.column(name)[:, 0], exact, rtol=0, atol=1e-7 * np.abs(exact).max(), err_msg=name
        )
        assert np.abs(slopes.column(name)[:, 0] - exact).max() <= 4 * slopes.column_error(name)[0]


def test_work_has_a_sensitivity_but_imbalance_and_time_do_not() -> None:
    slopes = fl.sensitivities(scene_of(0.01), ["tip.mass"])
    energy = sum(slopes.column(f"{name} [J]") for name in ("kinetic", "gravity", "elastic"))
    work = slopes.column("work [J]")
    assert np.abs(energy - energy[0] - work).max() <= 1e-6 * np.abs(work).max()
    for name in ("imbalance [J]", "t [s]", "tip y"):
        with refused(fl.errors.ArgumentError, "unknown-name"):
            slopes.column(name)


ROD = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))


def test_sensitivities_of_a_later_start_use_the_torques_at_that_time() -> None:
    drive = fl.Drive(kind="table", times=(0.0, 1.0, 2.0), torques=((0.0,), (5.0,), (-5.0,)))
    scene = ROD.varied({"drive": drive, "initial.time": 1.0, "run": {"step": 1e-3, "duration": 0.5, "sample": 0.1}})
    ends = [fl.simulate(scene.varied({"tip.mass": 1.0 + δ})).tip for δ in (1e-4, -1e-4)]
    found = fl.sensitivities(scene, ["tip.mass"]).tip[..., 0]
    np.testing.assert_allclose(found, (ends[0] - ends[1]) / 2e-4, atol=1e-6)
