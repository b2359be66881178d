"""SimulatorBatch: many similar arms that the caller advances together, eight in one pass of the compiled loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Never

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import integer, positive, real_array, refuse_call, require_each
from flexlink.common.errors import ArgumentError, FlexlinkError, or_raise
from flexlink.common.memo import Kept
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.numbers import whole
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.accelerations import lanes_workspace, solver_for
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate
from flexlink.kernels.tools.lanes import LANES
from flexlink.kernels.tools.machine_code import direct
from flexlink.motion.batch import prepared
from flexlink.motion.fixed_steps import steps_up_to
from flexlink.motion.inputs.actuation import drive_for
from flexlink.motion.inputs.drives import effort_of, pushed, remembered, side_by_side
from flexlink.motion.inputs.problem import started, started_from
from flexlink.motion.inputs.step_check import check_steps
from flexlink.motion.monitor import Monitor
from flexlink.motion.side_by_side import Block, Member, alike, in_lanes
from flexlink.motion.simulator import OFTEN, Simulator
from flexlink.results.record import trajectory_from_states
from flexlink.results.samples import State
from flexlink.results.stop_reasons import DivergenceError


class SimulatorBatch:
    """N similar arms that the caller advances together: `Simulator` for many arms, such as for learning agents.

    States are identical, bit for bit, to those of a `Simulator` of each scene. As there, the stability of the steps is
    checked at `reset`, finite numbers at every call, and the power balance at some calls.

    Parameters
    ----------
    scenes
        Scenes that differ only in initial state, dimensions, materials and gravity, as in `simulate_many`, with fixed
        steps of an explicit method (`run.step`).
    threads
        Number of threads that share the arms.

    Attributes
    ----------
    chains
        The chain of each arm.

    Raises
    ------
    ArgumentError
        `scenes` is empty or contains an item that is not a Scene, or the arms cannot be advanced side by side.
    SceneError, UnstableStepError
        As in `simulate`.

    Examples
    --------
    >>> free = scene.varied({"drive": None, "run.step": 1e-4})
    >>> arms = fl.SimulatorBatch([free.varied({"tip.mass": mass}) for mass in (1.0, 2.0, 3.0)])
    >>> after = arms.step([[30.0, 10.0]] * 3, duration=0.01)  # N m on the driven joints of each arm
    >>> print(after.t, after.q.shape)
    0.01 (3, 6)
    """

    def __init__(self, scenes: Sequence[Scene], *, threads: int = 1) -> None:
        scenes, threads = require_each("scenes", scenes, Scene), integer("threads", threads, 1)
        if not scenes:
            raise ArgumentError("scenes: empty; expected at least one scene", id="empty")
        spacing = scenes[0].run.spacing
        # a `Record` needs at least one sample
        longer = [each if each.run.duration else each.varied({"run.duration": spacing}) for each in scenes]
        members = [_similar(k, each) for k, each in enumerate(prepared(longer))]
        for k, member in enumerate(members):
            if not alike(members[0].problem, member.problem):
                parts = "layout, drive (or its feedforward torques), motion, wrench or run"
                remedy = "if you give the torques, leave the drive out: scene.varied({'drive': None})"
                raise ArgumentError(f"scenes[{k}]: differs from scenes[0] in {parts}; {remedy}", id="not-similar")
        self._run, self._threads = members[0].problem.run, threads
        self._blocks = [_Eight(members[k : k + LANES]) for k in range(0, len(members), LANES)]
        self.chains = tuple(member.problem.chain for member in members)
        self._effort = np.array([effort_of(member.problem.scene, member.problem.chain) for member in members])
        self._origin = round(members[0].problem.start / self._run.fixed_step)
        self._number, self._calls = self._origin, 0

    __reduce_ex__ = Simulator.__reduce_ex__

    def __repr__(self) -> str:
        return f"<SimulatorBatch: {len(self)} arms, t = {self.time:g} s, {self.chains[0].n} joints each>"

    def __len__(self) -> int:
        return len(self.chains)

    @property
    def time(self) -> float:
        """Present time [s], the same for all arms."""
        return self._number * self._run.fixed_step

    @property
    def state(self) -> State:
        """Time [s], and angles [rad] and rates [rad/s] of all arms, shape (N, n); copies."""
        q, qd = (np.concatenate([block.rows(k) for block in self._blocks]) for k in (0, 1))
        return State(self.time, q, qd)

    def step(self, tau: ArrayLike | None = None, *_more: Never, duration: float | None = None) -> State:
        """Advance all arms as `Simulator.step`, under torques (N, d) of the driven joints; return the state at the end.

        Raises
        ------
        DivergenceError
            The state of some arms, whose numbers are in the error's `arms`, is no longer finite, or their energy does
            not balance. All arms stay in their state before this call; `reset` those that failed.
        """
        if _more:
            refuse_call(self.step, "too many positional arguments", {})
        run = self._run
        duration = run.spacing if duration is None else positive("duration", duration)
        stop = self._number + whole("duration", duration, run.label("step", "run."), run.fixed_step, ArgumentError)
        torques: list[Array | None] = [None] * len(self._blocks)
        if tau is not None:
            every = np.clip(_rows("tau", tau, (len(self), len(self.chains[0].active))), -self._effort, self._effort)
            torques = [every[k : k + LANES] for k in range(0, len(self), LANES)]
        calls = self._calls + 1
        balanced = calls % OFTEN == 0 or calls & (calls - 1) == 0
        before = [block.saved() for block in self._blocks]
        try:
            wrong = self._each(lambda k, block: block.go(torques[k], self._number, stop, balanced))
        except BaseException:  # including Ctrl-C
            self._restore(before)
            raise
        faults = {LANES * k + lane: text for k, found in enumerate(wrong) for lane, text in found.items()}
        if faults:
            self._restore(before)
            raise self._diverged(faults)
        self._number, self._calls = stop, calls
        return self.state

    def reset(self, arms: ArrayLike | None = None, q: ArrayLike | None = None, qd: ArrayLike | None = None) -> State:
        """Restart arms from angles [rad] and rates [rad/s], at rest or as in their scenes if None; return all states.

        Parameters
        ----------
        arms
            Numbers of the arms, or a mask (N,) of truth values; None: all, and time restarts as well. Other arms
            continue; time goes on.
        q, qd
            Shape (arms, n) or (n,).

        Raises
        ------
        ArgumentError
            There is no such arm, the shape is wrong, or only some arms restart although their drive or motion depends
            on time.
        UnstableStepError
            The step is larger than the largest stable one in such a state.
        """
        numbers, scene = self._numbers(arms), self._blocks[0].members[0].problem.scene
        if arms is not None and (scene.motion or scene.drive.kind != "none"):
            why = "the drive or motion of the scenes depends on time, so all arms restart together"
            raise ArgumentError(f"arms: {why}; leave arms out", id="together-only")
        shape = len(numbers), self.chains[0].n
        starts = [None if part is None else _rows(name, part, shape) for name, part in (("q", q), ("qd", qd))]
        problems = []
        for row, number in enumerate(numbers):
            problem = self._blocks[number // LANES].members[number % LANES].problem
            q_start, qd_start = (None if part is None else part[row] for part in starts)
            problems.append(started(problem, started_from(problem.scene, q_start, qd_start, None)))
        for warnings in check_steps(problems):
            or_raise(warnings)
        for number, problem in zip(numbers, problems, strict=True):
            self._blocks[number // LANES].restart(number % LANES, problem.q, problem.qd)
        if arms is None:
            self._number, self._calls = self._origin, 0
            for block in self._blocks:
                block.forget()
        return self.state

    def _each(self, call: Callable[[int, _Eight], dict[int, str]]) -> list[dict[int, str]]:
        if self._threads == 1:
            return [call(k, block) for k, block in enumerate(self._blocks)]
        with ThreadPoolExecutor(self._threads) as pool:
            return list(pool.map(call, range(len(self._blocks)), self._blocks))

    def _restore(self, before: Sequence[Any]) -> None:
        for block, saved in zip(self._blocks, before, strict=True):
            block.restore(saved)

    def _numbers(self, arms: ArrayLike | None) -> list[int]:
        count = len(self)
        given = np.arange(count) if arms is None else np.asarray(arms)
        if given.dtype == bool and given.shape == (count,):
            given = np.flatnonzero(given)
        if given.ndim != 1 or given.dtype.kind not in "iu" or not ((given >= 0) & (given < count)).all():
            raise ArgumentError(f"arms: expected numbers from 0 to {count - 1}, or a mask ({count},)", id="wrong-value")
        return [int(k) for k in given]

    def _diverged(self, faults: dict[int, str]) -> DivergenceError:
        number, text = next(iter(faults.items()))
        problem = self._blocks[number // LANES].members[number % LANES].problem
        t, q, qd = self.state
        names = short_list([str(k) for k in faults])
        advice = f"try a smaller step than {self._run.fixed_step:g} s, or reset these arms"
        run = trajectory_from_states(problem, np.array([t]), q[None, number], qd[None, number])
        found = DivergenceError(f"after t = {t:.6g} s: arms {names}: {text}; {advice}", run, id="diverged")
        found.arms = tuple(faults)
        return found


class _Eight:
    """Up to eight arms side by side: their state (n, 8), inputs and checks."""

    def __init__(self, members: Sequence[Member]) -> None:
        self.members, block = members, Block(members, Kept())
        self.records, self.monitors, self.run, n = block.records, block.monitors, block.run, block.chain.n
        q, qd = (np.array(each) for each in zip(*((m.problem.q, m.problem.qd) for m in members), strict=True))
        self.state: tuple[Array, Array, Array] = in_lanes(q), in_lanes(qd), np.zeros((1, LANES))
        for monitor, member in zip(self.monitors, members, strict=True):
            monitor.record.q[0], monitor.record.qd[0] = member.problem.q, member.problem.qd
            monitor.begin()
        inputs, chain = self.records[0].inputs, block.chain
        self.driven = inputs._replace(drive=side_by_side([record.inputs.drive for record in self.records]))
        self.forget()
        self.pushed = inputs._replace(drive=side_by_side([drive_for(chain, pushed(chain))]))
        work = lanes_workspace(solver_for(chain, self.run.solver), [record.chain for record in self.records])
        self.fixed = work, method(self.run.method).arrays
        self.rest = np.inf, NEVER, self.state, (*np.zeros((2, 0, n, LANES)), np.zeros((0, LANES)))
        self.call = direct(integrate, *self.fixed, self.driven, self.run.fixed_step, 0, 0, 0, *self.rest)

    def rows(self, k: int) -> Array:
        """Angles (0) or rates (1) of the arms, shape (arms, n)."""
        found: Array = self.state[k][:, : len(self.members)].T.copy()
        return found

    def go(self, torques: Array | None, first: int, last: int, balanced: bool) -> dict[int, str]:
        """Integrate from step `first` to `last`; return what is wrong, by lane."""
        inputs: Inputs = self.driven
        if torques is not None:
            inputs = self.pushed
            inputs.drive.held[0] = in_lanes(torques)
        done = self.call(*self.fixed, inputs, self.run.fixed_step, 0, first, last, *self.rest)
        q, qd, work = self.state
        if done < last:
            good: list[bool] = np.logical_and.reduce(np.isfinite(np.concatenate([q, qd]))).tolist()
            return {lane: "the state is no longer finite" for lane in range(len(self.members)) if not good[lane]}
        if not balanced:
            return {}
        steps, found = steps_up_to(self.run, last), {}
        for lane, monitor in enumerate(self.monitors):
            own_q, own_qd, own_work = (np.ascontiguousarray(part[:, lane]) for part in (q, qd, work))
            if fault := monitor.unbalanced(own_q, own_qd, own_work, steps, 0.0):
                found[lane] = fault.text
        return found

    def saved(self) -> tuple[Array, ...]:
        """Copies of everything that `go` changes."""
        return *(part.copy() for part in self.state), *(part.copy() for part in remembered(self.driven.drive))

    def restore(self, saved: tuple[Array, ...]) -> None:
        """Return to a `saved` state."""
        for array, before in zip((*self.state, *remembered(self.driven.drive)), saved, strict=True):
            array[...] = before

    def restart(self, lane: int, q: Array, qd: Array) -> None:
        """Set the state of an arm; the last arm also fills the unused lanes."""
        lanes = slice(lane, LANES if lane == len(self.members) - 1 else lane + 1)
        self.state[0][:, lanes], self.state[1][:, lanes], self.state[2][:, lanes] = q[:, None], qd[:, None], 0.0
        record = self.records[lane]
        record.q[0], record.qd[0] = q, qd
        self.monitors[lane] = Monitor(record)
        self.monitors[lane].begin()

    def forget(self) -> None:
        """Clear the memory of a sampled drive."""
        for array in remembered(self.driven.drive):
            array[...] = 0


def _similar(k: int, found: Member | FlexlinkError) -> Member:
    member = or_raise(found)
    if not member.along:
        expected = "fixed steps of an explicit method (run.step), dynamics 'articulated', a fixed base, "
        expected += "a constant wrench in frame 0, no force elements and no strain modes"
        why = "; the scene has a tolerance" if member.problem.run.controlled else ""
        raise ArgumentError(f"scenes[{k}]: cannot be advanced side by side; expected {expected}{why}", id="not-similar")
    return member


def _rows(name: str, given: ArrayLike, shape: tuple[int, int]) -> Array:
    """Finite numbers of this shape; one row (n,) is repeated."""
    found = real_array(name, given, shape)
    if found.shape == shape[1:] and name != "tau":
        found = np.array(np.broadcast_to(found, shape))
    if found.shape != shape or not np.isfinite(found).all():
        raise ArgumentError(f"{name}: expected finite numbers of shape {shape}, a row for each arm", id="wrong-shape")
    return found
