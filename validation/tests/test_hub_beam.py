"""The exact beam on a hub has textbook frequencies, converges, and agrees with fine chains; fits judged by it hold."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, PPoly
from scipy.linalg import eigh
from scipy.optimize import brentq

import flexlink as fl
from validation.case import CASES, load_case
from validation.kinds import planted_fits as kind
from validation.oracles import hub_beam
from validation.oracles.hub_beam import Beam, Drive

L, E, H, WIDTH, DENSITY = 0.6, 2e11, 0.003, 0.03, 7850.0
BEAM = Beam(
    L,
    E * WIDTH * H**3 / 12,
    DENSITY * WIDTH * H,
    DENSITY * WIDTH * H**3 / 12,
    1e-3,
    tip_mass=0.1,
    hub=0.05,
    viscous=0.1,
)
T = np.linspace(0.0, 1.0, 201)
ANGLE = math.radians(8.0)
MOVE = PPoly.from_bernstein_basis(BPoly.from_derivatives([0.0, 0.4, 3.0], [[0, 0, 0], [ANGLE, 0, 0], [ANGLE, 0, 0]]))
STEP, PULSE = Drive(kp=30.0, kd=3.0, target=ANGLE), Drive(jumps=(0.0, 0.1, 0.2), torques=(0.6, -0.6, 0.0))
SENSORS = (
    fl.Sensor(name="gyroscope", kind="gyroscope", link="boom", x=0.3, axis=(0.0, 0.0, 1.0)),
    fl.Sensor(name="accelerometer", kind="accelerometer", link="boom", axis=(0.0, 1.0, 0.0)),
    fl.Sensor(name="strain", kind="strain", link="boom", x=0.05, fibre=(H / 2, 0.0)),
    fl.Sensor(name="torque", kind="torque", link="boom"),
)
HEADS = ("tip y [m]", "q boom [rad]", "gyroscope [rad/s]", "accelerometer [m/s²]", "strain [1]", "torque [N m]")


def rig(beam: Beam, drive: Drive, segments: int = 17) -> kind.Rig:
    return kind.Rig(beam, drive, E, H, WIDTH, DENSITY, SENSORS, HEADS, (), segments)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 5.0])
def test_frequencies_with_a_tip_mass_are_those_of_the_characteristic_equation(ratio: float) -> None:
    """1 + cosh x cos x + μ x (cos x sinh x − sin x cosh x) = 0, μ = m/ρAL (Blevins)."""

    def zero(x: float) -> float:
        return 1 / math.cosh(x) + math.cos(x) + ratio * x * (math.cos(x) * math.tanh(x) - math.sin(x))

    beam = BEAM._replace(tip_mass=ratio * BEAM.rho_a * L)
    for x in (hub_beam.modes(beam, 8).β * L).tolist():
        assert x == pytest.approx(brentq(zero, x - 0.1, x + 0.1, xtol=1e-13), rel=1e-11)


@pytest.mark.parametrize("stiffness", [1e-3, 5.0])
def test_frequencies_with_a_root_spring_are_those_of_the_characteristic_equation(stiffness: float) -> None:
    """1 + cosh x cos x + (x/κ) (cos x sinh x − sin x cosh x) = 0, κ = kL/EI (Blevins), without a tip mass."""
    beam = BEAM._replace(tip_mass=0.0, rho_i=0.0, root=stiffness * BEAM.EI / L)
    parts = hub_beam.matrices(beam, hub_beam.modes(beam, 30))

    def zero(x: float) -> float:
        return 1 / math.cosh(x) + math.cos(x) + x / stiffness * (math.cos(x) * math.tanh(x) - math.sin(x))

    for value in eigh(parts.K, parts.M, eigvals_only=True)[:4].tolist():
        x = (value * beam.rho_a / beam.EI) ** 0.25 * L
        assert x == pytest.approx(brentq(zero, 0.98 * x, 1.02 * x, xtol=1e-13), rel=2e-5)


def test_modes_are_orthogonal_with_the_tip_and_have_their_frequencies() -> None:
    beam = BEAM._replace(tip_inertia=1e-4, rho_i=0.0)
    shapes = hub_beam.modes(beam, 14)
    found = hub_beam.matrices(beam, shapes)
    size = np.sqrt(np.diag(found.M))
    assert np.allclose(found.M / np.outer(size, size), np.eye(14), atol=1e-12)
    assert np.allclose(found.K / np.outer(size * shapes.ω, size * shapes.ω), np.eye(14), atol=1e-11)


def test_readings_converge_with_the_number_of_modes() -> None:
    """Readings of 14 and 28 modes; the accelerometer only after the step of the torque, which excites all modes."""
    few, many = (rig(BEAM, STEP).read(hub_beam.simulate(BEAM, STEP, T, count=count)) for count in (14, 28))
    off = {head: float(abs(few[head] - many[head])[1:].max() / np.ptp(many[head])) for head in HEADS}
    assert max(off[head] for head in HEADS if head not in ("accelerometer [m/s²]", "strain [1]")) < 1e-6, off
    assert max(off["accelerometer [m/s²]"], off["strain [1]"]) < 1e-4, off


@pytest.mark.slow
def test_exponentials_and_iteration_agree_with_a_stiff_solver() -> None:
    """Four modes and a root spring, on a tilted base, by SciPy's Radau on the coupled equations."""
    beam = BEAM._replace(gravity=(0.4, 0.5), root=150.0)
    parts, n = hub_beam.matrices(beam, hub_beam.modes(beam, 4)), 5
    found = hub_beam.simulate(beam, STEP, T, count=4)

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        θ, q, θd, qd = y[0], y[1 : n + 1], y[n + 1], y[n + 2 :]
        gx, gy = 0.4 * np.cos(θ) + 0.5 * np.sin(θ), 0.5 * np.cos(θ) - 0.4 * np.sin(θ)
        M = np.block([[np.array([[parts.I + q @ parts.N @ q]]), parts.c[None]], [parts.c[:, None], parts.M]])
        hub = STEP.kp * (STEP.target - θ) - (STEP.kd + beam.viscous) * θd - 2 * θd * (qd @ parts.N @ q)
        hub += gy * (parts.S - q @ parts.H @ q / 2) - gx * (parts.a @ q)
        bent = -parts.K @ q - parts.D @ qd + θd**2 * parts.N @ q + gy * parts.a - gx * parts.H @ q
        return np.concatenate([y[n + 1 :], np.linalg.solve(M, np.append(hub, bent))])

    start = np.concatenate([[0.0], found.q[0], np.zeros(n + 1)])
    judge = solve_ivp(slope, (0.0, T[-1]), start, method="Radau", t_eval=T, rtol=1e-9, atol=1e-12).y
    assert abs(judge[0] - found.θ).max() < 1e-6 * ANGLE
    assert abs(judge[1 : n + 1].T - found.q).max() < 1e-5 * abs(found.q).max()


@pytest.mark.parametrize(
    ("beam", "drive"),
    [(BEAM, STEP), (BEAM._replace(gravity=(0.0, 0.5), root=150.0), STEP), (BEAM, PULSE), (BEAM, Drive(angle=MOVE))],
    ids=["step", "tilted, with a root spring", "torque", "prescribed"],
)
def test_a_chain_of_17_segments_agrees_in_all_sensors(beam: Beam, drive: Drive) -> None:
    """RMS differences relative to each column's range."""
    made = rig(beam, drive)
    exact = made.read(made.motion(np.linspace(0.0, kind.DURATION, 401)))
    run = fl.simulate(kind.scene(made).varied({"run.relative_tolerance": 1e-8}))
    off = {
        head: float(np.sqrt(np.mean((run.columns[head] - y)[1:] ** 2)) / (np.ptp(y) or 1.0))
        for head, y in exact.items()
    }
    assert max(off.pop("accelerometer [m/s²]"), off.pop("gyroscope [rad/s]")) < 1e-4, off
    assert max(off.values()) < 3e-5, off


@pytest.mark.slow
def test_two_fits_of_coarse_chains_contain_the_true_values_or_state_why_not() -> None:
    """More fits: python -m validation 'fits_continuous_beam*'."""
    outcomes = list(kind.held_beams(load_case(CASES / "fits_continuous_beam.toml").settings["seed"], 2))
    assert [(path, off) for one in outcomes if one.passed for path, off in one.off.items() if abs(off) > 1] == []
    assert all(one.passed or one.words for one in outcomes)
