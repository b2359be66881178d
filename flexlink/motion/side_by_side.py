"""Up to eight runs of one layout, the leading axis, in one pass of the compiled loop; a `Monitor` checks each."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import Diagnostic
from flexlink.common.interruption import Stop
from flexlink.common.memo import Kept
from flexlink.common.types import Array, Mask
from flexlink.describe.numbers import multiples
from flexlink.dynamics.accelerations import lanes_workspace, solver_for
from flexlink.dynamics.conserved import Energy
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.placement import unbent
from flexlink.kernels.geometry.kinematics import tip_points
from flexlink.kernels.tools.lanes import LANES
from flexlink.motion.fixed_steps import FixedSteps, steps_up_to
from flexlink.motion.inputs.drives import same_law, side_by_side
from flexlink.motion.monitor import Monitor, rounded_away, step_errors_side_by_side, summed
from flexlink.motion.single_run import verify
from flexlink.motion.tolerable import Thresholds, probed
from flexlink.results import balance
from flexlink.results.record import Record, noted
from flexlink.results.samples import Steps
from flexlink.results.stop_reasons import DivergenceError, InterruptedRunError, ended_early
from flexlink.results.trajectory import Trajectory

Ended = Trajectory | DivergenceError | InterruptedRunError


class Member(NamedTuple):
    """A problem whose step has been checked."""

    problem: InitialValueProblem
    warnings: tuple[Diagnostic, ...]
    along: bool  # whether it may run side by side with others
    compared: bool = True  # whether a verification run follows if the steps require one


def fits_lanes(problem: InitialValueProblem) -> bool:
    """Whether the compiled loop can run a problem in lanes, with others or alone."""
    solver = solver_for(problem.chain, problem.run.solver)
    alone = not problem.explicit or problem.inputs.changing is not None or bool(problem.chain.forces)
    return solver.lanes_workspace is not None and not alone and problem.base is None and problem.chain.has_levers


def alike(one: InitialValueProblem, other: InitialValueProblem) -> bool:
    """Whether two problems that fit lanes can run side by side."""
    if one.start != other.start:  # all members share the times of their steps
        return False
    a, b = one.scene, other.scene
    if not all(x is y or x == y for x, y in ((a.run, b.run), (a.motion, b.motion), (a.wrench, b.wrench))):
        return False
    return one.chain.same_layout(other.chain) and same_law(one.inputs.drive, other.inputs.drive)


def in_lanes(rows: Array) -> Array:
    """Rows (b, p) of up to eight arms side by side, (p, 8); the last row is repeated to fill all lanes."""
    return np.ascontiguousarray(rows[np.minimum(np.arange(LANES), len(rows) - 1)].T)


class Samples(NamedTuple):
    """The fields of `RunSamples` for several runs, which are the last axis of each array."""

    chain: Chain  # chain of the first run
    t: Array
    q: Array
    qd: Array
    tau: Array
    tip: Array
    energy: Energy
    work: Array
    imbalance: Array


class Block:
    """Up to eight similar members; `integrate` computes their samples."""

    lanes = LANES  # most members

    def __init__(self, members: Sequence[Member], kept: Kept) -> None:
        problem = members[0].problem
        self.members, self.run, self.chain = members, problem.run, problem.chain
        b, rows, n = len(members), self.run.samples, problem.chain.n
        self.t = multiples(problem.start, self.run.between, rows)
        self.q, self.qd = np.empty((2, b, rows, n))
        self.tau, self.tip = np.empty((b, rows, n)), np.empty((b, rows, 3))
        self.energy, self.works = np.empty((b, 3, rows)), np.zeros((b, rows))
        shared = None if problem.inputs.motion.joints.size else kept  # prescribed joints need a workspace per chain
        each = zip(self.q, self.qd, self.tau, self.tip, self.energy, self.works, strict=True)
        steps = noted(problem, rows)
        self.records = [
            Record(member.problem, self.t, q, qd, (*others, steps), shared)
            for member, (q, qd, *others) in zip(members, each, strict=True)
        ]
        self.monitors = [Monitor(*each) for each in zip(self.records, (m.warnings for m in members), strict=True)]
        self.rows, self.steps = 0, Steps(self.run.method, 0, 0)
        self.errors = np.zeros((b, 0))

    def integrate(self, stop: Stop) -> bool:
        """Integrate to the end or until `stop`; return False if a state is not finite; this stops all members."""
        run, n, b = self.run, self.chain.n, len(self.members)
        for k, member in enumerate(self.members):
            self.q[k, 0], self.qd[k, 0] = member.problem.q, member.problem.qd
        q, qd = np.zeros((2, run.samples, n, LANES))
        samples = q, qd, np.zeros((run.samples, LANES))
        q[0], qd[0] = in_lanes(self.q[:, 0]), in_lanes(self.qd[:, 0])
        state = q[0].copy(), qd[0].copy(), np.zeros((1, LANES))
        work = lanes_workspace(solver_for(self.chain, run.solver), [record.chain for record in self.records])
        drive = side_by_side([record.inputs.drive for record in self.records])
        inputs = self.records[0].inputs._replace(drive=drive)
        steps = FixedSteps(self.records[0], lanes=(work, inputs, state, samples))
        for self.rows, _ in steps:
            if stop.requested:
                break
        self.steps = steps.steps
        if not stop.requested and ended_early(float(self.t[self.rows - 1]), float(self.t[-1])):
            return False
        for k, record in enumerate(self.records):
            record.inputs.drive.held[...] = drive.held[..., k]
            record.inputs.drive.next_instant[:] = drive.next_instant
        rows = probed(run, slice(0, self.rows))
        self.errors = step_errors_side_by_side(self.records, work, inputs, samples[:2], rows)
        for own, of_all in ((self.q, q), (self.qd, qd), (self.works, samples[2])):
            own[:, : self.rows] = np.moveaxis(of_all[: self.rows, ..., :b], -1, 0)
        return True

    def ends(self, stop: Stop) -> "list[Run | Ended]":
        """Outcome of every member."""
        for monitor, errors in zip(self.monitors, self.errors, strict=True):
            monitor.check(self.rows, self.steps, errors)
        calm = self._calm().tolist()
        return [Run(self, k) if calm[k] and not stop.requested else self._ended(k, stop) for k in range(len(calm))]

    @functools.cached_property
    def samples(self) -> Samples:
        """Samples of all members, in the form from which columns are computed."""
        q, qd, tau, tip = (np.moveaxis(part[:, : self.rows], 0, -1) for part in (self.q, self.qd, self.tau, self.tip))
        energy, work = self.energy[:, :, : self.rows], self.works[:, : self.rows].copy()
        for k, record in enumerate(self.records):
            if record.inputs.potential_force.any():
                work[k] = record.work(slice(self.rows))
        left = balance.imbalance(energy, work, energy[:, :, 0])
        parts = Energy(*np.moveaxis(energy, 0, -1))
        return Samples(self.chain, self.t[: self.rows], q, qd, tau, tip, parts, work.T, left.T)

    @functools.cached_property
    def deflections(self) -> Array:
        """Deflection of the tip due to the springs, (members, samples) [m]."""
        unmoved, tips = np.empty_like(self.tip[:, : self.rows]), self.tip[:, : self.rows]
        for k, record in enumerate(self.records):
            tip_points(record.chain.arrays, unbent(record.chain, self.q[k, : self.rows]), unmoved[k])
        return np.asarray(np.linalg.norm(tips - unmoved, axis=2))

    def trajectory(self, k: int) -> Trajectory:
        """The run of a member that passed all checks."""
        return self.records[k].trajectory(self.rows, tuple(self.monitors[k].warnings), self.steps)

    def _ended(self, k: int, stop: Stop) -> Ended:
        """Outcome of a member that failed, may be doubtful, or needs a verification run."""
        monitor = self.monitors[k]
        if monitor.failure:
            monitor.steps = steps_up_to(self.run, monitor.n_valid * self.run.steps_per_sample)
            return monitor.diverged()
        if self.members[k].compared and not stop.requested:
            monitor.warnings += verify(monitor, stop)
        if stop.signal is not None:
            return InterruptedRunError(monitor.trajectory(), stop.signal)
        return monitor.trajectory()

    def _calm(self) -> Mask:
        """Whether each member is certainly valid, and needs no warning and no verification run."""
        # fraction of a limit above which a member is checked individually, since results computed side by side may
        # differ in the last digits
        nearly = 0.9
        calm = [not (m.failure or m.suspicious or m.travelled > Thresholds.far_turned) for m in self.monitors]
        q, qd, tip = (part[:, : self.rows] for part in (self.q, self.qd, self.tip))
        sizes = np.array([record.chain.size for record in self.records])
        off = np.maximum(summed(self.run, self.errors, sizes), rounded_away(self.run, q, qd, sizes))
        extent = np.linalg.norm(np.ptp(tip, axis=1), axis=1)
        small: Mask = off <= nearly * Thresholds.doubt * Thresholds.tip_share * extent
        return np.array(calm, bool) & small


class Run(NamedTuple):
    """A member of a block that passed all checks."""

    block: Block
    place: int

    def trajectory(self) -> Trajectory:
        """The run as a trajectory."""
        return self.block.trajectory(self.place)
