"""Linear control laws, slopes of the drive of a scene or of a law in Python, and the loops that they close.

    z_k+1 = F z_k + G δy_k        δu_k = H z_k + K δy_k        y = (q, q̇, sensor readings)

z is the memory of the law, such as its integrators; K has the sign of the law, so K < 0 for PD control.
"""

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.dynamics.vibration.derived_models import discrete
from flexlink.kernels.inputs.cascade import cascade
from flexlink.kernels.inputs.laws import CASCADE
from flexlink.kernels.inputs.record import Drive
from flexlink.motion.inputs.drives import gains_of, limited
from flexlink.motion.loop.plant import Plant
from flexlink.motion.sampled_control import SENSORS, Law, takes_sensors


class LinearLaw(NamedTuple):
    """F, G, H, K of a law."""

    F: Array  # (z, z)
    G: Array  # (z, p)
    H: Array  # (m, z)
    K: Array  # (m, p)


def proportional(K: Array) -> LinearLaw:
    """A law without memory, δu = K δy."""
    m, p = K.shape
    return LinearLaw(np.zeros((0, 0)), np.zeros((0, p)), np.zeros((m, 0)), K)


def law_of_drive(drive: Drive, plant: Plant) -> LinearLaw:
    """Slopes of a drive, with limits left out."""
    chain, zero = plant.chain, np.zeros(plant.chain.n)
    if drive.law >= CASCADE:
        return _cascade(drive, plant)
    gains = gains_of(chain, drive._replace(rate=0.0), plant.t, plant.q, zero).matrices()
    rows = chain.active[plant.moving]
    K = np.zeros((len(rows), len(plant.C)))
    K[:, : 2 * chain.n] = -np.hstack([gain[rows] for gain in gains])
    return proportional(K)


def _cascade(drive: Drive, plant: Plant) -> LinearLaw:
    """One instant of a cascade by differences, which are exact except for rounding since it is linear."""
    chain, d, servo = plant.chain, len(drive.joints), drive.servo.copy()
    servo[:, 1] = np.inf
    free = limited(drive._replace(servo=servo), np.full(d, np.inf))
    memory, n = drive.held.shape[1] - d, chain.n

    def instant(state: Array) -> Array:
        before, after = np.concatenate([np.zeros(d), state[:memory]]), np.zeros(d + memory)
        q, qd = state[memory : memory + n], state[memory + n :]
        cascade(free, free.model, plant.t, plant.t, q, qd, False, before, after)
        return after

    about = np.concatenate([np.zeros(memory), plant.q, np.zeros(n)])
    slopes = np.column_stack([instant(about + one) - instant(about - one) for one in np.eye(len(about))]) / 2
    by_outputs = np.hstack([slopes[:, memory:], np.zeros((d + memory, len(plant.C) - 2 * n))])
    rows = plant.moving
    return LinearLaw(slopes[d:, :memory], by_outputs[d:], slopes[rows, :memory], by_outputs[rows])


def law_in_python(law: Law, plant: Plant) -> LinearLaw:
    """Slopes of a law at rest in the state of the plant, by central differences of fourth order.

    Refused are laws that raise exceptions, do not return one finite number per driven joint, or have a memory: they
    return another torque when they are called a second time.
    """
    n, d = plant.chain.n, len(plant.chain.active)
    y = np.concatenate([plant.q, np.zeros(n), plant.seen])
    # relative to 1 rad, 1 rad/s or the size of a reading: the error is step⁴ times the fifth derivative, and 1e-13 of
    # the torque by rounding
    step = 1e-3
    steps = step * np.concatenate([np.ones(2 * n), np.abs(plant.C[2 * n :]).max(axis=1, initial=0.0)])
    steps[steps == 0.0] = step
    call = functools.partial(_torque, law, plant)
    before, slopes = call(y), np.zeros((d, len(y)))
    for k, (unit, h) in enumerate(zip(np.eye(len(y)), steps.tolist(), strict=True)):
        for factor, weight in ((1.0, 8.0), (2.0, -1.0)):
            moved = [call(y + sign * factor * h * unit) for sign in (1.0, -1.0)]
            slopes[:, k] += weight * (moved[0] - moved[1]) / (12.0 * h)
    if not np.array_equal(call(y), before):
        why = "returns another torque when it is called again at the same t, q and q̇, so it has a memory"
        remedy = "close fl.linearize(…).sampled(rate, delay) with its own matrices"
        text = f"control: law {_name(law)} {why}, whose slopes are unknown; {remedy}"
        raise ArgumentError(text, id="law-with-memory")
    return proportional(slopes[plant.moving])


def _torque(law: Law, plant: Plant, y: Array) -> Array:
    n, d = plant.chain.n, len(plant.chain.active)
    keywords = {SENSORS: dict(zip(plant.readings, y[2 * n :].tolist(), strict=True))} if takes_sensors(law) else {}
    try:
        given = np.asarray(law(plant.t, y[:n].copy(), y[n : 2 * n].copy(), **keywords), np.float64)
    except Exception as error:
        text = f"control: law {_name(law)} raised {type(error).__name__}: {error}"
        raise ArgumentError(text, id="law-failed") from error
    if given.shape != (d,) or not np.isfinite(given).all():
        wanted = f"expected one finite number per driven joint, shape ({d},)"
        why = f"control: law {_name(law)} returned {truncated(given.tolist())}; {wanted}"
        raise ArgumentError(why, id="law-failed")
    return given


def _name(law: Law) -> str:
    return str(getattr(law, "__qualname__", type(law).__name__))


# Closed loops: a plant with delays of its inputs, sampled, and a linear control law.
#
#     x_k+1 = A x_k + B u_k       y_k = C x_k       z_k+1 = F z_k + G y_k       u_k = H z_k + K y_k
#
# Without a rate all of it is continuous, with ẋ in place of x_k+1. A controller that reads a torque or an acceleration
# at the instant at which its own torque begins to act still sees the torque before.


class OpenLoop(NamedTuple):
    """ẋ = A x + B u or x_k+1 = A x_k + B u_k, with outputs y = C x."""

    A: Array  # (s, s)
    B: Array  # (s, m)
    C: Array  # (p, s)
    period: float  # sampling period [s]; 0: continuous

    def closed(self, law: LinearLaw, broken: int | None = None) -> Array:
        """Matrix of the closed loop for the state (x, z); without the feedback to input `broken`."""
        u, s = self.feedback(law), len(self.A)
        if broken is not None:
            u[broken] = 0.0
        whole = np.zeros((s + len(law.F),) * 2)
        whole[:s, :s], whole[s:, :s], whole[s:, s:] = self.A, law.G @ self.C, law.F
        whole[:s] += self.B @ u
        return whole

    def feedback(self, law: LinearLaw) -> Array:
        """Coefficients (m, s + z) of u for the state (x, z)."""
        return np.hstack([law.K @ self.C, law.H])


def open_loop(plant: Plant, rate: float, delay: ArrayLike = 0.0) -> OpenLoop:
    """The plant sampled at a `rate` [Hz], its inputs late by `delay` [s], one or (m,); continuous if the rate is 0."""
    if not rate:
        return OpenLoop(plant.A, plant.B, plant.C, 0.0)
    (A, B, C, D), _ = discrete(plant.matrices, 1.0 / rate, delay, plant.delays)
    if not D.any():
        return OpenLoop(A, B, C, 1.0 / rate)
    s, m = B.shape
    before = np.zeros((s + m, s + m))  # u_k-1 are further states
    before[:s, :s] = A
    return OpenLoop(before, np.vstack([B, np.eye(m)]), np.hstack([C, D]), 1.0 / rate)


def growth_of(matrix: Array, period: float) -> float:
    """Growth factor of the fastest growing motion, per sampling period, or per second if it is continuous."""
    if not np.isfinite(matrix).all():
        return np.inf
    λ = np.asarray(np.linalg.eigvals(matrix), np.complex128)
    if period:
        return float(np.abs(λ).max(initial=0.0))
    with np.errstate(over="ignore"):
        return float(np.exp(λ.real.max(initial=-np.inf)))
