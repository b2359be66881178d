"""The tip wrench, in frame 0 or in the frame of the tip, constant or as a table in time, in every kind of run."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

import flexlink as fl
from flexlink.engines import load
from tests.conftest import flexible, make_scene
from tests.support.words import refused

TIMES = (0.0, 0.013, 0.03, 0.045)
TABLE: dict[str, Any] = {
    "times": TIMES,
    "forces": ((3.0, -2.0, 1.0), (-4.0, 5.0, 2.0), (6.0, 1.0, -5.0), (2.0, 2.0, 2.0)),
    "moments": ((0.3, 0.2, -0.1), (-0.4, 0.1, 0.6), (0.2, -0.5, 0.3), (0.0, 0.1, 0.2)),
}
IN_TIME: dict[str, dict[str, Any]] = {
    "constant": {"force": (3.0, -2.0, 1.0), "moment": (0.3, 0.2, -0.1)},
    "linear": TABLE,
    "smooth": {**TABLE, "smooth": True},
    "hold": {**TABLE, "hold": True},
}
WRENCHES = {
    f"{kind}, {frame}": {**table, "frame": frame} for kind, table in IN_TIME.items() for frame in ("world", "tip")
}
FLEX = {"plane": "z", "space": "xyz"}
each_wrench = pytest.mark.parametrize("wrench", WRENCHES)
each_room = pytest.mark.parametrize("room", FLEX)


def arm(wrench: dict[str, Any], room: str = "space", **changes: object) -> fl.Scene:
    """Two driven flexible links with friction, damping, a payload and a rotated tip."""
    friction = fl.Joint(viscous=0.1, coulomb=0.3, coulomb_width=0.05, armature=0.01)
    skew = fl.Mount() if room == "plane" else fl.Mount(rpy_deg=(40.0, -30.0, 20.0))
    links = (
        flexible("upper", FLEX[room], 2, joint=friction),
        flexible("fore", FLEX[room], 2, mount=skew, joint=friction),
        fl.Link(name="hand", length=0.2, mount=skew),
    )
    scene = make_scene(
        *links, tip=fl.RigidBody(mass=0.5, inertia=(4e-3, 5e-3, 6e-3)), wrench=fl.Wrench(**wrench),
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(-80.0, -10.0, 30.0), rate_deg=(20.0, 0.0, -40.0)),
        drive=fl.Drive(kind="pd", kp=(40.0, 20.0, 5.0), kd=(1.0, 0.5, 0.1), target_deg=(-60.0, 0.0, 0.0)),
    )  # fmt: skip
    run = {"run.duration": 0.05, "run.sample": 0.005, "run.step": 1e-4, "material.aluminium.loss_time": 1e-5}
    return scene.varied({**run, **changes})


def specified(wrench: dict[str, Any], t: float) -> np.ndarray:
    """Force and moment of a scene at time t, interpolated by NumPy."""
    if "times" not in wrench:
        return np.array([*wrench["force"], *wrench["moment"]])
    rows = np.hstack([wrench["forces"], wrench["moments"]])
    if wrench.get("hold"):
        return rows[max(0, np.searchsorted(TIMES, t + 1e-12, side="right") - 1)]
    return np.array([np.interp(t, TIMES, column) for column in rows.T])


@each_room
@pytest.mark.parametrize("name", [name for name in WRENCHES if "smooth" not in name])
def test_the_wrench_of_a_run_equals_that_of_its_scene_in_the_tip_frame(name: str, room: str) -> None:
    scene = arm(WRENCHES[name], room)
    run = fl.simulate(scene)
    tips = fl.frames(run.chain, run.q).rotations[:, -1]
    for t, R, found in zip(run.t, tips, run.tip_wrench, strict=True):
        given = specified(WRENCHES[name], t).reshape(2, 3)
        wanted = given @ R.T if scene.wrench.frame == "tip" else given
        np.testing.assert_allclose(found, wanted.ravel(), rtol=0, atol=1e-13)  # rounding of numbers up to 6


def test_a_smooth_wrench_table_is_interpolated_like_a_drive_table() -> None:
    scene = arm({**IN_TIME["smooth"], "moments": None}, "plane")
    torques = tuple((x, 0.0, 0.0) for x, _, _ in TABLE["forces"])
    driven = scene.varied({"drive": fl.Drive(kind="table", times=TIMES, torques=torques, smooth=True)})
    run = fl.simulate(driven, sample=1e-3)
    # rounding of a tridiagonal system of condition 3 and of a cubic's four terms
    np.testing.assert_allclose(run.tip_wrench[:, 0], run.tau[:, 0], rtol=0, atol=1e-13)


ROD = {"length": 0.5, "joint": fl.Joint(armature=0.1)}  # J = 0.1 kg m²; the rod is massless


def test_a_follower_force_accelerates_a_rod_uniformly() -> None:
    """J q̈ = L f, so q = L f t²/2J and W = L f q, exact for methods of order 2 and higher."""
    scene = make_scene(fl.Link(name="a", **ROD), gravity=(0, 0, 0), wrench=fl.Wrench((0.0, 4.0, 0.0), frame="tip"))
    run = fl.simulate(scene, step=0.01, sample=0.1, duration=2.0)
    wanted = 0.5 * 4.0 * run.t**2 / (2 * 0.1)
    assert wanted[-1] > 2 * np.pi
    np.testing.assert_allclose(run.q[:, 0], wanted, rtol=1e-13)
    np.testing.assert_allclose(run.work, 0.5 * 4.0 * wanted, rtol=1e-12)
    np.testing.assert_allclose(run.energy.kinetic, 0.5 * 4.0 * wanted, rtol=1e-12)


def test_a_moment_proportional_to_time_turns_a_wheel_by_a_cubic() -> None:
    """J q̈ = m t: q = m t³/6J, W = J q̇²/2 = m² t⁴/8J, exact for a method of order 4."""
    table = fl.Wrench(times=(0.0, 10.0), moments=((0.0, 0.0, 0.0), (0.0, 0.0, 30.0)))
    run = fl.simulate(make_scene(fl.Link(name="a", **ROD), gravity=(0, 0, 0), wrench=table), step=0.01, sample=0.1)
    np.testing.assert_allclose(run.q[:, 0], 3.0 * run.t**3 / (6 * 0.1), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run.work, (3.0 * run.t**2) ** 2 / (8 * 0.1), rtol=1e-11, atol=1e-15)


@pytest.mark.parametrize("end", [30.0, 60.0, 90.0])
def test_a_cantilever_under_a_follower_force_follows_the_elastica(end: float) -> None:
    """EI θ'' = −F cos(α − θ) with tip angle α gives F L²/EI = ½ (∫₀^α dψ / √sin ψ)², up to O(1/n²) for n hinges."""
    α = np.radians(end)
    load = 0.5 * quad(lambda x: 2.0 / np.sqrt(np.sin(x * x) / (x * x)), 0.0, np.sqrt(α))[0] ** 2  # ψ = x²

    def slope(n: int) -> float:
        locked = fl.Joint(locked=True)
        scene = make_scene(flexible("a", segments=n, lumping="midpoint", joint=locked), gravity=(0, 0, 0))
        link, chain = scene.arm.links[0], fl.lump(scene)
        EI = 70e9 * 0.04**4 / 12
        force = (0.0, load * EI / link.length**2, 0.0)
        scene = scene.varied({"wrench": fl.Wrench(force, frame="tip"), "initial.passive": "static"})
        q, qd = fl.initial_state(scene, chain)
        run = fl.simulate(scene, duration=0.0)
        residual = fl.bias_torque(chain, q, qd, tip_wrench=run.tip_wrench[0]) + fl.elastic_torque(chain, q)
        assert np.abs(residual).max() <= 1e-12 * force[1] * link.length
        return float(q.sum())

    errors = {n: abs(slope(n) - α) for n in (20, 40)}
    assert errors[40] <= 2e-4
    assert np.log2(errors[20] / errors[40]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "module", "method"), [("drake", "pydrake", "RK3"), ("exudyn", "exudyn", "RK4")])
@each_wrench
def test_drake_and_exudyn_apply_the_wrench_or_refuse_it(name: str, module: str, method: str, wrench: str) -> None:
    pytest.importorskip(module)
    scene = arm(WRENCHES[wrench], **{"run.method": method, "run.duration": 0.02})
    engine = load(name, fl.lump(scene))
    if scene.wrench.hold:
        with pytest.raises(fl.errors.ArgumentError) as caught:
            engine.integrate(scene)
        id = "engine-does-not-support"
        assert caught.value.id == id
        text = str(caught.value).lower()
        assert [part for part in ("wrench.hold", name, "native, pinocchio") if part not in text] == []
        return
    assert np.abs(engine.integrate(scene)[1] - fl.simulate(scene).q).max() <= 1e-11


@each_room
def test_a_linear_model_includes_the_rotation_of_its_wrench(room: str) -> None:
    """Reference: central differences of forward dynamics, with an error of second order."""
    scene = arm(WRENCHES["constant, tip"], room)
    chain, wrench, (q, qd) = (
        fl.lump(scene),
        specified(WRENCHES["constant, tip"], 0.0),
        fl.initial_state(scene, fl.lump(scene)),
    )
    n, tau = chain.n, np.zeros(chain.n)

    def qdd(angles: np.ndarray) -> np.ndarray:
        R = fl.frames(chain, angles).rotations[-1]
        return fl.forward_dynamics(chain, angles, qd, tau, tip_wrench=(wrench.reshape(2, 3) @ R.T).ravel())

    model = fl.linearize(chain, q, qd, tau, tip_wrench=wrench, frame="tip")
    np.testing.assert_allclose(model.rate[n:], qdd(q), rtol=1e-9)
    h = 1e-5 * np.eye(n)
    slopes = np.array([(qdd(q + step) - qdd(q - step)) / 2e-5 for step in h]).T
    dead = fl.linearize(chain, q, qd, tau, tip_wrench=fl.simulate(scene, duration=0.0).tip_wrench[0])
    size = np.abs(slopes).max()
    assert np.abs(model.A[n:, :n] - slopes).max() <= 1e-7 * size
    assert np.abs(dead.A[n:, :n] - slopes).max() > 1e-5 * size


@pytest.mark.parametrize(
    ("fields", "id"),
    [
        ({"times": (0.0, 0.5, 0.5), "forces": ((0.0, 0.0, 0.0),) * 3}, "times-not-increasing"),
        ({"times": (0.0, 1.0), "forces": ((0.0, 0.0, 0.0),)}, "one-per-time"),
        ({"times": (0.0, 1.0), "moments": ((0.0, 0.0, 0.0),) * 3}, "one-per-time"),
        ({"times": (0.0, np.nan), "forces": ((0.0, 0.0, 0.0),) * 2}, "not-finite"),
        ({"times": (0.0, 1.0), "forces": ((0.0, 0.0, 0.0), (0.0, np.inf, 0.0))}, "not-finite"),
        ({"times": (), "forces": ()}, "file-empty"),
        ({"times": (0.0,)}, "missing-key"),
        ({"forces": ((1.0, 0.0, 0.0),)}, "needs-another-key"),
        ({"times": (0.0,), "forces": ((0.0, 0.0, 0.0),), "force": (1.0, 0.0, 0.0)}, "one-per-time"),
        ({"times": (0.0,), "forces": ((0.0, 0.0, 0.0),), "smooth": True}, "needs-another-key"),
        ({"hold": True}, "needs-another-key"),
        ({"frame": "hand"}, "wrong-value"),
    ],
)
def test_an_impossible_wrench_is_refused_and_its_row_is_named(fields: dict[str, Any], id: str) -> None:
    with refused(fl.errors.SceneError, id):
        fl.Wrench(**fields)


def test_unsupported_uses_of_a_wrench_are_refused_and_their_key_is_named() -> None:
    steep = {"times": (0.0, 5e-324), "forces": ((0.0, 0.0, 0.0), (1e300, 0.0, 0.0))}
    with refused(fl.errors.SceneError, "overflow"):
        fl.simulate(arm(steep))
    with refused(fl.errors.SceneError, "not-a-multiple"):
        arm(IN_TIME["hold"], **{"run.step": 2e-3, "run.sample": 4e-3, "run.duration": 0.04})
    with refused(fl.errors.SceneError, "load-not-constant"):
        _ = arm(WRENCHES["constant, tip"]).tip_wrench
