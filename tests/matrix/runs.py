"""Claims about runs: final states, continuation, and equal results of all equivalent calls."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import flexlink as fl
from tests.matrix.case import EPS, Case, close, difference

IMPLICIT: dict[str, Any] = {"run.method": "Gauss4", "run.step": 1e-3}
NEAR = 1e-5
"""Tolerance of adaptive runs [m]; the arm moves by at least 0.03 m."""
WITHIN = {"run.step": None, "run.method": None, "run.tolerance": NEAR}
BARE = fl.RunSettings(duration=0.08)
"""Run settings of a scene that specifies only the duration, 5 s."""


def same(one: fl.Trajectory, other: fl.Trajectory, first: int = 0) -> None:
    """Check that two runs are equal to the bit from a sample on."""
    for name in ("t", "q", "qd", "tau", "tip", "tip_wrench"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name)[first:], err_msg=name)
    if first == 0:
        np.testing.assert_array_equal(one.energy.parts, other.energy.parts)
        assert (one.warnings, one.steps, one.scene) == (other.warnings, other.steps, other.scene)


def whole(run: fl.Trajectory) -> fl.Trajectory:
    """Check that a run reaches its end time with all samples; return the run."""
    settings, begun = run.scene.run, run.scene.initial.time
    np.testing.assert_allclose(run.t, begun + np.linspace(0.0, settings.duration, len(run.t)), rtol=0, atol=1e-12)
    assert len(run.t) == round(settings.duration / settings.spacing) + 1
    assert all(np.isfinite(part).all() for part in (run.q, run.qd, run.tau, run.tip, run.energy.parts))
    return run


def balanced(run: fl.Trajectory) -> fl.Trajectory:
    """Check that the work of all loads equals the energy change, up to Newton's residual; return the run."""
    moved, largest = np.ptp(run.energy.parts, axis=-1).sum(), np.abs(run.energy.parts).max()
    assert np.abs(run.imbalance).max() <= 1e-3 * moved + 1e-7 * largest
    return run


def rounded(run: fl.Trajectory) -> float:
    """Rounding error of the energy after all steps of a run [J]."""
    return 10 * run.steps.taken * EPS * float(np.abs(run.energy.parts).max())


def near(found: fl.Trajectory, case: Case, tolerance: float) -> None:
    """Check that the tips of all samples meet the tolerance; for a chain whose reach is zero, check the angles."""
    runs = (found, case.half, case.truth)
    requested, half, truth = (run.tip if found.chain.reach else run.q for run in runs)
    assert np.abs(requested - truth).max() <= tolerance + 2 * np.abs(half - truth).max()


def ends(case: Case) -> None:
    """The energy error of RK4 with fixed steps decreases with order 4."""
    run, half = balanced(whole(case.run)), whole(case.half)
    assert np.abs(half.imbalance).max() <= np.abs(run.imbalance).max() / 5 + rounded(half)


def ends_implicit(case: Case) -> None:
    """Gauss4 with steps ten times as long reaches the same final state."""
    near(balanced(whole(fl.simulate(case.scene.varied(IMPLICIT)))), case, NEAR)


def ends_by_default(case: Case) -> None:
    """A scene without run settings meets the default tolerance, a thousandth of its reach (or its substitute)."""
    run = whole(fl.simulate(case.scene.varied({"run": BARE, "run.sample": 0.008})))
    near(run, case, 1e-3 * max(run.chain.reach, 1e-3))


def ends_within_a_tolerance(case: Case) -> None:
    for method in ("auto", "DOP853", "Radau5", "Radau9"):
        near(whole(fl.simulate(case.scene.varied(WITHIN), method=method)), case, 3 * NEAR)


def continued(case: Case) -> None:
    """A run continued from any sample equals the uninterrupted run."""
    _goes_on(case.scene)


def continued_implicit(case: Case) -> None:
    _goes_on(case.scene.varied(IMPLICIT))


def _goes_on(scene: fl.Scene) -> None:
    run = fl.simulate(scene)
    for k in (3, 5):
        t, q, qd = run.state(k)
        same(fl.simulate(scene, q0=q, qd0=qd, t0=t, duration=float(round(run.t[-1] - t, 9))), run, k)


def lanes(case: Case) -> None:
    """Runs side by side equal single runs, whatever the other members are."""
    _side_by_side(case, case.scene)


def lanes_by_default(case: Case) -> None:
    _side_by_side(case, case.scene.varied({"run": BARE, "run.sample": 0.008}))


def _side_by_side(case: Case, scene: fl.Scene) -> None:
    heavier = scene.varied({case.mass: case.scene.arm.links[-1].end.mass + 0.05})
    for scenes in ([scene, scene, scene], [scene, heavier, scene, heavier]):
        for found, one in zip(fl.simulate_many(scenes), scenes, strict=True):
            same(found, fl.simulate(one))


def simulator(case: Case) -> None:
    """A Simulator gives the same run, with the scene's drive and with held torques."""
    torque = 0.5 * np.arange(1, len(case.chain.active) + 1)
    held = case.scene.varied({"drive": None})
    per_link = np.zeros(len(held.arm.links))
    free = [k for k, link in enumerate(held.arm.links) if not link.joint.locked]
    per_link[free] = torque[: len(free)]
    pushed = held.varied({"drive": fl.Drive(kind="constant", torque=tuple(per_link.tolist()))}) if free else held
    for scene, given in ((case.scene, None), (pushed, torque)):
        run, stepped = fl.simulate(scene), fl.Simulator(scene if given is None else held)
        states = [stepped.state, *(stepped.step(given) for _ in run.t[1:])]
        np.testing.assert_array_equal([state.q for state in states], run.q)
        np.testing.assert_array_equal([state.qd for state in states], run.qd)


def problem(case: Case) -> None:
    """A prepared problem gives the same runs from any start, whatever ran before."""
    for scene in (case.scene, case.scene.varied(WITHIN)):
        again, run = fl.Problem(scene), fl.simulate(scene.varied({"name": "test"}))
        same(again.simulate(), fl.simulate(scene))
        t, q, qd = run.state(3)
        rest = float(round(run.t[-1] - t, 9))
        same(again.simulate(q0=q, qd0=qd, t0=t, duration=rest), fl.simulate(scene, q0=q, qd0=qd, t0=t, duration=rest))
        same(again.simulate(), fl.simulate(scene))


def archive(case: Case) -> None:
    """A saved run reads back equal to the bit, and so do all results derived from it."""
    with tempfile.TemporaryDirectory() as folder:
        again = fl.Trajectory.load(case.run.save(Path(folder) / "run.npz"))
    same(again, case.run)
    for name in ("qdd", "imbalance", "work"):
        np.testing.assert_array_equal(getattr(again, name), getattr(case.run, name), err_msg=name)
    np.testing.assert_array_equal(again.loads.hinge_moment, case.run.loads.hinge_moment)
    assert list(again.columns) == list(case.run.columns)
    for name, column in case.run.columns.items():
        np.testing.assert_array_equal(again.columns[name], column, err_msg=name)


def accelerations(case: Case) -> None:
    """q̈ of a run satisfies the equation of motion with the torques and wrenches of the run."""
    run, k = case.run, len(case.run.t) // 2
    q, qd, qdd = run.q[k], run.qd[k], run.qdd[k]
    left = fl.inverse_dynamics(run.chain, q, qd, qdd, tip_wrench=run.tip_wrench[k]) + fl.elastic_torque(run.chain, q)
    left += fl.friction_torque(run.chain, qd) + fl.drag_torque(run.chain, q, qd) - run.tau[k]
    left = case.motions(np.arange(run.chain.n)).T @ left
    close(left, np.zeros(len(left)), 0.0, 1e-10 * (1 + np.abs(run.tau[k]).max() + np.abs(qdd).max()))
    loads = fl.strength.internal_loads(run.chain, q, qd, qdd, tip_wrench=run.tip_wrench[k])
    close(run.loads.hinge_moment[k], loads.hinge_moment, 1e-9, 1e-12)


def sensitivity(case: Case) -> None:
    """Sensitivities of the final state to a mass and all stiffnesses match fourth-order differences of runs."""
    young = {f"material.{name}.young": material.young for name, material in case.scene.arm.materials.items()}
    start = {case.mass: case.scene.arm.links[-1].end.mass + 0.2, **young}
    units = np.array([1.0, *young.values()])
    scene = case.scene.varied({case.mass: start[case.mass]})
    found = fl.sensitivities(scene, list(start))

    def end(h: float) -> np.ndarray:
        changed = {path: value + h * unit for (path, value), unit in zip(start.items(), units, strict=True)}
        run = fl.simulate(scene.varied(changed))
        return np.concatenate([run.q[-1], run.qd[-1]])

    wanted, coarse = difference(end, 2e-4), difference(end, 4e-4)
    slopes = np.concatenate([found.q[-1], found.qd[-1]]) @ units
    error = np.maximum(found.q_error, found.qd_error) @ units
    close(slopes, wanted, 1e-7, 2 * np.abs(wanted - coarse).max() + error)
    assert error <= 1e-4 * np.abs(wanted).max()


def gradient(case: Case) -> None:
    """The gradient of a run matches fourth-order differences of runs along its torques, initial angles and rates."""
    gradient_of(case, case.scene, 1e-3, 0.0)
    # the iteration of a step ends at an error of 1e-13 of the arm's size, and may be cut off later at another start
    gradient_of(case, case.scene.varied({"run.method": "Radau5", "run.step": 2e-4}), 1e-4, 1e-7)


def gradient_of(case: Case, scene: fl.Scene, step: float, part_of_size: float) -> None:
    """`gradient` of one method, by differences with this step."""
    dice, times, chain = np.random.default_rng(1), case.run.t[:-1], case.run.chain
    free = [k for k, link in enumerate(scene.arm.links) if not link.joint.locked]
    tau, pull = dice.normal(size=(len(times), len(chain.active))), dice.normal(size=(2, len(times) + 1, chain.n))

    def moved(tau: np.ndarray, q: np.ndarray, qd: np.ndarray) -> fl.Trajectory:
        torques = np.zeros((len(times), len(scene.arm.links)))
        torques[:, free[: tau.shape[1]]] = tau
        drive = fl.Drive(kind="table", times=tuple(times.tolist()), torques=tuple(map(tuple, torques)), hold=True)
        return fl.simulate(scene.varied({"drive": drive if tau.size else None}), q0=q, qd0=qd)

    start = tau, case.run.q[0], case.run.qd[0]
    found = fl.run_gradient(moved(*start), *pull)
    for part, slope in enumerate((found.dtau, found.dq, found.dqd)):
        along = dice.normal(size=slope.shape)

        def changed(h: float, part: int = part, along: np.ndarray = along) -> float:
            run = moved(*(x + h * along if k == part else x for k, x in enumerate(start)))
            return float((pull * [run.q, run.qd]).sum())

        wanted, coarse = difference(changed, step), difference(changed, 2 * step)
        size = np.linalg.norm(slope) * np.linalg.norm(along)
        close((slope * along).sum(), wanted, 1e-7, 2 * np.abs(wanted - coarse) + part_of_size * size)


def sensors(case: Case) -> None:
    """Accelerometer and gyroscope on the last link match the motion of its end."""
    link = case.scene.arm.links[-1].name
    tip = link if len(case.chain.tips) > 1 else None
    kinds = {"accelerometer": "m/s²", "gyroscope": "rad/s"}
    felt = [
        fl.Sensor(name=f"{kind} {axis}", kind=kind, link=link, axis=tuple(np.eye(3)[k].tolist()))
        for kind in kinds for k, axis in enumerate("xyz")
    ]  # fmt: skip
    run = fl.simulate(case.scene.varied({"sensor": tuple(felt)}))
    end = [fl.point_motion(run.chain, *state, tip=tip) for state in zip(run.q, run.qd, run.qdd, strict=True)]
    for kind, unit in kinds.items():
        readings = np.array([run.readings[f"{kind} {axis} [{unit}]"] for axis in "xyz"]).T
        close(readings, np.array([getattr(point, kind) for point in end]), 1e-9, 1e-9)
