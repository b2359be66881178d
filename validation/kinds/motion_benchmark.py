"""Motions of flexible arms against continuous references: tip error by rule and hinges; the same run in MuJoCo.

MuJoCo has no prescribed joints. Instead, flexlink's torque is applied there at sampled states of the run and must
reproduce flexlink's accelerations, including the prescribed one.

The reference files also contain runs of the same chains by an independent program in absolute angles, which must agree.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import numpy as np

import flexlink as fl
from flexlink import engines
from flexlink.chain.arguments import require_one_of
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive
from flexlink.dynamics.rounding import in_units, of_acceleration
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.motion.inputs.actuation import motion_arrays
from flexlink.results.tip_motion import largest_distance
from flexlink.results.trajectory import Trajectory
from validation.case import Case, Measured
from validation.facts import Facts
from validation.physics.formulas import INPUTS
from validation.physics.hinge_sweep import Point, Sweep, published, report
from validation.physics.variant import Rule, Variant, existing
from validation.reference_values import look_up, reference_array
from validation.runs import run_facts, stable_steps
from validation.store import Series

LONG = True


class Settings(Sweep, frozen=True, kw_only=True):
    """Settings of the comparison.

    `best` is the chain that is checked, `beside` a second chain in the figure, and `parity` the chain that also runs in
    MuJoCo. `columns` are the columns of the tip's x and y in the reference. With `lag` the tip is given in the first
    joint's frame. Every chain runs with `of_stable` times its largest stable step.
    """

    reference: str
    best: Rule
    beside: Rule
    parity: Rule
    input: str = "none"
    columns: tuple[int, int] = (0, 1)
    lag: bool = False
    of_stable: Positive = 0.5


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield the sweep, the best chain with its time integration error, and MuJoCo's results."""
    exact = _exact(settings)
    run = functools.cache(lambda at: fl.simulate(_scene(case, settings, at)))
    points = [Point(at, _errors(settings, run(at), exact)) for at, _ in existing(case, settings.rules)]
    yield from report(settings, points, case.about, {"tip": "m"})
    scene, ours = _scene(case, settings, settings.best), run(settings.best)
    facts: Facts = {**settings.best.facts, **run_facts(scene.run)}
    for measure, error in _errors(settings, ours, exact).items():
        yield Measured(f"{measure} error", error, scene.name, varied=facts)
    step = scene.run.fixed_step
    half = fl.simulate(scene, step=step / 2)
    change = float(np.abs(half.tip - ours.tip).max())
    yield Measured("time integration error", change, scene.name, varied=facts, note=f"{step:.3g} s halved.")
    yield from _motion(case, settings, ours, run(settings.beside), exact)
    yield from _independent(case, settings, run)
    yield from _parity(_scene(case, settings, settings.parity), settings.parity)


def error_at(case: Case, settings: Settings, at: Rule) -> float:
    """Tip error [m], for a data sheet."""
    return _errors(settings, fl.simulate(_scene(case, settings, at)), _exact(settings))["tip"]


def mujoco_error_at(case: Case, settings: Settings, at: Rule) -> float:
    """Tip error [m] by MuJoCo's accelerations, from the exported file; ArgumentError if a joint is prescribed."""
    scene = _scene(case, settings, at)
    chain = fl.lump(scene)
    _, q, _ = engines.load("mujoco", chain).integrate(scene)
    tip = np.array([fl.tip_position(chain, row)[:2] for row in q])
    return largest_distance(tip, _exact(settings))


def _exact(settings: Settings) -> Array:
    """Tip of the reference, x and y (samples, 2) [m]."""
    return reference_array(settings.reference, "values")[:, list(settings.columns)]


def _scene(case: Case, settings: Settings, at: Rule) -> Scene:
    """The scene with its input and a step that divides the time between samples."""
    with_input = require_one_of(f"{case.path}: settings.input", settings.input, INPUTS)
    scene = with_input(Variant().build(case, at))
    steps = stable_steps(scene, scene.run.method, settings.of_stable)
    return scene.varied({"run.step": scene.run.spacing / steps})


def _errors(settings: Settings, run: Trajectory, exact: Array) -> dict[str, float]:
    found = {"tip": largest_distance(run.tip[:, :2], exact)}
    if settings.lag:
        θ = run.q[:, 0]
        ours, theirs = _lag(run.tip[:, :2], θ), _lag(exact, θ)
        found["largest lag"] = abs(float(ours.min() / theirs.min()) - 1)
    return found


def _lag(tip: Array, θ: Array) -> Array:
    """Tip displacement normal to the undeformed arm at angle θ [m], shape (samples,)."""
    return np.asarray(-np.sin(θ) * tip[:, 0] + np.cos(θ) * tip[:, 1])


def _motion(case: Case, settings: Settings, ours: Trajectory, beside: Trajectory, exact: Array) -> Iterator[Series]:
    curves = {"reference": exact, str(settings.beside): beside.tip[:, :2], str(settings.best): ours.tip[:, :2]}
    seen = {name: _lag(tip, ours.q[:, 0]) if settings.lag else tip[:, 1] for name, tip in curves.items()}
    label = "tip across the arm [m]" if settings.lag else "tip y [m]"
    yield Series("motion", case.title, {"time [s]": ours.t} | seen, "time [s]", "time [s]", label)
    worst = np.abs(seen["reference"]).argmax()
    pair = f"{label} at {ours.t[worst]:g} s", seen["reference"][worst], seen[str(settings.best)][worst]
    yield published([pair], f"{case.title} ({settings.best})")


def _independent(case: Case, settings: Settings, run: Callable[[Rule], Trajectory]) -> Iterator[Measured]:
    """Yield the largest tip distance for each chain of the sweep that the independent program also ran."""
    for rule, runs in look_up(settings.reference, "lumped").items():
        for n, theirs in runs.items():
            at = Rule(rule=rule, hinges=int(n) - 1 if rule == "paper" else int(n))
            if at.hinges in settings.rules.get(rule, ()):
                ours = run(at).tip[:, :2]
                distance = largest_distance(ours, np.array(theirs["tip_xy"]))
                yield Measured("independent program", distance, case.scenes[0], varied=at.facts)


def _parity(scene: Scene, at: Rule) -> Iterator[Measured]:
    ours = fl.simulate(scene)
    facts: Facts = {**at.facts, **run_facts(scene.run)}
    if scene.motion:
        free = fl.lump(scene.varied({"motion": []}))
        value = max(_acceleration_errors(scene, ours, free))
        yield Measured("MuJoCo's accelerations", value, scene.name, "mujoco", facts)
        return
    _, q, _ = engines.load("mujoco", ours.chain).integrate(scene)
    yield Measured("MuJoCo's motion", float(np.abs(q - ours.q).max()), scene.name, "mujoco", facts)


def _acceleration_errors(scene: Scene, run: Trajectory, free: fl.Chain) -> Iterator[float]:
    """Yield |Δq̈| in units of the rounding bound for each sample except the first, which is at rest."""
    motion, engine = motion_arrays(scene, run.chain), engines.load("mujoco", free)
    for t, q, qd, tau in list(zip(run.t, run.q, run.qd, run.tau, strict=True))[1:]:
        wanted, given = fl.forward_dynamics(free, q, qd, tau), np.zeros(free.n)
        follow(motion, t, q.copy(), qd.copy(), given)
        wanted[motion.joints] = given[motion.joints]
        theirs = engine.forward_dynamics(q, qd, tau)
        yield float(in_units(theirs - wanted, of_acceleration(free, q, qd, wanted, tau)).max())
