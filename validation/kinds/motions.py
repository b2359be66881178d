"""Motions against references: published ones, 18 digits, Exudyn, other solvers."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Literal

import numpy as np

import flexlink as fl
from flexlink import engines
from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import MissingDependencyError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.dynamics.rounding import in_units, of_acceleration
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.motion.inputs.actuation import motion_arrays
from flexlink.motion.simulate import simulate
from flexlink.results.tip_motion import largest_distance
from flexlink.results.trajectory import Trajectory
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.physics.beam_references import beam_reference, beam_scene, file_name, plane_of
from validation.physics.formulas import INPUTS
from validation.physics.hinge_sweep import Point, Sweep, published, report
from validation.physics.variant import Rule, Variant, existing
from validation.reference_values import look_up, reference_array
from validation.runs import motion_in_mujoco, run_facts, stable_steps
from validation.store import Series
from validation.trade.first_order import FirstOrder
from validation.trade.scenes import trade_scene


class MotionBenchmarkSettings(Sweep, frozen=True, kw_only=True):
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


def error_at(case: Case, settings: MotionBenchmarkSettings, at: Rule) -> float:
    """Tip error [m], for a data sheet."""
    return _errors(settings, fl.simulate(_scene(case, settings, at)), _exact(settings))["tip"]


def mujoco_error_at(case: Case, settings: MotionBenchmarkSettings, at: Rule) -> float:
    """Tip error [m] by MuJoCo's accelerations, from the exported file; ArgumentError if a joint is prescribed."""
    scene = _scene(case, settings, at)
    chain = fl.lump(scene)
    _, q, _ = engines.load("mujoco", chain).integrate(scene)
    tip = np.array([fl.tip_position(chain, row)[:2] for row in q])
    return largest_distance(tip, _exact(settings))


@kind(long=True, sheet={"native": error_at, "mujoco": mujoco_error_at})
def motion_benchmark(case: Case, settings: MotionBenchmarkSettings) -> Iterator[Measured | Series]:
    """Motions of flexible arms against continuous references: tip error by rule and hinges; the same run in MuJoCo.

    MuJoCo has no prescribed joints. Instead, flexlink's torque is applied there at sampled states of the run and must
    reproduce flexlink's accelerations, including the prescribed one.

    The reference files also contain runs of the same chains by an independent program in absolute angles, which must
    agree.

    Yield the sweep, the best chain with its time integration error, and MuJoCo's results.
    """
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
    yield _parity(_scene(case, settings, settings.parity), settings.parity)


def _exact(settings: MotionBenchmarkSettings) -> Array:
    """Tip of the reference, x and y (samples, 2) [m]."""
    return reference_array(settings.reference, "values")[:, list(settings.columns)]


def _scene(case: Case, settings: MotionBenchmarkSettings, at: Rule) -> Scene:
    """The scene with its input and a step that divides the time between samples."""
    with_input = require_one_of(f"{case.path}: settings.input", settings.input, INPUTS)
    scene = with_input(Variant().build(case, at))
    steps = stable_steps(scene, scene.run.method, settings.of_stable)
    return scene.varied({"run.step": scene.run.spacing / steps})


def _errors(settings: MotionBenchmarkSettings, run: Trajectory, exact: Array) -> dict[str, float]:
    found = {"tip": largest_distance(run.tip[:, :2], exact)}
    if settings.lag:
        θ = run.q[:, 0]
        ours, theirs = _lag(run.tip[:, :2], θ), _lag(exact, θ)
        found["largest lag"] = abs(float(ours.min() / theirs.min()) - 1)
    return found


def _lag(tip: Array, θ: Array) -> Array:
    """Tip displacement normal to the undeformed arm at angle θ [m], shape (samples,)."""
    return np.asarray(-np.sin(θ) * tip[:, 0] + np.cos(θ) * tip[:, 1])


def _motion(
    case: Case, settings: MotionBenchmarkSettings, ours: Trajectory, beside: Trajectory, exact: Array
) -> Iterator[Series]:
    curves = {"reference": exact, str(settings.beside): beside.tip[:, :2], str(settings.best): ours.tip[:, :2]}
    seen = {name: _lag(tip, ours.q[:, 0]) if settings.lag else tip[:, 1] for name, tip in curves.items()}
    label = "tip across the arm [m]" if settings.lag else "tip y [m]"
    yield Series("motion", case.title, {"time [s]": ours.t} | seen, "time [s]", "time [s]", label)
    worst = np.abs(seen["reference"]).argmax()
    pair = f"{label} at {ours.t[worst]:g} s", seen["reference"][worst], seen[str(settings.best)][worst]
    yield published([pair], f"{case.title} ({settings.best})")


def _independent(
    case: Case, settings: MotionBenchmarkSettings, run: Callable[[Rule], Trajectory]
) -> Iterator[Measured]:
    """Yield the largest tip distance for each chain of the sweep that the independent program also ran."""
    for rule, runs in look_up(settings.reference, "lumped").items():
        for n, theirs in runs.items():
            at = Rule(rule=rule, hinges=int(n) - 1 if rule == "paper" else int(n))
            if at.hinges in settings.rules.get(rule, ()):
                ours = run(at).tip[:, :2]
                distance = largest_distance(ours, np.array(theirs["tip_xy"]))
                yield Measured("independent program", distance, case.scenes[0], varied=at.facts)


def _parity(scene: Scene, at: Rule) -> Measured:
    if not scene.motion:
        return motion_in_mujoco(scene, facts=at.facts)
    free = fl.lump(scene.varied({"motion": []}))
    value = max(_acceleration_errors(scene, fl.simulate(scene), free))
    return Measured("MuJoCo's accelerations", value, scene.name, "mujoco", {**at.facts, **run_facts(scene.run)})


def _acceleration_errors(scene: Scene, run: Trajectory, free: fl.Chain) -> Iterator[float]:
    """Yield |Δq̈| in units of the rounding bound for each sample except the first, which is at rest."""
    motion, engine = motion_arrays(scene, run.chain), engines.load("mujoco", free)
    for t, q, qd, tau in list(zip(run.t, run.q, run.qd, run.tau, strict=True))[1:]:
        wanted, given = fl.forward_dynamics(free, q, qd, tau), np.zeros(free.n)
        follow(motion, t, q.copy(), qd.copy(), given)
        wanted[motion.joints] = given[motion.joints]
        theirs = engine.forward_dynamics(q, qd, tau)
        yield float(in_units(theirs - wanted, of_acceleration(free, q, qd, wanted, tau)).max())


class Trial(Spec, frozen=True):
    """A run, its reference file, and the step [s] of RK4 for the comparison with MuJoCo."""

    reference: str
    variant: Variant
    rk4_step: Positive


@kind
def exact_motion(case: Case, run: tuple[Trial, ...], chain: Rule) -> Iterator[Measured | Series]:
    """Rigid pendulums and the paper's link against trajectories known to at least 18 digits; the same runs in MuJoCo.

    With RK10 only rounding error remains. MuJoCo has no such method and is compared with flexlink's RK4 at the same
    step.

    Yield tip errors, changes of the tip with half the step, and differences from MuJoCo; `chain` lumps the links.
    """
    for trial in run:
        scene = trial.variant.build(case, chain)
        name = trial.variant.name or scene.name
        times, exact = _rows_of(trial)
        ours, half = fl.simulate(scene), fl.simulate(scene, step=scene.run.fixed_step / 2)
        rows = np.searchsorted(ours.t, times - 1e-9)  # rows at the reference times; k·step is rounded
        error = np.linalg.norm(ours.tip[rows, :2] - exact, axis=1)
        yield Measured("tip error", float(error.max()), name, varied=run_facts(scene.run))
        change = float(np.abs(half.tip - ours.tip).max())
        yield Measured("time integration error", change, name, varied=run_facts(scene.run))
        yield motion_in_mujoco(scene.varied({"run.method": "RK4", "run.step": trial.rk4_step}), name)


def _rows_of(trial: Trial) -> tuple[Array, Array]:
    """Times (m,) and tip positions (m, 2)."""
    found = look_up(trial.reference, *trial.variant.keys)
    rows = found["rows"] if "rows" in found else [(entry["t"], entry["tip_x"], entry["tip_y"]) for entry in found]
    table = np.array(rows, dtype=np.float64)
    return table[:, 0], table[:, 1:]


@kind(long=True)
def exact_beams(
    case: Case, coarse: Rule, fine: Rule, of_stable: Positive = 0.5, others: dict[str, str] | None = None
) -> Iterator[Measured | Series]:
    """Motions of chains against geometrically exact beams in Exudyn, and Exudyn's beams against other references.

    The chain is lumped with two resolutions. The distance between the two tips bounds the error of the coarser chain
    and, generously, of the finer one, which is compared with the reference. The error of the reference (own error) is
    estimated from its mesh, step, stiffnesses and residual:

        distance to the reference / (own error + |coarse − fine|) ≤ 1

    Yield tip distances, absolute and in units of the allowed error.

    `coarse` and `fine` lump the chain, `of_stable` is the step as a fraction of the largest stable one, and `others`
    names a second reference for some scenes.
    """
    for name in case.scenes:
        scene, (exact, own) = beam_scene(name), beam_reference(name)
        tip, coarser = (_tip(scene, cut, of_stable) for cut in (fine, coarse))
        distance, between = largest_distance(tip, exact), largest_distance(coarser, tip)
        yield Measured("tip apart", distance, name, varied=fine.facts)
        yield Measured("tip apart / allowed", distance / (own + between), name, varied=fine.facts)
        yield Measured("coarser chain apart", between, name, varied=coarse.facts)
        yield Measured("reference, its own error", own, name, "exudyn")
        if others and name in others:
            other = reference_array(others[name], "values")
            plane = exact @ plane_of(scene).axes
            yield Measured("references apart / own error", largest_distance(plane[:, :2], other) / own, name, "exudyn")
        if "shear_and_stretch_m" in look_up(file_name(name)):
            yield Measured("shear and stretch", float(look_up(file_name(name), "shear_and_stretch_m")), name, "exudyn")
        yield _series(scene, exact, tip)


def _tip(scene: Scene, cut: Rule, of_stable: float) -> Array:
    """Tip of the chain, with a step that divides the time between samples."""
    scene = scene.varied({"link.*.lumping": cut.rule, "link.*.segments": cut.hinges + 1})
    return fl.simulate(scene, step=scene.run.spacing / stable_steps(scene, scene.run.method, of_stable)).tip


def _series(scene: Scene, exact: Array, fine: Array) -> Series:
    columns = {"time [s]": scene.run.times, "flexlink": np.linalg.norm(fine - exact, axis=1)}
    title = f"{scene.name}: distance of the chain's tip from that of Exudyn's beams"
    return Series("beams", title, columns, "time [s]", "time [s]", "distance [m]", scene=scene.name)


ALLOWED_TOLERANCES = 10.0  # largest accepted final error in units of the tolerance


class Witness(Spec, frozen=True):
    """An independent solver and its two relative tolerances, the coarser first."""

    solver: Literal["Radau", "BDF", "LSODA", "DOP853", "CVODE"]
    relative: tuple[Positive, Positive]
    needed: bool = True  # if False and not installed, the solver is skipped and reported


@kind(long=True)
def other_solvers(
    case: Case, scene: dict[str, tuple[Witness, ...]], methods: dict[str, Positive]
) -> Iterator[Measured]:
    """Complete motions by solvers that share no code with flexlink's integrators: SciPy's, and CVODE if installed.

    The independent solver runs twice. The distance between the tips of both runs bounds the error of the coarser one
    and, generously, of the finer one, which is compared. A run of flexlink may have an error of ten times its
    tolerance, the project's limit for the final error, and the other solver may have an error equal to that distance:

        distance of flexlink's tip / (10 tolerance + |coarse − fine|) ≤ 1

    Yield tip distances in units of the allowed error, and the error estimate of each solver.

    `scene` lists independent solvers by scene of the trade study, `methods` flexlink's methods with tolerances [m].
    """
    left_out = ""
    for name, witnesses in scene.items():
        trade = trade_scene(name)
        ours = {method: simulate(trade, method=method, tolerance=ε).tip for method, ε in methods.items()}
        form = FirstOrder(trade)
        for witness in witnesses:
            try:
                coarse, fine = (form.by(witness.solver, relative).tip for relative in witness.relative)
            except MissingDependencyError as error:
                if witness.needed:
                    raise
                left_out = str(error)
                continue
            own = largest_distance(coarse, fine)
            yield Measured("witness, its two runs apart", own, name, witness.solver)
            for method, tip in ours.items():
                allowed = ALLOWED_TOLERANCES * methods[method] + own
                facts: Facts = {"method": method, "tolerance": methods[method]}
                yield Measured(
                    "tip apart / allowed", largest_distance(tip, fine) / allowed, name, witness.solver, facts
                )
    yield Measured("witnesses left out", float(bool(left_out)), note=left_out)
