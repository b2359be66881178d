"""Ties in other engines and in files: accelerations of random tied arms, and short runs."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import flexlink as fl
from flexlink.chain.lumping import open_chain
from flexlink.cli.main import main
from flexlink.dynamics.floating_base import FAR
from flexlink.dynamics.tied_motion import tied_acceleration
from flexlink.dynamics.ties import Ties, gaps, tie_rows
from tests.campaigns.ties_in_mujoco import given, judged, tied
from tests.motion.test_ties import arm, fourbar, rod
from tests.motion.test_ties import pin as point
from tests.support.loops import Loop
from tests.support.words import refused, refused_line, reviewed


class Start:
    """A random tied arm at its start, with q̈ and multipliers by flexlink."""

    def __init__(self, seed: int) -> None:
        self.scene = tied(seed)
        self.chain = chain = fl.lump(open_chain(self.scene))
        self.ties: Ties = tie_rows(self.scene, chain)
        self.q, self.qd = q, qd = fl.initial_state(self.scene, chain)
        self.torque = given(self.scene, chain)(0.0, q, qd)
        dry = chain.hinges["coulomb"] * np.tanh(qd / chain.hinges["coulomb_width"])
        self.free = fl.forward_dynamics(chain.without_forces(), q, qd, tau=self.torque + dry)
        self.qdd, self.λ = tied_acceleration(self.ties, chain, 0.0, q, qd, self.free)

    def agrees(self, qdd: np.ndarray) -> bool:
        """Whether these accelerations, and forces M (q̈ − q̈⁰) of ties, are q̈ and −Jᵀ λ up to rounding."""
        M, J = fl.mass_matrix(self.chain, self.q), gaps(self.ties, self.chain, self.q)[1]
        force, scale = M @ (qdd - self.free), max(np.abs(self.qdd).max(), np.abs(self.free).max())
        same = np.abs(force + J.T @ self.λ).max() <= 1e-9 * np.abs(M).max() * scale
        return bool(same and np.abs(qdd - self.qdd).max() <= 1e-9 * scale)


def by_pinocchio(start: Start) -> np.ndarray:
    """q̈ by constraints of Pinocchio's own, one for each point; its iteration takes redundant ones."""
    rows = start.ties[0]
    loop = Loop(start.chain, rows)
    model, data, order = loop.model, loop.data, loop.order
    placed = [[(end[0], pin.SE3(np.eye(3), end[1])) for end in ends] for ends in loop.ends[::3]]
    kind = pin.ContactType.CONTACT_3D
    points, states = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for one, other in placed:
        points.append(pin.RigidConstraintModel(kind, model, *one, *other, pin.LOCAL))
        states.append(points[-1].createData())
    model.armature[order] = start.chain.hinges["armature"]
    q, qd, τ = np.zeros((3, start.chain.n))
    q[order], qd[order] = start.q, start.qd
    chain, damper = start.chain.without_forces(), start.chain.damping * start.qd
    τ[order] = start.torque - fl.elastic_torque(chain, start.q) - damper
    pin.initConstraintDynamics(model, data, points, states)
    return pin.constraintDynamics(model, data, q, qd, τ, points, states, pin.ProximalSettings(1e-14, 1e-9, 100))[order]


def by_mujoco(start: Start) -> np.ndarray:
    """q̈ from M, from forces and from the equalities' J of MuJoCo, solved exactly; J̇ q̇ is a central difference."""
    chain = start.chain
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(chain, initial=(start.q, start.qd), ties=start.scene))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, order = mujoco.MjData(model), np.array([model.joint(name).qposadr[0] for name in chain.joint_names])
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qfrc_applied[order] = start.torque
    q, qd = data.qpos.copy(), data.qvel.copy()

    def J(side: float) -> np.ndarray:
        data.qpos[:], data.qvel[:] = q + side * qd, qd
        mujoco.mj_forward(model, data)
        return data.efc_J.reshape(-1, chain.n).copy()

    h = 1e-5 / max(np.abs(qd).max(), 1e-300)
    bent = (J(h) - J(-h)) @ qd / (2 * h)
    tied, M = J(0.0), np.zeros((chain.n, chain.n))
    mujoco.mj_fullM(model, data, M)
    Y = np.linalg.solve(M, tied.T)
    λ = np.linalg.lstsq(tied @ Y, tied @ data.qacc_smooth + bent, rcond=1e-10)[0]
    return (data.qacc_smooth - Y @ λ)[order]


@pytest.mark.filterwarnings("ignore:builtins.RuntimeWarning")
@pytest.mark.parametrize("seed", [6, 9, 21, 24, 45, 54], ids=lambda seed: f"seed {seed}")
def test_points_hinges_and_welds_act_as_constraints_of_pinocchio(seed: int) -> None:
    start = Start(seed)
    assert start.agrees(by_pinocchio(start))


@pytest.mark.filterwarnings("ignore:builtins.RuntimeWarning")
@pytest.mark.parametrize("seed", [0, 2, 5, 6, 7, 13, 14, 45, 54], ids=lambda seed: f"seed {seed}")
def test_ties_of_a_file_act_as_those_of_the_scene(seed: int) -> None:
    """Rods, points, hinges, welds, springs with and without play, and springs of joints."""
    start = Start(seed)
    assert start.agrees(by_mujoco(start))


def test_the_difference_of_a_run_in_mujoco_falls_with_the_square_of_its_step() -> None:
    """`python -m tests.campaigns.ties_in_mujoco 0 100` runs more arms."""
    coarse, fine = judged(0, (2e-5, 1e-5))[1]
    assert fine < coarse / 3 < 1e-6


@pytest.mark.parametrize("stiffness", [None, 300.0])
def test_joints_in_a_ratio_are_those_of_a_file(stiffness: float | None) -> None:
    scene = two_links(
        {"name": "pair", "kind": "joint", "link": "l2", "ratio": -2.5, "to": {"link": "l1"}, "stiffness": stiffness}
    )
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(fl.lump(open_chain(scene)), ties=scene))
    data, g = mujoco.MjData(model), 0.1
    data.qpos[:] = 0.2, g - 2.5 * 0.2
    mujoco.mj_forward(model, data)
    if stiffness is None:
        np.testing.assert_allclose(data.efc_J.reshape(-1, 2), [[2.5, 1.0]], atol=1e-15)
        np.testing.assert_allclose(data.efc_pos, [g], atol=1e-15)
    else:
        np.testing.assert_allclose(data.qfrc_spring, [-2.5 * stiffness * g, -stiffness * g], rtol=1e-12)


def two_links(*ties: dict, **second: object) -> fl.Scene:
    return arm({"length": 0.4}, {"length": 0.5, **second}, ties=list(ties), start=[20.0, -50.0])


def test_a_stop_presses_at_both_limits_as_in_a_file() -> None:
    """Beyond its limits by 0.1 rad it exerts 100 N m/rad · 0.1 rad, and within them nothing."""
    stop = {"name": "stop", "kind": "stop", "link": "l2", "stiffness": 100.0}
    scene = two_links(stop, joint={"axis": [0, -1, 0], "limits_deg": [-60.0, 30.0]})
    model = mujoco.MjModel.from_xml_string(fl.to_mjcf(fl.lump(open_chain(scene)), ties=scene))
    data = mujoco.MjData(model)
    for degrees, torque in ((-60.0, 10.0), (30.0, -10.0), (0.0, 0.0)):
        data.qpos[:] = 0.0, np.radians(degrees) - 0.01 * torque
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_passive, [0.0, torque], atol=1e-12)


@pytest.mark.parametrize(
    "tie",
    [
        {"name": "guide", "kind": "slider", "link": "l2", "to": {"point": [0, 0, 0], "axis": [1, 0, 0]}},
        {**point("l2", 0.8, 0.0, 0.0), "stiffness": 1e3, "damping": 1.0},
        rod(link="l2", length=0.3),
        {**rod(link="l2", length=0.3), "to": {"point": [0.9, 0.0, 0.0]}},
    ],
    ids=["slider", "bushing", "stretched at zero angles", "without length at zero angles"],
)
def test_ties_that_mjcf_does_not_have_are_refused_by_name(tie: dict) -> None:
    scene = two_links(tie)
    with refused(fl.errors.SceneError, "ties-not-supported"):
        fl.to_mjcf(fl.lump(open_chain(scene)), ties=scene)


def test_a_tie_on_a_segment_that_is_not_in_the_file_is_refused() -> None:
    cross = {"length": 0.0, "material": None, "section": None, "joint": {"axis": [0, 0, 1]}}
    scene = arm({"length": 0.4}, cross, {"length": 0.5}, ties=[point("l2", 0.4, 0.0, 0.0)], start=[0.0, 0.0, 0.0])
    with refused(fl.errors.ArgumentError, "joint-without-inertia"):
        fl.to_mjcf(fl.lump(open_chain(scene)), ties=scene)


def test_an_export_reports_what_becomes_of_ties(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = two_links(rod(link="l2", times=[0.0, 1.0], lengths=[0.5, 0.6], stiffness=1e4))
    path = str(scene.save(tmp_path / "rod.toml"))
    assert main(["export", path, "--out", str(tmp_path)]) == 0
    for line in capsys.readouterr().err.splitlines():
        reviewed("format-cannot-store", line.removesuffix("  [format-cannot-store]"))
    (file,) = tmp_path.glob("*.xml")
    assert mujoco.MjModel.from_xml_path(str(file)).ntendon == 1
    assert main(["export", path, "--c", str(tmp_path / "rod.c")]) == 2
    refused_line(capsys.readouterr().err, "ties-not-supported")


@pytest.mark.parametrize("bends", [{}, {"flex": "z", "segments": 3}], ids=["rigid", "bending"])
def test_a_loop_on_a_free_base_moves_as_in_mujoco(bends: dict) -> None:
    """The base turns by more than its angles may, so that their reference changes."""
    scene = fourbar(**bends).varied({
        "base": {"kind": "free", "mass": 2.0, "inertia": [0.05, 0.08, 0.1]}, "gravity": [0, 0, 0],
        "initial.base": {"spin_deg": [45.0, -75.0, 150.0]}, "initial.rate_deg": [100.0, 0.0, 0.0],
        "run": {"duration": 0.8, "sample": 0.8, "tolerance": 1e-6},
    })  # fmt: skip
    run = fl.simulate(scene)
    assert np.abs(run.q[:, 3:6]).max() > FAR
    assert run.momentum_error is None
    chain, step = fl.Problem(scene).chain, 5e-5
    file = fl.to_mjcf(chain, initial=fl.initial_state(scene, chain), ties=scene, timestep=step)
    model = mujoco.MjModel.from_xml_string(file)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, round(0.8 / step))
    np.testing.assert_allclose(data.body("base_link").xpos, run.q[-1, :3], atol=3e-6)
