"""Air drag against closed forms: a bar that slows down, and a strip whose vibration decays.

A rotating rigid bar obeys I ω̇ = −β ω² with β = ∫ ½ ρ c_d b x³ dx, hence ω = ω₀ / (1 + β ω₀ t / I). A clamped strip
in its first mode φ, with φ = 1 at the tip, loses energy in each period; its amplitude A obeys

    d(1/A)/dt = 4/(3π) ½ ρ c_d b ∫|φ|³ dx / (ρA ∫φ² dx) ω        with 4/(3π) the mean of |cos³|

to first order in the relative loss per period. φ is the mode shape of the continuous beam.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from mpmath import mp

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.kinds import kind
from validation.oracles.planar_chain import DIGITS
from validation.oracles.spatial_chain import SpatialChain, exactly
from validation.physics.variant import Rule
from validation.runs import motion_in_mujoco, peaks
from validation.store import Series, table

ROOT = 1.8751040687119611  # βL of a clamped beam's first mode, cos β cosh β = −1


class Settings(Spec, frozen=True):
    """Integration settings for the bar; chains and amplitude [m] of the strip; random states of arms with drag."""

    ways: tuple[dict[str, Any], ...]
    chains: tuple[Rule, ...]
    amplitude: Positive
    states: int
    seed: int = 1


@kind
def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield errors of the bar by method, of the strip by chain, and of drag torques against 50-digit arithmetic."""
    bar, strip, arm = case.load_scenes()
    for way in settings.ways:
        scene = bar.varied({f"run.{key}": value for key, value in way.items()})
        found = fl.simulate(scene)
        yield Measured("rate of a bar", _rate_error(scene, found), bar.name, varied=way)
        lost = float(np.abs(found.imbalance).max() / np.max(found.energy.kinetic))
        yield Measured("power balance", lost, bar.name, varied=way)
    yield motion_in_mujoco(bar)  # which receives T_DRAG as torques, and computes everything else
    for rule in settings.chains:
        ringing = _ringing(strip, rule, settings.amplitude)
        t, amplitudes = peaks(fl.simulate(ringing))
        slope = np.polyfit(t, 1 / amplitudes, 1)[0]
        yield Measured("decay of a strip", float(abs(slope / _decay(ringing) - 1)), strip.name, varied=rule.facts)
    rows = [("run", x, 1e3 * a) for x, a in zip(t.tolist(), amplitudes.tolist(), strict=True)]
    rows += [("closed form", x, 1e3 / (1 / amplitudes[0] + _decay(ringing) * (x - t[0]))) for x in t.tolist()]
    yield Series(
        "decay", "Amplitude of a strip damped only by drag", table(("curve", "t [s]", "amplitude [mm]"), rows),
        "t [s]", "t [s]", "amplitude of the tip [mm]", group="curve", scene=strip.name,
    )  # fmt: skip
    yield Measured("T_DRAG in 50 digits", _torque_error(arm, settings), arm.name)


def _rate_error(scene: Scene, run: fl.Trajectory) -> float:
    drag, start = scene.arm.links[0].drag, float(run.qd[0, 0])
    assert drag is not None and drag.breadth is not None
    β = 0.5 * scene.fluid_density * drag.coefficient * drag.breadth[0] * scene.arm.links[0].length ** 4 / 4
    inertia = scene.arm.links[0].hub.inertia[2]
    exact = start / (1 + β * start * run.t / inertia)
    return float(np.abs(run.qd[:, 0] / exact - 1).max())


def _ringing(strip: Scene, rule: Rule, amplitude: float) -> Scene:
    """The strip, released from rest in the first mode shape of its chain; `amplitude` is the tip deflection [m]."""
    scene = strip.varied({"link.strip.lumping": rule.rule, "link.strip.segments": rule.hinges + 1})
    chain = fl.lump(scene)
    shape = fl.modes(chain, count=1).shapes[0].real
    start = amplitude * shape / (fl.jacobian(chain, np.zeros(chain.n)).linear[1] @ shape)
    return scene.varied({"initial.q": tuple(start.tolist())})


def _decay(scene: Scene) -> float:
    """Theoretical d(1/A)/dt [1/(m s)]."""
    arm, link = scene.arm, scene.arm.links[0]
    section, material = arm.sections["strip"], arm.materials["aluminium"]
    assert link.drag is not None and section.width is not None
    x, weights = (np.polynomial.legendre.leggauss(40)[0] + 1) / 2, np.polynomial.legendre.leggauss(40)[1] / 2
    φ, tip = _mode(x), _mode(np.ones(1))[0]
    squared, cubed = weights @ (φ / tip) ** 2, weights @ np.abs(φ / tip) ** 3
    area, _, i_z, _ = section.properties
    ω = (ROOT / link.length) ** 2 * np.sqrt(material.young * i_z / (material.density * area))
    force = 0.5 * scene.fluid_density * link.drag.coefficient * section.width
    return float(4 / (3 * np.pi) * force * cubed / (material.density * area * squared) * ω)


def _mode(x: Array) -> Array:
    """The first mode shape of a clamped beam of length 1."""
    ratio = (np.sinh(ROOT) - np.sin(ROOT)) / (np.cosh(ROOT) + np.cos(ROOT))
    shape: Array = np.cosh(ROOT * x) - np.cos(ROOT * x) - ratio * (np.sinh(ROOT * x) - np.sin(ROOT * x))
    return shape


def _torque_error(arm: Scene, settings: Settings) -> float:
    """Largest error of the drag torques at random states, relative to the largest torque of each state."""
    chain, random = fl.lump(arm), np.random.default_rng(settings.seed)
    oracle, worst = SpatialChain(chain), 0.0
    for _ in range(settings.states):
        q, qd = random.uniform(-np.pi, np.pi, chain.n), random.normal(size=chain.n)
        with mp.workdps(DIGITS):
            exact = np.array(oracle.drag(exactly(q), exactly(qd)), dtype=np.float64)
        worst = max(worst, float(np.abs(fl.drag_torque(chain, q, qd) - exact).max() / np.abs(exact).max()))
    return worst
