"""A gear with play that limit-cycles
==================================

A boom slews on a worn gear with 4° of play; the motor's controller is 0.1 s late. In contact its gains are moderate.
Within the play the motor is eleven times as light, so they are too high, and the motor hammers. The gear is a ``joint``
tie with ``stiffness`` and ``play``.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import fsolve

import flexlink as fl

MOTOR, BOOM, LENGTH = 200.0, 2000.0, 4.0  # kg m², the motor's seen from the boom; m
K, PLAY, C = 8e5, np.radians(4.0), 0.35  # N m/rad, rad, s/rad
RATE, DELAY = 50.0, 0.09  # Hz, s
motor = fl.Link(name="motor", hub=fl.RigidBody(inertia=(0.0, 0.0, MOTOR)))
needle = fl.Link(  # massless; shows the motor in the film
    name="needle", line=((0.0, 0.0, 0.0), (-3.0, 0.0, 0.0)), joint=fl.Joint(locked=True)
)
boom = fl.Link(name="boom", on="motor", length=LENGTH)
gear = fl.details.Tie(name="gear", kind="joint", link="boom", stiffness=K, play=PLAY, dissipation=C)
scene = fl.Scene(
    name="worn gear",
    arm=fl.Arm(links=(motor, needle, boom), tip=fl.RigidBody(mass=BOOM / LENGTH**2)),
    gravity=(0.0, 0.0, 0.0),  # across the vertical axis
    tie=(gear,),
    run=fl.RunSettings(tolerance=1e-3, duration=20.0, sample=0.02),
)


def slewed(kd, **changes):
    """A move by 10° with a rate gain [N m s/rad]."""
    gains = {"kp": (1.5 * kd, 0.0, 0.0), "kd": (kd, 0.0, 0.0)}
    drive = fl.Drive(kind="pd", target_deg=(10.0, 0.0, 0.0), rate=RATE, delay=DELAY, **gains)
    return fl.simulate(scene.varied({"drive": drive}), **changes)


# %%
# To the left, a needle shows the motor.
slewed(4e3, duration=3.0).animate("gear_with_play.gif", fps=20, speed=0.5, width=480)

# %%
# How fast and how far? The describing function N(A, ω) replaces the gear by its torque's first harmonic for a twist
# A cos ωt. The oscillation is where the determinant of motor, boom and late controller is zero. Runs agree within 3 %.
phase = np.linspace(0, 2 * np.pi, 500, endpoint=False)


def unbalanced(x, kd):
    """Real and imaginary part of the determinant at ln ω [1/s], ln A [rad]."""
    w, A = np.exp(x)
    twist, rate = A * np.cos(phase), -A * w * np.sin(phase)
    depth, side = np.maximum(np.abs(twist) - PLAY / 2, 0.0), np.sign(twist)
    torque = side * K * depth * np.maximum(1 + C * side * rate, 0.0)
    N = 2 / A * np.mean(torque * np.exp(-1j * phase))
    late = np.exp(-1j * w * (DELAY + 0.5 / RATE)) * np.sinc(w / (2 * np.pi * RATE))
    held = kd * (1.5 + 1j * w) * late - MOTOR * w**2
    found = (held * (N - BOOM * w**2) - N * BOOM * w**2) / (K * BOOM * w**2)
    return found.real, found.imag


gains = np.array([3.5e3, 4e3, 5e3, 6e3, 7e3])  # N m s/rad
guess = np.log([38.0, PLAY])
predicted = np.exp([guess := fsolve(unbalanced, guess, kd) for kd in gains])
measured = []
for kd in gains:
    run = slewed(kd)
    twist = run.q[run.t > 10.0, 1]
    crossings = np.flatnonzero((twist[:-1] < 0) & (twist[1:] >= 0))
    period = 0.02 * np.diff(crossings).mean()
    measured.append((2 * np.pi / period, np.ptp(twist) / 2))
fig, panels = plt.subplots(2, 1, figsize=(5, 4.4), sharex=True, layout="constrained")
names, units = ("frequency [Hz]", "twist ± [°]"), (2 * np.pi, np.radians(1.0))
for panel, name, unit, line, dots in zip(
    panels, names, units, predicted.T, np.array(measured).T, strict=True
):
    panel.plot(gains, line / unit, label="describing function")
    panel.plot(gains, dots / unit, "o", label="runs")
    panel.set(ylabel=name, ylim=(0, 1.3 * line.max() / unit))
    panel.legend(frameon=False, loc="lower right")
    panel.grid(alpha=0.3)
panels[1].set(xlabel="rate gain [N m s/rad]")
