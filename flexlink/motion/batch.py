"""simulate_many(scenes): members of one layout side by side, eight in one pass of the compiled loop."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from flexlink.chain.arguments import integer, require_each
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import Stop, deferred
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import lanes_workspace, solver_for
from flexlink.inputs.drives import same_law
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
        members = list(map(_Preparing(), scenes))
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
    ready, members = _Preparing(), []
    found: dict[int, Outcome] = {}
    for k, scene in enumerate(scenes):
        try:
            members.append(ready(scene))
        except FlexlinkError as error:
            found[k] = error
    ends = (outcome for block in _blocks(members) for outcome in _simulate_block(block, stop))
    return [found[k] if k in found else next(ends) for k in range(len(scenes))]


class Member(NamedTuple):
    """A scene that is ready to run."""

    scene: Scene
    monitor: RunMonitor

    @property
    def chain(self) -> Chain:
        """What moves."""
        return self.monitor.record.chain

    def run(self, stop: Stop) -> Ended:
        """Alone."""
        try:
            return SingleRun(self.scene, self.monitor).finish(stop, warn=warn)
        except (DivergenceError, InterruptedRunError) as error:
            return error


class _Preparing:
    """Makes scenes ready to run; neighbours that differ in nothing a chain is made of share one."""

    def __init__(self) -> None:
        self.made_of: tuple[object, ...] = ()

    def __call__(self, scene: Scene) -> Member:
        locked = [a for a, link in zip(scene.initial.joint_deg, scene.arm.links, strict=True) if link.joint.locked]
        parts = (scene.name, scene.arm, scene.gravity, locked, [motion.link for motion in scene.motion])
        if parts != self.made_of:
            self.chain, self.made_of = lump(scene), parts
        return Member(scene, allocate(scene, self.chain))


def _blocks(members: Iterable[Member]) -> Iterator[list[Member]]:
    block: list[Member] = []
    for member in members:
        if block and (len(block) == LANES or not _alike(block[0], member)):
            yield block
            block = []
        block.append(member)
    if block:
        yield block


def _alike(a: Member, b: Member) -> bool:
    shared = ("run", "motion", "wrench")
    if a.scene.initial.time != b.scene.initial.time:  # one clock for all
        return False
    if a.scene.drive.reference is not None and a.scene.initial != b.scene.initial:  # each begins where its joints are
        return False
    if a.scene.wrench.varies:  # where each tip is, only its own chain tells
        return False
    same = all(getattr(a.scene, name) == getattr(b.scene, name) for name in shared)
    return same and a.chain.same_layout(b.chain) and same_law(*(m.monitor.record.inputs.drive for m in (a, b)))


def _simulate_block(block: Sequence[Member], stop: Stop) -> Sequence[Ended]:
    """Also one alone goes in lanes: its numbers are those that it has beside any others."""
    run, chain = block[0].scene.run, block[0].chain
    solver = solver_for(chain, run.solver)
    drive = block[0].monitor.record.inputs.drive
    alone = not block[0].monitor.explicit or block[0].scene.wrench.varies or not same_law(drive, drive)
    if solver.lanes_workspace is None or alone:
        return [member.run(stop) for member in block]
    eight = [block[min(lane, len(block) - 1)] for lane in range(LANES)]
    chains = [member.chain for member in eight]
    q, qd = np.zeros((2, run.samples, chain.n, LANES))
    samples = q, qd, np.zeros((run.samples, LANES))
    for lane, member in enumerate(eight):
        q[0, :, lane], qd[0, :, lane] = member.monitor.record.q[0], member.monitor.record.qd[0]
    state = q[0].copy(), qd[0].copy(), np.zeros((1, LANES))
    work = lanes_workspace(solver, chains)
    done = 0
    for done in pieces(block[0].monitor, work, state, samples):  # noqa: B007  where it ended
        if stop.asked:
            break
    if not np.isfinite(state[:2]).all():  # one of them diverges; it says so itself
        if len(block) == 1:
            return [block[0].run(stop)]
        return [ended for member in block for ended in _simulate_block([member], stop)]
    rows = done // run.steps_per_sample + 1
    monitors = [member.monitor for member in eight]
    records = [monitor.record for monitor in monitors]
    errors = step_errors_side_by_side(records, work, samples[:2], monitors[0].probed(slice(0, rows)))
    return [
        _outcome(member, stop, steps_up_to(run, done), errors[lane], *(array[:rows, ..., lane] for array in samples))
        for lane, member in enumerate(block)
    ]


def _outcome(member: Member, stop: Stop, steps: Steps, errors: Array, q: Array, qd: Array, works: Array) -> Ended:
    """What became of a member, whose first samples are given, and the errors of steps between them."""
    monitor, rows = member.monitor, len(works)
    record = monitor.record
    record.q[:rows], record.qd[:rows], record.works[:rows] = q, qd, works
    if not monitor.check(rows, steps, errors):
        return monitor.diverged()
    if rows < len(record.t):
        return InterruptedRunError(monitor.trajectory(), stop.signal or signal.SIGINT)
    monitor.warnings += verify(member.scene, monitor, steps.method, stop)
    if stop.asked:
        return InterruptedRunError(monitor.trajectory(), stop.signal or signal.SIGINT)
    return monitor.trajectory()
