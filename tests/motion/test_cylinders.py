"""Cylinders: pressures, forces, frequencies and equilibria of a boom on oil, against equations of another form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexlink as fl
from tests.dynamics.test_tied_small_motion import at_rest
from tests.motion.test_ties import INERTIA, pendulum
from tests.support.words import refused

a, b = 0.6, 0.5  # the cylinder joins the boom at a to a point b below its root
BORE, ROD, STROKE, β, DEAD, d = 0.02, 0.012, (0.5, 1.0), 1e9, 2e-6, 30.0
RAMP = 0.03  # s
A = np.pi / 4 * np.array([BORE**2, BORE**2 - ROD**2])
PRELOADED, SLACK = (5.2e6, 8e6), (1e5, 0.0)
AIR = 101325.0
TORQUE = 0.4 * 9.81 * 0.5


def length(θ: float) -> tuple[float, float]:
    """Distance of the ends, and its slope."""
    l = np.sqrt(a * a + b * b + 2 * a * b * np.sin(θ))
    return l, a * b * np.cos(θ) / l


def commanded(t: float, change: float = 0.1) -> tuple[float, float]:
    """Length that is pumped, and its rate, from that at −10°."""
    x = min(t / RAMP, 1.0)
    start = length(np.radians(-10.0))[0]
    return start + change * x**3 * (10 - 15 * x + 6 * x * x), change * 30 * x * x * (1 - x) ** 2 / RAMP


def boom(pressures: tuple[float, float], **more: object) -> fl.Scene:
    oil = {"bore": BORE, "rod": ROD, "stroke": list(STROKE), "bulk_modulus": β, "dead_volume": DEAD, "damping": d}
    moves = {"times": [0.0, RAMP], "lengths": [float(commanded(t)[0]) for t in (0.0, 1.0)]}
    tie = {"name": "lift", "kind": "cylinder", "link": "l1", "x": a, "to": {"point": [0.0, 0.0, -b]}, **oil, **moves}
    start = {"initial.joint_deg": [-10.0], "link.l1.joint.limits_deg": None}
    return pendulum(
        [tie | {"pressures": list(pressures)}], **start, **{"run.duration": 0.1, "run.sample": 0.002, **more}
    )


def volumes(l: float) -> np.ndarray:
    return DEAD + A * np.array([l - STROKE[0], STROKE[1] - l])


def swing(run: fl.Trajectory, empties: bool) -> tuple[np.ndarray, np.ndarray]:
    """Angles and pressures at the samples: oil flows in and out, Q = V ṁ/m, and ṗ = β (Q − V̇) / V; empty: V > m / ρ."""
    sides = np.array([1.0, -1.0])

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        (l, slope), (lc, speed) = length(y[0]), commanded(t)
        p = np.maximum(y[2:], -AIR) if empties else y[2:]
        force = A @ (sides * p) - d * (slope * y[1] - speed)
        flow = sides * A * speed / volumes(lc)
        return np.array([
            y[1], (force * slope - TORQUE * np.cos(y[0])) / INERTIA,
            *(β * (flow - sides * A * slope * y[1] / volumes(l))),
        ])  # fmt: skip

    accurate = {"method": "DOP853", "rtol": 1e-12, "atol": [1e-13, 1e-11, 1e-5, 1e-5], "max_step": 1e-3}
    start = [np.radians(-10.0), 0.0, *(SLACK if empties else PRELOADED)]
    y = solve_ivp(rates, (0.0, 0.1), start, t_eval=run.t, **accurate).y
    return y[0], np.maximum(y[2:].T, -AIR)


@pytest.mark.parametrize(("method", "part"), [("Radau9", 9e-8), ("DOP853", 1e-9)])  # 9e-8: by a tolerance of length
def test_pressures_are_those_of_two_chambers_with_flows(method: str, part: float) -> None:
    run = fl.simulate(boom(PRELOADED, **{"run.tolerance": 1e-10, "run.method": method}))
    angles, pressures = swing(run, empties=False)
    np.testing.assert_allclose(run.q[:, 0], angles, atol=1e-10)
    np.testing.assert_allclose(run.pressures["lift"], pressures, atol=part * pressures.max())
    rate = np.array(
        [length(θ)[1] * v - commanded(t)[1] for t, θ, v in zip(run.t, run.q[:, 0], run.qd[:, 0], strict=True)]
    )
    pull = run.pressures["lift"] @ (A * [-1.0, 1.0]) + d * rate
    np.testing.assert_allclose(run.tie_forces["lift"], pull, rtol=1e-9, atol=1e-7)
    assert np.abs(run.imbalance).max() < 1e-8 * run.exchanged[-1]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
def test_a_chamber_empties_and_fills_again(tolerance: float) -> None:
    run = fl.simulate(boom(SLACK, **{"run.tolerance": tolerance}))
    angles, pressures = swing(run, empties=True)
    assert (pressures == -AIR).any(axis=0).any()
    assert np.abs(run.q[:, 0] - angles).max() < 3 * tolerance
    assert run.pressures["lift"].min() == -AIR


def test_a_boom_rests_and_swings_on_closed_chambers() -> None:
    """K = −m g L/2 sin θ + (β Σ A² / V) l'² + λ l''; λ l' balances gravity."""
    scene = boom(PRELOADED, **{"initial.passive": "static", "drive": None})
    chain, rest = at_rest(scene)
    θ, λ = rest.q[0], rest.tie_forces["lift"]
    l, slope = length(θ)
    assert λ * slope == pytest.approx(-TORQUE * np.cos(θ), rel=1e-9)
    now = np.array(PRELOADED) + β * np.log(volumes(commanded(0.0)[0]) / volumes(l))
    assert λ == pytest.approx(A @ (now * [-1.0, 1.0]), rel=1e-7)
    bent = -a * b * np.sin(θ) / l - slope**2 / l
    stiffness = -TORQUE * np.sin(θ) + β * (A**2 / volumes(l)).sum() * slope**2 + λ * bent
    ω = fl.modes(chain, rest.q, ties=scene).frequencies[0]
    assert ω == pytest.approx(np.sqrt(stiffness / INERTIA), rel=1e-9)


@pytest.mark.parametrize(
    ("change", "id"),
    [
        ({"rod": 0.03}, "cylinder-sizes"), ({"stroke": [1.0, 0.5]}, "cylinder-sizes"),
        ({"stroke": [0.5, 0.6]}, "cylinder-sizes"), ({"bore": None}, "missing-key"),
        ({"stiffness": 1e5}, "key-of-another-kind"), ({"lengths": None}, "missing-key"),
    ],
)  # fmt: skip
def test_wrong_cylinders_are_refused(change: dict, id: str) -> None:
    with refused(fl.errors.SceneError, id):
        boom(PRELOADED).varied({f"tie.lift.{key}": value for key, value in change.items()})
    with refused(fl.errors.SceneError, "ties-not-supported"):
        fl.to_mjcf(fl.lump(boom(PRELOADED).varied({"tie": []})), ties=boom(PRELOADED))


def test_sensors_read_the_force_and_the_pressures_that_act_on_the_boom() -> None:
    """F = A_rod p_rod − A_bore p_bore + d ġ; a second gauge is in bar and slow; a law reads what the run shows."""
    pin = {"name": "pin", "kind": "force", "tie": "lift"}
    oil = {"name": "oil", "kind": "pressure", "tie": "lift"}
    slow = oil | {"name": "late", "gain": 1e-5, "unit": "bar", "low_pass": 5.0}
    fixed = {"lengths": None, "times": None, "damping": 0.0, "length": length(np.radians(-10.0))[0]}
    scene = boom(PRELOADED, sensor=[pin, oil, slow]).varied({f"tie.lift.{key}": each for key, each in fixed.items()})
    seen: list[dict] = []

    def law(_t: float, _q: np.ndarray, _qd: np.ndarray, sensors: dict) -> list[float]:
        seen.append(dict(sensors))
        return [0.0]

    run = fl.simulate(scene, control=law, rate=100.0)
    bore, rod = (run.readings[f"oil {side} [Pa]"] for side in ("bore", "rod"))
    np.testing.assert_allclose(np.transpose([bore, rod]), run.pressures["lift"])
    np.testing.assert_allclose(run.readings["pin [N]"], A @ [-bore, rod], rtol=1e-9)
    smoothed = run.readings["late bore [bar]"]
    assert np.ptp(smoothed) < 0.8e-5 * np.ptp(bore)
    for name in ("pin [N]", "oil bore [Pa]"):
        np.testing.assert_allclose([each[name] for each in seen], run.readings[name][::5][: len(seen)], rtol=1e-6)


@pytest.mark.parametrize(
    ("sensor", "id"),
    [
        ({"kind": "force", "tie": "other"}, "unknown-tie"), ({"kind": "force"}, "missing-key"),
        ({"kind": "pressure", "tie": "stop"}, "unknown-tie"), ({"kind": "strain", "tie": "lift"}, "missing-key"),
        ({"kind": "force", "tie": "lift", "link": "l1"}, "key-of-another-kind"),
        ({"kind": "gyroscope", "tie": "lift", "link": "l1"}, "key-of-another-kind"),
    ],
)  # fmt: skip
def test_sensors_that_a_tie_does_not_have_are_refused(sensor: dict, id: str) -> None:
    with refused(fl.errors.SceneError, id):
        boom(PRELOADED, sensor=[{"name": "s", **sensor}])
