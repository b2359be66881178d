"""Preallocated samples of a running simulation."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.problem import Problem
from flexlink.dynamics.terms import Energy
from flexlink.kernels.stepping.samples import drive_torques, prescribed_torques, tips_and_energies
from flexlink.kernels.tools.machine_code import direct
from flexlink.results.samples import Steps
from flexlink.results.trajectory import Trajectory


def trajectory_from_states(problem: Problem, t: Array, q: Array, qd: Array) -> Trajectory:
    """Add tip, energies and drive torques to states that another engine's run of a problem went through."""
    record = Record(problem, t, q.copy(), qd.copy())
    record.derive(0, len(t))
    return record.trajectory(len(t), balanced=False)


class Record:
    """Preallocated samples of a running simulation; rows beyond the last one reached are uninitialised.

    Attributes
    ----------
    q, qd, works
        States (samples, n) and the integrated work (samples,), without that of a constant tip
        force, which has a potential.
    origin
        Number of fixed steps from t = 0 to the start of the run.
    """

    def __init__(self, problem: Problem, t: Array, q: Array, qd: Array) -> None:
        self.problem, self.run, self.chain, self.inputs = problem, problem.run, problem.chain, problem.inputs
        self.t, self.q, self.qd = t, q, qd
        self.tau, self.tip, self.energy = np.empty_like(q), np.empty((len(t), 3)), np.empty((3, len(t)))
        self.works = np.zeros(len(t))
        self.origin = 0 if self.run.controlled else round(float(t[0]) / self.run.step)
        self._drive_torques: Callable[..., Any] | None = None

    @functools.cached_property
    def scratch(self) -> Any:
        """Scratch of the run's solver; members side by side have one together."""
        return self.problem.workspace()

    def derive(self, first: int, stop: int) -> None:
        """Tip, energies and drive torques of the samples first … stop − 1."""
        rows = slice(first, stop)
        t, q, qd = self.t[rows], self.q[rows], self.qd[rows]
        tips_and_energies(self.chain.arrays, q, qd, self.tip[rows], self.energy[:, rows])
        arguments = self.inputs, t, q, qd, self.tau[rows]  # of the same types in all calls
        if self._drive_torques is None:
            self._drive_torques = direct(drive_torques, *arguments)
        self._drive_torques(*arguments)
        if len(self.inputs.motion.joints):
            prescribed_torques(self.scratch, self.inputs, t, q, qd, self.tau[rows])

    def work(self, rows: slice) -> Array:
        """Work done up to these samples [J]: to the integrated one a constant force f adds f·(p − p(0)), p the tip."""
        force = self.inputs.potential_force
        if not force.any():
            return self.works[rows].copy()
        return np.asarray(self.works[rows] + (self.tip[rows] - self.tip[0]) @ force)

    def trajectory(
        self, stop: int, warnings: tuple[str, ...] = (), steps: Steps | None = None, balanced: bool = True
    ) -> Trajectory:
        """The samples before `stop`, read-only; this record must not go on."""
        work = self.work(slice(stop)) if balanced else None
        t, q, qd, tau, tip = (_kept(a, stop) for a in (self.t, self.q, self.qd, self.tau, self.tip))
        energy, wrench = Energy(*self.energy[:, :stop]), self.inputs.tip_wrenches(t, q, qd)
        return Trajectory(self.chain, t, q, qd, tau, tip, energy, work, warnings, steps, wrench, self.problem.scene)


def _kept(array: Array, stop: int) -> Array:
    """The first rows, without holding the memory of the rest."""
    return array if stop == len(array) else array[:stop].copy()
