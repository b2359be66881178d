"""Drift of conserved quantities and growth of rounding errors in long or chaotic motions."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy import linalg

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes import methods
from flexlink.describe.spec import Positive
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.terms import gravity_torque, mass_matrix
from flexlink.dynamics.vibration.stability_function import stability_function
from flexlink.engines import load
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from flexlink.results.trajectory import Trajectory
from validation.case import Case, Measured
from validation.facts import Fact, Facts
from validation.kinds import kind
from validation.runs import motion_series, points_of
from validation.store import Series, table


@kind
def energy_drift(case: Case, steps: dict[str, tuple[float, ...]]) -> Iterator[Measured | Series]:
    """Energy drift of runs without friction, compared with a prediction from the method's damping of the excited modes.

    A straight arm released under gravity starts away from its static equilibrium: each elastic mode m receives the
    energy E_m = ½ (φ_m·T_G)² / ω_m², with φ_m its shape and φ_mᵀ M φ_m = 1. A Runge-Kutta method with the stability
    function R multiplies the mode's amplitude by |R(iω_m h)| in each step; N steps lose Σ_m E_m (1 − |R(iω_m h)|^2N).
    Rounding adds at most eps · kinetic energy per step.

    Yield measured and predicted drift of every method and step; `steps` [s] by method.
    """
    for scene in case.load_scenes():
        ω, E = released_modes(scene)
        points = []
        for method, step in ((m, h) for m, sizes in steps.items() for h in sizes):
            energy = simulate(scene, method=method, step=step).energy
            drift = float(np.abs(energy.total - np.asarray(energy.total)[0]).max())
            exchanged = float(np.abs(np.diff(energy.gravity)).sum())
            count = round(scene.run.duration / step)
            loss = modal_loss(method, ω * step, E, count)
            rounding = count * EPS * float(np.max(energy.kinetic))
            facts: Facts = {"method": method, "step": step}
            note = f"Predicted {loss:.2g} J, rounding at most {rounding:.2g} J."
            yield Measured("drift", drift, scene.name, varied=facts, scale=loss + rounding, note=note)
            yield Measured("drift / energy exchanged", drift / exchanged, scene.name, varied=facts)
            points.append((method, step, drift, loss + rounding))
        columns = table(("method", "step [s]", "measured", "predicted"), points)
        yield Series(
            "drift", f"{scene.name}: energy drift in {scene.run.duration:g} s", columns, "step [s]",
            "step [s]", "energy drift [J]", "log", "log", group="method", scene=scene.name,
        )  # fmt: skip


def released_modes(scene: Scene) -> tuple[Array, Array]:
    """Frequencies ω [rad/s] of the elastic modes at the initial state, and the energy E [J] of each when released."""
    chain = lump(scene)
    q, _ = initial_state(scene, chain)
    squares, Φ = linalg.eigh(chain.matrix("stiffness"), mass_matrix(chain, q))  # Φᵀ M Φ = 1
    force = Φ.T @ (gravity_torque(chain, q) + chain.times("stiffness", q - chain.rest))
    elastic = squares > 1e-9 * squares.max()  # the other modes are rigid: their ω² is only rounding error
    ω: Array = np.sqrt(squares[elastic])
    return ω, 0.5 * force[elastic] ** 2 / ω**2


def modal_loss(method: str, ωh: Array, E: Array, steps: int) -> float:
    """Magnitude of the energy [J] that `method` removes from or adds to the modes in `steps` steps."""
    R = np.abs(stability_function(methods.method(method), 1j * ωh))
    return float((E * np.abs(np.expm1(2 * steps * np.log(R)))).sum())


SAMPLES = 200
SAMPLES_OF_A_HUNDREDTH = SAMPLES // 100


@kind(long=True)
def long_runs(case: Case, number: int, steps: dict[str, Positive]) -> Iterator[Measured | Series]:
    """Drift of energy, angular momentum and time over millions of steps of a conservative arm.

    Without gravity and friction the energy E is constant, and so is the momentum (M q̇)₁ of the first joint, about
    which no torque acts. Each step adds the method's error and a rounding error of at most eps times E or (M q̇)₁. The
    drift thus grows at most in proportion to the number of steps, and is compared with the drift in the first hundredth
    of the run.

    Yield relative drifts of every method with its step [s], and their ratios to linearly extrapolated drifts.
    """
    for scene in case.load_scenes():
        rows = list[tuple[str, float, float, float]]()
        for method, step in steps.items():
            facts: Facts = {"method": method, "step": step, "steps": number}
            found = simulate(_long(scene, method, step, number))
            late = float(np.abs(found.t - np.arange(len(found.t)) * (number // SAMPLES) * step).max() / step)
            yield Measured("time", late, scene.name, varied=facts)
            drifts = {"energy": _drift(np.asarray(found.energy.total)), "momentum": _drift(_momentum(found))}
            for what, drift in drifts.items():
                expected = 100 * drift[: SAMPLES_OF_A_HUNDREDTH + 1].max() + number * EPS
                note = f"First hundredth of the run: {drift[: SAMPLES_OF_A_HUNDREDTH + 1].max():.2g}."
                yield Measured(f"{what} drift", float(drift.max()), scene.name, varied=facts, note=note)
                yield Measured(f"{what} drift / expected", float(drift.max() / expected), scene.name, varied=facts)
            counts = np.arange(len(found.t)) * (number // SAMPLES)
            rows += zip([method] * len(counts), counts[1:], drifts["energy"][1:], drifts["momentum"][1:], strict=False)
        columns = table(("method", "steps", "energy", "momentum"), rows)
        title = f"{scene.name}: drift in {number:,} steps"
        yield Series("long run", title, columns, "steps", "steps [1]", "drift [1]", "log", "log", group="method",
                     scene=scene.name)  # fmt: skip


def _long(scene: Scene, method: str, step: float, number: int) -> Scene:
    sample = step * (number // SAMPLES)
    return scene.varied({"run": {"method": method, "step": step, "sample": sample, "duration": SAMPLES * sample}})


def _drift(values: Array) -> Array:
    """Largest change up to each sample, relative to the first value."""
    return np.maximum.accumulate(np.abs(values / values[0] - 1))


def _momentum(run: Trajectory) -> Array:
    """(M q̇)₁ of every sample [kg m²/s]."""
    return np.array([mass_matrix(run.chain, q)[0] @ qd for q, qd in zip(run.q, run.qd, strict=True)])


@kind(long=True)
def rounding_growth(
    case: Case, engines: tuple[str, ...], duration: Positive, step: Positive, parted: Positive = 1e-3
) -> Iterator[Measured | Series]:
    """Growth of rounding errors in a chaotic motion, and how long they explain the difference between engines.

    The errors are measured with the library alone: the initial angles change by one unit in the last place, up or down,
    or another solver for q̈ is used. The largest of these differences up to time t is the effect of rounding.

    Yield the growth rate, the horizon, and the largest ratio of an engine's difference to the effect of rounding.

    Runs have a duration and step [s]; the horizon ends at a difference of `parted` [rad].
    """
    for short in case.load_scenes():
        yield from motion_series(short, simulate(short))
        scene = short.varied({"run.duration": duration, "run.step": step})
        ours = simulate(scene)
        own = np.max([_running_max(other, ours.q) for other in _own_differences(scene)], axis=0)
        apart = own >= parted
        end = int(np.argmax(apart)) if apart.any() else len(own)
        within = slice(1, end)
        rate = float(np.polyfit(ours.t[within], np.log(own[within]), 1)[0])
        ulps = 0.5 * math.sqrt(1 / (rate * step))  # random sum of half an ulp per step over one e-folding time
        facts: dict[str, Fact] = {"method": scene.run.method, "step": scene.run.fixed_step}
        yield Measured("growth rate", rate, scene.name, varied=facts)
        yield Measured("horizon", float(ours.t[end - 1]), scene.name, varied=facts)
        curves = {"time [s]": ours.t, "native, one ulp or another solver": own}
        for name in engines:
            t, q, qd = load(name, ours.chain).integrate(scene)
            begun = (part[: short.run.samples] for part in (t, q, qd))
            yield from motion_series(short, points_of(short, ours.chain, *begun), name)
            curves[name] = _running_max(q, ours.q)
            ratio = float((curves[name][within] / own[within]).max())
            upto = facts | {"duration": float(ours.t[end - 1])}
            yield Measured("difference / rounding growth", ratio, scene.name, name, upto, scale=ulps)
            at_end = float(curves[name][short.run.samples - 1])
            yield Measured("max |Δq|", at_end, scene.name, name, facts | {"duration": short.run.duration})
        title = f"{scene.name}: difference up to time t"
        yield Series(
            "growth", title, curves, "time [s]", "time [s]", "max |Δq| up to t [rad]", y_scale="log", scene=scene.name
        )


def _own_differences(scene: Scene) -> Iterator[Array]:
    for solver in SOLVERS:
        if solver != scene.run.solver:
            yield simulate(scene, solver=solver).q
    for k, angle in enumerate(scene.initial.joint_deg):
        for way in (-np.inf, np.inf):
            if angle and not scene.arm.links[k].joint.locked:
                yield simulate(scene.varied({f"initial.joint_deg.{k + 1}": np.nextafter(angle, way)})).q


def _running_max(q: Array, reference: Array) -> Array:
    differences: Array = np.maximum.accumulate(np.abs(q - reference).max(axis=1))
    return differences
