"""A link in a floating frame with linear modes, by its exact clamped modes, with NumPy and SciPy only.

The textbook's equations of a beam on a hub whose points are displaced by w = Σ φ_i q_i across the axes of the hub, and
not along it: the beam becomes longer as it bends, and nothing stiffens it. In the notation of `hub_beam`,

    (I + qᵀM_w q) θ̈ + cᵀq̈ = τ − 2 θ̇ q̇ᵀM_w q          M q̈ + c θ̈ + K q = θ̇² M_w q

A program with such a frame must reproduce this motion, also where it is wrong.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from validation.oracles import hub_beam

Floats = np.ndarray
RELATIVE, ABSOLUTE = 1e-7, 1e-8  # tolerances; the second relative to the torque


def tip(beam: hub_beam.Beam, torque: Callable[[float], float], t: Floats, count: int) -> Floats:
    """Tip in frame 0, shape (samples, 2), from rest at θ = 0, with `count` modes."""
    shapes = hub_beam.modes(beam, count)
    parts, n = hub_beam.matrices(beam, shapes), count + 1

    def rates(time: float, y: Floats) -> Floats:
        q, θd, qd = y[1:n], y[n], y[n + 1 :]
        moved = parts.M @ q  # without rotary inertia, M = M_w
        M = np.block([[np.array([[parts.I + q @ moved]]), parts.c[None]], [parts.c[:, None], parts.M]])
        force = np.append(torque(time) - 2 * θd * (qd @ moved), θd**2 * moved - parts.K @ q)
        return np.concatenate([y[n:], np.linalg.solve(M, force)])

    scale = max(abs(torque(time)) for time in t.tolist())
    found = solve_ivp(
        rates, (t[0], t[-1]), np.zeros(2 * n), method="DOP853", t_eval=t, rtol=RELATIVE, atol=ABSOLUTE * scale
    ).y
    w, cos, sin = found[1:n].T @ shapes.at(beam.length, 0)[:, 0], np.cos(found[0]), np.sin(found[0])
    return np.column_stack([beam.length * cos - w * sin, beam.length * sin + w * cos])
