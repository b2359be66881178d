"""Derivatives of a run along numbers of its scene: against a closed form, and against runs of varied scenes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from conftest import flexible, make_scene
from mpmath import mp, mpf
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

import flexlink as fl
from flexlink import Damping, Drive, InitialState, Joint, Link, Mount, RigidBody, RunSettings
from flexlink.errors import ArgumentError
from validation.oracles.spatial_chain import SpatialChain, exactly

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
    """∂(q, q̇, tip)/∂p at the last sample by a polynomial through 13 runs of varied scenes, and what its end leaves.

    The last terms are truncation or, mostly, the rounding that is in all: a slope weighs term j by up to j².
    """
    x = np.cos(np.pi * (np.arange(13) + 0.5) / 13)
    Δ = part * (abs(value) or 1.0)
    middle, at = (value, 0.0) if value else (Δ, -1.0)
    runs = [fl.simulate(scene.varied({path: middle + Δ * point})) for point in x]
    c = chebyshev.chebfit(x, np.array([np.concatenate([r.q[-1], r.qd[-1], r.tip[-1]]) for r in runs]), 12)
    return chebyshev.chebval(at, chebyshev.chebder(c)) / Δ, np.abs(c[-2:]).max(axis=0) * (np.arange(13) ** 2).sum() / Δ


def check(scene: fl.Scene, path: str, limit: float = 1e-5) -> None:
    """Within what the runs can tell, which of the rates is `limit` of the largest or less."""
    found = fl.sensitivities(scene, [path])
    value = float(found.values[0])
    told, left = by_runs(scene, path, value, 0.01 if value else 1e-4)
    ours, n = np.concatenate([found.q[-1, :, 0], found.qd[-1, :, 0], found.tip[-1, :, 0]]), found.q.shape[1]
    for rows in (slice(0, n), slice(n, 2 * n), slice(2 * n, None)):
        size = np.abs(told[rows]).max()
        assert np.abs(ours - told)[rows].max() <= left[rows].max() + 1e-11 * size
    rates = slice(n, 2 * n)
    assert left[rates].max() <= limit * np.abs(told[rates]).max(), "the runs tell"


def test_an_oscillator_has_the_slope_of_its_closed_form() -> None:
    """q = q₀ cos ωt, ω² = k/I: ∂q/∂k = −q₀ t sin(ωt)/(2 √(k I)); RK10 at ωh = 0.02 is off by rounding only."""
    k, q0 = 50.0, 0.1
    joint = Joint(locked=True, gear_stiffness=k)
    scene = make_scene(
        Link(name="a", length=1.0, joint=joint), tip=RigidBody(mass=2.0), gravity=(0.0, 0.0, 0.0),
        initial=InitialState(q=(q0,)), run=RunSettings(method="RK10", step=4e-3, sample=0.04, duration=2.0),
    )  # fmt: skip
    found = fl.sensitivities(scene, ["link.a.joint.gear_stiffness", "tip.mass"])
    t, ω = found.run.t, np.sqrt(k / 2.0)
    exact = -q0 * t * np.sin(ω * t) / 2
    assert np.abs(found.q[:, 0, 0] - exact / np.sqrt(k * 2.0)).max() <= 1e-13 * np.abs(exact).max()
    assert np.abs(found.q[:, 0, 1] + exact * ω / 2.0).max() <= 1e-13 * np.abs(exact * ω).max(), "m ω² = k"
    assert found.run.warnings == () and repr(found).startswith("<Sensitivities of <Trajectory 'test'")


@pytest.mark.slow
def test_it_is_the_derivative_of_the_method_s_own_numbers_in_50_digits() -> None:
    """Ten steps of RK4 in 60 digits, and their differences of 1e-20: E scales springs and damping, kp the drive."""
    scene = arm(**PD).varied({"link.*.segments": 2, "run.duration": 2e-4, "run.sample": 2e-4, "wrench.force": None})
    found = fl.sensitivities(scene, ["material.aluminium.young", "drive.kp.upper", "initial.joint_deg.fore"])
    exact = [
        in_digits(scene, found.run.chain, "young", found.values[0]),
        in_digits(scene, found.run.chain, "kp", found.values[1]),
        in_digits(scene, found.run.chain, "start", np.degrees(1.0)),
    ]
    for j, slopes in enumerate(exact):
        for ours, theirs in zip((found.q[-1, :, j], found.qd[-1, :, j]), slopes, strict=True):
            assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(theirs).max()


def in_digits(scene: fl.Scene, chain: fl.Chain, what: str, unit: float) -> Array:
    """∂(q, q̇)/∂p at the end, (2, n); p = `unit` times a number that is 1, or, of the start, that is 0."""
    h = mpf(10) ** -20
    with mp.workdps(60):
        ahead, behind = (last_state(scene, chain, what, sign * h) for sign in (1, -1))
        return ((ahead - behind) / (2 * h * mpf(float(unit)))).astype(float)


def last_state(scene: fl.Scene, chain: fl.Chain, what: str, h: Any) -> NDArray[np.object_]:
    oracle, drive, own = SpatialChain(chain), scene.drive, chain.active
    for joint, coordinate in zip(oracle.joints, chain.coordinates, strict=True):
        if what == "young" and coordinate.segment:  # hinges of links, not the gear
            joint["stiffness"] *= 1 + h
            joint["damping"] *= 1 + h
    q, qd = (np.array(exactly(part)) for part in fl.initial_state(scene, chain))
    q[own[1]] += h * (what == "start")
    kp, kd, target = (np.array(exactly(part)) for part in (drive.kp, drive.kd, np.radians(drive.target_deg)))
    kp[0] *= 1 + h * (what == "kp")

    def accelerations(q: NDArray[np.object_], qd: NDArray[np.object_]) -> NDArray[np.object_]:
        tau = np.array([mpf(0)] * chain.n)
        tau[own] = kp * (target - q[own]) - kd * qd[own]
        return np.array(oracle.forward_dynamics(list(q), list(qd), list(tau)))

    step = mpf(scene.run.step)
    for _ in range(scene.run.steps_per_sample):
        L1, K1 = qd, accelerations(q, qd)
        L2, K2 = (L := qd + step / 2 * K1), accelerations(q + step / 2 * L1, L)
        L3, K3 = (L := qd + step / 2 * K2), accelerations(q + step / 2 * L2, L)
        L4, K4 = (L := qd + step * K3), accelerations(q + step * L3, L)
        q, qd = q + step / 6 * (L1 + 2 * L2 + 2 * L3 + L4), qd + step / 6 * (K1 + 2 * K2 + 2 * K3 + K4)
    return np.array([q, qd])


def test_the_run_is_that_of_simulate() -> None:
    scene = arm(**PD)
    found, run = fl.sensitivities(scene, ["tip.mass"]), fl.simulate(scene)
    assert np.array_equal(found.run.q, run.q) and np.array_equal(found.run.qd, run.qd)
    assert found.q.shape == (3, run.chain.n, 1) and found.tip.shape == (3, 3, 1)
    assert not found.q[0].any(), "it starts from the same state"


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        "material.aluminium.young", "material.aluminium.density", "tip.mass", "link.fore.end.mass", "link.fore.length",
        "link.upper.damping.ratio", "link.upper.joint.coulomb", "link.upper.joint.coulomb_width",
        "link.upper.joint.armature", "link.fore.joint.gear_stiffness", "link.fore.joint.gear_damping",
        "section.square.height", "initial.joint_deg.upper",
    ],
)  # fmt: skip
def test_it_is_what_varied_runs_say(path: str) -> None:
    check(arm(), path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "changes"),
    [
        ("drive.kp.upper", PD), ("drive.kd.fore", PD), ("drive.target_deg.upper", PD), ("tip.mass", PD),
        ("drive.torque.fore", CONSTANT), ("tip.mass", TABLE),
        ("material.aluminium.young", STATIC), ("tip.mass", STATIC), ("initial.joint_deg.upper", STATIC),
        ("link.fore.length", STATIC), ("link.fore.damping.ratio", {"link.fore.damping": Damping(ratio=0.0, at_hz=3.0)}),
    ],
)  # fmt: skip
def test_it_is_what_varied_runs_say_of_drives_and_starts(path: str, changes: dict[str, Any]) -> None:
    check(arm(**changes), path)


def test_what_cannot_be_differentiated_is_refused_by_name() -> None:
    scene = arm()
    for path, reason in (
        ("run.step", "not a parameter; allowed are numbers of material"),
        ("link.upper.segments", "cannot be varied: .* expected int"),
        ("link.upper.name", "not a number"),
        ("drive.kp.upper", "cannot be varied"),
        ("tip.maß", "unknown here"),
    ):
        with pytest.raises((ArgumentError, fl.errors.SceneError), match=reason):
            fl.sensitivities(scene, [path])
    with pytest.raises(ArgumentError, match=r"parameters = 'tip.mass': expected a sequence"):
        fl.sensitivities(scene, "tip.mass")
    with pytest.raises(ArgumentError, match="at least one path"):
        fl.sensitivities(scene, [])
    with pytest.raises(ArgumentError, match="'auto': sensitivities need fixed steps"):
        fl.sensitivities(scene.varied({"run.tolerance": 1e-4}), ["tip.mass"])
    lengths = scene.varied({"link.fore.length": 2.0})
    with pytest.raises(ArgumentError, match="the values differ; name each path by itself"):
        fl.sensitivities(lengths, ["link.*.length"])
