"""The linear model agrees with the nonlinear equation of motion near a state."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg
from scipy.linalg import solve_continuous_are

import flexlink as fl
from flexlink import Chain, Damping, Joint, PrescribedMotion
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.dynamics.vibration.linear_model import graded
from flexlink.errors import ArgumentError
from tests.conftest import MODELS, flexible, make_scene
from tests.support.words import refused

EPS = np.finfo(float).eps
PAPER = next(path for path in MODELS if path.stem == "paper_fig5")


def hanging(chain: Chain) -> Equilibrium:
    """The static equilibrium of the arm with locked joints."""
    return fl.solve_static(chain, chain.rest, locked=chain.active.tolist())


@pytest.mark.parametrize("ratio", [0.0, 0.02])
def test_eigenvalues_of_the_linear_model_equal_the_eigenvalues_of_modes(ratio: float) -> None:
    damping = Damping(ratio=ratio, at_hz=3.0)
    chain = fl.lump(fl.load_scene(PAPER).varied({"link.upper.damping": damping, "link.fore.damping": damping}))
    rest = hanging(chain)
    model = fl.linearize(chain, rest.q, tau=rest.tau)
    modes = fl.modes(chain, rest.q).eigenvalues
    assert (np.abs(model.eigenvalues[:, None] - modes).min(axis=0) <= 1e-10 * np.abs(modes)).all()
    assert np.abs(model.rate).max() <= 1e-9, "an equilibrium"


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
