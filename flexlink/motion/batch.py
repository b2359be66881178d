"""simulate_many(scenes): members of one layout side by side, eight in one pass of the compiled loop.

Those with a tolerance run one by one: the lengths of their steps, and so the matrices that they factor, are their own;
a step that one of eight refuses would hold up seven; and all their steps are but 15 to 30 % of what they cost, measured
with ten joints, Radau5, 1e-4 m, 0.1 to 1 s.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from flexlink.chain.arguments import integer, require_each
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import lanes_workspace, solver_for
from flexlink.inputs.drives import same_law
from flexlink.inputs.problem import problem_of
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.budget import warn
from flexlink.motion.fixed_steps import pieces, steps_up_to
from flexlink.motion.monitor import RunMonitor
from flexlink.motion.simulate import SingleRun, allocate, verify
from flexlink.motion.step_errors import step_errors_side_by_side
from flexlink.results.samples import Steps
from flexlink.results.stop_reasons import DivergenceError, InterruptedRunError
from flexlink.results.trajectory import Trajectory

Ended = Trajectory | DivergenceError | InterruptedRunError
Outcome = Ended | FlexlinkError


def simulate_many(scenes: Sequence[Scene], *, threads: int = 1) -> list[Trajectory]:
    """Simulate many scenes; neighbours in the list that are alike run eight side by side.

    Alike are scenes that differ in initial state, dimensions, materials and gravity only: same layout of bodies and
    hinges, same drive, motion, wrench, constant in frame 0, and run settings, with dynamics "articulated", and with a
    drive that neither is sampled nor knows the rigid arm. Others run one by one. The numbers are those of single runs,
    and so are the judgements.

    Parameters
    ----------
    scenes
        The scenes.
    threads
        Number of threads that share the work.

    Returns
    -------
    list of Trajectory
        In the order of the scenes.

    Raises
    ------
    ArgumentError
        `scenes` holds something that is no Scene, or `threads` is no whole number of at least 1.
    UnstableStepError
        The step of a member is larger than its largest stable one; unstable = "allow" insists.
    DivergenceError
        A member diverged, as in `simulate`; the error's `runs` holds all runs, that member's up to there.
    InterruptedRunError
        Ctrl-C or SIGTERM; its `runs` holds all runs as far as they went.
    """
    scenes, threads = require_each("scenes", scenes, Scene), integer("threads", threads, 1)
    with deferred() as stop:
        members = [allocate(problem_of(scene)) for scene in scenes]
        with ThreadPoolExecutor(threads) as pool:
            blocks = pool.map(lambda block: _simulate_block(block, stop), list(_blocks(members)))
            ends = [outcome for block in blocks for outcome in block]
        runs = [outcome if isinstance(outcome, Trajectory) else outcome.trajectory for outcome in ends]
        for kind in (InterruptedRunError, DivergenceError):
            for outcome in ends:
                if isinstance(outcome, kind):
                    outcome.runs = runs
                    raise outcome
    return runs


def outcomes(scenes: Sequence[Scene], stop: Stop) -> list[Outcome]:
    """What becomes of every scene, of those that are refused, too; neighbours that are alike run side by side.

    The numbers of one do not depend on which others there are, to the bit.
    """
    members: list[RunMonitor] = []
    found: dict[int, Outcome] = {}
    for k, scene in enumerate(scenes):
        try:
            members.append(allocate(problem_of(scene)))
        except FlexlinkError as error:
            found[k] = error
    ends = (outcome for block in _blocks(members) for outcome in _simulate_block(block, stop))
    return [found[k] if k in found else next(ends) for k in range(len(scenes))]


def _alone(member: RunMonitor, stop: Stop) -> Ended:
    try:
        return SingleRun(member).finish(stop, warn=warn)
    except (DivergenceError, InterruptedRunError) as error:
        return error


def _blocks(members: Iterable[RunMonitor]) -> Iterator[list[RunMonitor]]:
    block: list[RunMonitor] = []
    for member in members:
        if block and (len(block) == LANES or not _alike(block[0], member)):
            yield block
            block = []
        block.append(member)
    if block:
        yield block


def _alike(a: RunMonitor, b: RunMonitor) -> bool:
    one, other = a.record.problem, b.record.problem
    if one.start != other.start:  # one clock for all
        return False
    if one.scene.wrench.varies:  # where each tip is, only its own chain tells
        return False
    same = all(getattr(one.scene, name) == getattr(other.scene, name) for name in ("run", "motion", "wrench"))
    return same and one.chain.same_layout(other.chain) and same_law(one.inputs.drive, other.inputs.drive)


def _simulate_block(block: Sequence[RunMonitor], stop: Stop) -> Sequence[Ended]:
    """Also one alone goes in lanes: its numbers are those that it has beside any others."""
    problem = block[0].record.problem
    run, chain, drive = problem.run, problem.chain, problem.inputs.drive
    solver = solver_for(chain, run.solver)
    alone = not problem.explicit or problem.scene.wrench.varies or not same_law(drive, drive)
    if solver.lanes_workspace is None or alone:
        return [_alone(member, stop) for member in block]
    eight = [block[min(lane, len(block) - 1)] for lane in range(LANES)]
    records = [member.record for member in eight]
    q, qd = np.zeros((2, run.samples, chain.n, LANES))
    samples = q, qd, np.zeros((run.samples, LANES))
    for lane, record in enumerate(records):
        q[0, :, lane], qd[0, :, lane] = record.q[0], record.qd[0]
    state = q[0].copy(), qd[0].copy(), np.zeros((1, LANES))
    work = lanes_workspace(solver, [record.chain for record in records])
    done = 0
    for done in pieces(block[0], work, state, samples):  # noqa: B007  where it ended
        if stop.asked:
            break
    if not np.isfinite(state[:2]).all():  # one of them diverges; it says so itself
        if len(block) == 1:
            return [_alone(block[0], stop)]
        return [ended for member in block for ended in _simulate_block([member], stop)]
    rows, steps = done // run.steps_per_sample + 1, steps_up_to(run, done)
    probed = block[0].probed(slice(0, rows))
    errors = step_errors_side_by_side(records, work, samples[:2], probed)
    records = records[: len(block)]
    for lane, record in enumerate(records):
        for array, of_all in zip((record.q, record.qd, record.works), samples, strict=True):
            array[:rows] = of_all[:rows, ..., lane]
    return [_judged(member, stop, rows, steps, errors[lane]) for lane, member in enumerate(block)]


def _judged(monitor: RunMonitor, stop: Stop, rows: int, steps: Steps, errors: Array) -> Ended:
    """What became of a member with so many samples, and the errors of steps between them."""
    if not monitor.check(rows, steps, errors):
        return monitor.diverged()
    if not stop.asked:
        monitor.warnings += verify(monitor, steps.method, stop)
    if stop.signal is not None:
        return InterruptedRunError(monitor.trajectory(), stop.signal)
    return monitor.trajectory()
