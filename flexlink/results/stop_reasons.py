"""Errors raised by runs that end early; each contains all good samples up to that point."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING, NamedTuple

from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexlink.results.trajectory import Trajectory


class DivergenceError(FlexlinkError, ArithmeticError):
    """The state of a run is no longer finite, or its energy does not balance; `trajectory` contains every good sample.

    The `id` distinguishes "diverged", "energy-imbalance", "newton-failed", "tolerance-not-met",
    "mass-not-positive-definite" and "too-many-evaluations", if a run with a tolerance progresses too slowly. From
    `simulate_many`, `runs` contains all runs, including this one; from `SimulatorBatch`, `arms` contains the numbers of
    the arms that failed.

    Examples
    --------
    >>> try:
    ...     fl.simulate(scene, step=2e-3, unstable="allow")
    ... except fl.errors.DivergenceError as error:
    ...     kept = error.trajectory  # every good sample before
    ...     print(kept.t[-1] < 1.0)
    True
    """

    _id = "diverged"

    def __init__(self, message: str, trajectory: Trajectory, runs: Sequence[Trajectory] = (), *, id: str = "") -> None:
        super().__init__(message, id=id)
        self.trajectory, self.runs = trajectory, runs
        self.arms: tuple[int, ...] = ()


class EvaluationLimitError(DivergenceError):
    """A run with a tolerance progresses too slowly: it has used, or would exceed, `run.max_evaluations`."""

    _id = "too-many-evaluations"


class Failure(NamedTuple):
    """Reason why steps ended early."""

    text: str
    advice: str = ""  # remedy if the cause is known; empty: the general remedy
    kind: type[DivergenceError] = DivergenceError
    id: str = ""  # id of the error; empty: the id of `kind`


def ended_early(reached: float, end: float) -> Failure | None:
    """Failure of steps that ended at another time than `end` [s] without a reason, whatever the kind of run."""
    if reached == end:
        return None
    text = f"the steps ended at t = {reached:.6g} s instead of {end:.6g} s without a reason: a bug in flexlink"
    return Failure(text, "try another method or step, and report this scene", id="ended-early")


class LawFailure(Exception):  # noqa: N818  internal: becomes a ControlError with the samples
    """A control law raised an exception, or returned no valid torques."""


class ControlError(FlexlinkError, ValueError):
    """A control law raised an exception, or returned no valid torques; `trajectory` contains all samples before that.

    Examples
    --------
    >>> try:
    ...     fl.simulate(scene.varied({"drive": fl.Drive()}), control=lambda t, q, qd: [np.nan, 0.0], rate=1000.0)
    ... except fl.errors.ControlError as error:
    ...     print(error.trajectory.t)
    [0.]
    """

    _id = "controller-failed"

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory


class InterruptedRunError(KeyboardInterrupt):
    """Ctrl-C or SIGTERM during a run; as it is a KeyboardInterrupt, programs that handle it stop as usual.

    `trajectory` contains every sample up to that point, and `signal` is the number of the signal. From `simulate_many`,
    `runs` contains all runs up to that point.

    Examples
    --------
    >>> try:
    ...     found = fl.simulate(scene)
    ... except fl.errors.InterruptedRunError as stopped:
    ...     found = stopped.trajectory  # Ctrl-C: the samples so far
    """

    def __init__(
        self, trajectory: Trajectory, number: int = signal.SIGINT, where: str = "", runs: Sequence[Trajectory] = (),
    ) -> None:  # fmt: skip
        kept = len(trajectory.t)
        super().__init__(f"{word(number)} at t = {trajectory.t[-1]:.6g} s; {kept} sample{'s' * (kept > 1)} kept{where}")
        self.trajectory, self.signal, self.where, self.runs = trajectory, number, where, runs

    def __reduce__(self) -> tuple[type[InterruptedRunError], tuple[Trajectory, int, str, Sequence[Trajectory]]]:
        """Preserve the samples when a process pool pickles the error; by default only its message is preserved."""
        return InterruptedRunError, (self.trajectory, self.signal, self.where, self.runs)
