"""The exact beam on a hub has textbook frequencies, converges, and agrees with fine chains; fits judged by it hold."""

import math

import numpy as np
import pytest
from scipy.interpolate import BPoly, PPoly

import flexlink as fl
from flexlink.identification.fitted import Estimate
from validation.case import CASES, load_case
from validation.kinds import planted_fits as kind
from validation.oracles import hub_beam
from validation.oracles.hub_beam import Beam, Drive

L, E, H, WIDTH, DENSITY = 0.6, 2e11, 0.003, 0.03, 7850.0
BEAM = Beam(
    L, E * WIDTH * H**3 / 12, DENSITY * WIDTH * H, DENSITY * WIDTH * H**3 / 12, 1e-3, tip_mass=0.1, hub=0.05,
    viscous=0.1,
)  # fmt: skip
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


def test_readings_converge_with_the_number_of_modes() -> None:
    """Readings of 14 and 28 modes; the accelerometer only after the step of the torque, which excites all modes."""
    few, many = (rig(BEAM, STEP).read(hub_beam.simulate(BEAM, STEP, T, count=count)) for count in (14, 28))
    off = {head: float(abs(few[head] - many[head])[1:].max() / np.ptp(many[head])) for head in HEADS}
    assert max(off[head] for head in HEADS if head not in ("accelerometer [m/s²]", "strain [1]")) < 1e-6, off
    assert max(off["accelerometer [m/s²]"], off["strain [1]"]) < 1e-4, off


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


@pytest.mark.parametrize(("true", "off"), [(4.0, -1.0), (3.0, -0.5), (2.0, 0.0), (1.5, 0.5), (1.0, 1.0)])
def test_a_distance_of_one_is_the_end_of_the_interval_on_that_side(true: float, off: float) -> None:
    assert kind.distance(Estimate("E", "", start=2.0, value=2.0, low=1.0, high=4.0, deviation=0.7), true) == off


@pytest.mark.slow
def test_two_fits_of_coarse_chains_contain_the_true_values_or_state_why_not() -> None:
    """More fits: python -m validation 'fits_continuous_beam*'."""
    outcomes = list(kind.held_beams(load_case(CASES / "fits_continuous_beam.toml").settings["seed"], 2))
    assert [(path, off) for one in outcomes if one.passed for path, off in one.off.items() if abs(off) > 1] == []
    assert all(one.passed or one.words for one in outcomes)
