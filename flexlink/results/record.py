"""Preallocated samples of a running simulation."""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.common.memo import Kept
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics import rounding
from flexlink.dynamics.conserved import Energy
from flexlink.dynamics.floating_base import ANGLES, FAR
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.result import read_only
from flexlink.kernels.stepping.samples import derive, prescribed_torques
from flexlink.kernels.stepping.step_state import SO_FAR
from flexlink.kernels.tools.machine_code import direct
from flexlink.results.samples import BaseMotion, State, StatedError, Steps
from flexlink.results.tip_motion import checked_path, compared_path
from flexlink.results.trajectory import Trajectory

Arrays = tuple[Array, Array, Array]  # angles q, rates q̇ and work W


def trajectory_from_states(problem: InitialValueProblem, t: Array, q: Array, qd: Array) -> Trajectory:
    """Trajectory of a problem from another engine's states; tip, energies and drive torques are computed here."""
    record = Record(problem, t, q.copy(), qd.copy())
    record.derive(0, len(t))
    return record.trajectory(len(t), balanced=False)


class Record:
    """Preallocated samples of a running simulation; samples not yet computed are uninitialised."""

    def __init__(
        self, problem: InitialValueProblem, t: Array, q: Array, qd: Array, others: tuple[Array, ...] | None = None,
        kept: Kept | None = None,
    ) -> None:  # fmt: skip
        self.chain, self.inputs, self.base = problem.chain, problem.inputs, problem.base
        self.kept = Kept() if kept is None else kept  # workspace and machine code, which consecutive runs reuse
        self._derive: Callable[..., None] | None = None
        self.hold(problem, t, q, qd, others)

    def hold(
        self, problem: InitialValueProblem, t: Array, q: Array, qd: Array, others: tuple[Array, ...] | None = None
    ) -> None:
        """Hold the samples of another run of the same problem, from another initial state or with another tolerance."""
        self.problem, self.run, self.t, self.q, self.qd = problem, problem.run, t, q, qd
        # works: integrated, without the work of a constant tip force, which follows from its potential; so_far: step
        # counts and largest deflection up to each sample (samples, SO_FAR.size)
        others = derived(problem, len(t)) if others is None else others
        self.tau, self.tip, self.energy, self.works, self.so_far = others
        every = 3 if self.tied else 0 if self.chain.has_levers else 12
        self._placed = np.empty((len(t), len(self.chain.bodies), every)) if every else None
        self.origin = 0 if self.run.controlled else round(float(t[0]) / self.run.fixed_step)  # fixed steps before t₀
        self._least = 0.0
        if self.base is not None:
            self.base.begin()

    @property
    def tied(self) -> bool:
        """Whether ties close loops of the chain."""
        return self.problem.ties is not None

    @property
    def scratch(self) -> Any:
        """Workspace of the run's solver of forward dynamics."""
        return self.kept("forward dynamics", None, self.problem.workspace)

    def begin(self) -> None:
        """Measure the angles of a floating base from its initial attitude, in the first sample and all steps."""
        if self.base is not None:
            self.base.turn(0, self.q[0], self.qd[0], self.scratch)

    @property
    def far(self) -> float:
        """Rotation of a floating base at which its coordinates change [rad]; inf if the base is fixed."""
        return np.inf if self.base is None else FAR

    def is_far(self, q: Array) -> bool:
        """Whether the base is free and has turned beyond `far` at angles q (n,)."""
        return self.base is not None and bool(np.abs(q[ANGLES]).max() > FAR)

    def advance(
        self, go: Callable[..., Any], fixed: tuple[Any, ...], first: int, stop: int, rest: tuple[int, Arrays, Arrays]
    ) -> int:
        """Integrate to fixed step `stop`; return the number of the last step with a finite state; `go`: `integrate`.

        If a floating base has turned far, its coordinates change, even at step `stop`: later steps do not depend on it.
        """
        every, (q, qd, _), _ = rest
        done = int(go(*fixed, first, stop, self.far, *rest))
        while self.base is not None and (done < stop or self.is_far(q)) and np.isfinite([q, qd]).all():
            self.base.turn(done // every + 1, q, qd, self.scratch)
            done = int(go(*fixed, done, stop, self.far, *rest))
        return done

    def parts(self, first: int, stop: int) -> Iterator[slice]:
        """Samples first … stop − 1, split where the coordinates of a floating base change."""
        return iter([slice(first, stop)]) if self.base is None else self.base.parts(first, stop, self.scratch)

    @property
    def samples(self) -> tuple[Array, ...]:
        """All arrays of the samples."""
        return self.t, self.q, self.qd, self.tau, self.tip, self.energy, self.works, self.so_far

    @property
    def path(self) -> Array:
        """The `checked_path` of the samples: the path of the tip, or of all bodies if rotations move no point."""
        return self.tip if self._placed is None else self._placed

    def compared(self, stop: int) -> Array:
        """The `compared_path` of the samples before `stop`."""
        if self._placed is not None or len(self.chain.tips) == 1:
            return self.path[:stop]
        return np.concatenate([compared_path(self.chain, self.q[part]) for part in self.parts(0, stop)])

    @property
    def least_tolerance(self) -> float:
        """Smallest tolerance [m] that rounding errors allow, for the arm's size and its initial angles."""
        if not self._least:
            # a tolerance must exceed the sum of 200 rounding errors of the tip position, one per step
            self._least = 200.0 * rounding.of_reach(self.chain.size, max(map(abs, self.q[0].tolist())))
        return self._least

    @property
    def follows_vibrations(self) -> bool:
        """Whether steps follow vibrations that do not move the tip, because something that sees them is read."""
        reads = self.run.follows_vibrations(self.problem.scene.sensor)
        return reads and bool((self.chain.hinges["stiffness"] > 0).any())

    def compile(self) -> None:
        """Compile the code that `derive` runs."""
        arguments = self.chain.arrays, self.inputs, 0, 0, *self.samples[:6]
        self._derive = self.kept("derive", None, lambda: direct(derive, *arguments, types=self.kept.types))
        if len(self.inputs.motion.joints):
            self._prescribe(slice(0))

    def derive(self, first: int, stop: int) -> None:
        """Compute tip, energies and drive torques of the samples first … stop − 1."""
        if self._derive is None:
            self.compile()
        for part in self.parts(first, stop):
            self._derive(self.chain.arrays, self.inputs, part.start, part.stop, *self.samples[:6])  # type: ignore[misc]
            if len(self.inputs.motion.joints):
                self._prescribe(part)
            if self._placed is not None:
                self._placed[part] = checked_path(self.chain, self.q[part], every=self.tied)

    def _prescribe(self, rows: slice) -> None:
        t, q, qd, tau = (part[rows] for part in self.samples[:4])
        prescribed_torques(self.scratch, self.inputs, t, q, qd, tau)
        if self.problem.ties is not None:
            from flexlink.dynamics.tied_motion import add_torques_of_ties  # noqa: PLC0415  few scenes have ties

            add_torques_of_ties(self.problem.ties, self.chain, t, q, qd, tau, self.inputs.tip_wrenches(t, q, qd))

    def work(self, rows: slice) -> Array:
        """Work done up to these samples [J]: the integrated work plus f·(p − p(0)) of a constant force f on the tip."""
        force = self.inputs.potential_force
        if not any(force.tolist()):
            return self.works[rows].copy()
        return np.asarray(self.works[rows] + (self.tip[rows] - self.tip[0]) @ force)

    def state(self, row: int) -> State:
        """State of a sample, from which a run can be continued; of a floating base relative to its initial attitude."""
        q, qd = self.q[: row + 1], self.qd[: row + 1]
        if self.base is not None:
            q, qd, *_ = self.base.from_the_start(q, qd)
        return State(float(self.t[row]), q[row].copy(), qd[row].copy())

    def trajectory(
        self, stop: int, warnings: tuple[Diagnostic, ...] = (), steps: Steps | None = None, balanced: bool = True,
        stated: StatedError | None = None, scene: Scene | None = None,
    ) -> Trajectory:  # fmt: skip
        """The samples before `stop`, read-only; this record must not be used afterwards."""
        work = self.work(slice(stop)) if balanced else None
        wrenches = [self.inputs.tip_wrenches(self.t[k], self.q[k], self.qd[k]) for k in self.parts(0, stop)]
        wrench = wrenches[0] if len(wrenches) == 1 else np.concatenate(wrenches)
        q, qd, chain, motion = self.q, self.qd, self.chain, None
        if self.base is not None:
            moved = _kept(q, stop), _kept(qd, stop)
            momentum = functools.partial(self.base.momentum, [*self.base.references], *moved)
            q, qd, attitude, spin = self.base.from_the_start(*moved)
            chain, motion = self.base.original, BaseMotion(attitude, spin, momentum)
        delayed = self.inputs.drive.delayed(float(self.t[stop - 1])) if stop else np.zeros((0, 1))
        for array in (q, qd, self.tau, self.tip, self.energy, wrench, delayed):
            array.setflags(write=False)
        if work is not None:
            work.setflags(write=False)
        t, q, qd, tau, tip = [_kept(a, stop) for a in (self.t, q, qd, self.tau, self.tip)]
        kinetic, gravity, elastic = self.energy[:, :stop]
        return Trajectory.of_read_only(
            chain=chain, t=read_only(t), q=q, qd=qd, drive_torques=tau, tip=tip, work=work, warnings=warnings,
            steps=steps, energy=Energy.of_read_only(kinetic=kinetic, gravity=gravity, elastic=elastic),
            tip_wrench=wrench, scene=scene or self.problem.scene, base=motion, delayed=delayed, stated=stated,
        )  # fmt: skip


def derived(problem: InitialValueProblem, rows: int) -> tuple[Array, ...]:
    """Arrays for what a record derives from the states of a number of samples."""
    n = problem.chain.n
    return np.empty((rows, n)), np.empty((rows, 3)), np.empty((3, rows)), np.zeros(rows), noted(problem, rows)


def noted(problem: InitialValueProblem, rows: int) -> Array:
    """Initial step counts of a run (rows, SO_FAR.size); for fixed explicit steps they are known in advance."""
    so_far = np.zeros((rows, SO_FAR.size))
    if problem.explicit:
        so_far[:, SO_FAR.steps] = problem.run.steps_per_sample * np.arange(rows)
    return so_far


def _kept(array: Array, stop: int) -> Array:
    """The first `stop` rows, copied if there are more, so that the memory of the others is freed."""
    return array if stop == len(array) else read_only(array[:stop].copy())
