"""How a run may end before its time: errors that hold every good sample up to there."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING, NamedTuple

from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexlink.results.trajectory import Trajectory


class DivergenceError(FlexlinkError, ArithmeticError):
    """A run left the finite numbers, or its energy does not balance; `trajectory` holds every good sample before.

    Of `simulate_many`, `runs` holds all runs, this one's samples among them.

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

    def __init__(
        self, message: str, trajectory: Trajectory, runs: Sequence[Trajectory] = (), *, id: str = ""
    ) -> None:
        super().__init__(message, id=id)
        self.trajectory, self.runs = trajectory, runs


class EvaluationLimitError(DivergenceError):
    """A run with a tolerance does not get on: it has taken all that `run.max_evaluations` allows, or would.

    Examples
    --------
    >>> try:
    ...     fl.simulate(scene, tolerance=1e-9, max_evaluations=100)
    ... except fl.errors.EvaluationLimitError as error:
    ...     print(error.trajectory.t[-1] < 1.0)
    True
    """

    _id = "too-many-evaluations"


class Failure(NamedTuple):
    """Why steps ended early."""

    text: str
    advice: str = ""  # of what is known of the cause; empty: as of any run
    kind: type[DivergenceError] = DivergenceError
    id: str = ""  # empty: that of `kind`


def ended_early(reached: float, end: float) -> Failure | None:
    """What is wrong with steps that told no failure and stand at another time than their end [s]; None: nothing.

    Every kind of run is asked, so that none is taken for a whole one that is not.
    """
    if reached == end:
        return None
    text = f"the steps ended at t = {reached:.6g} s, not at {end:.6g} s, without a reason: a fault of flexlink itself"
    return Failure(text, "take another method or step, and report this scene")


class LawFailure(Exception):  # noqa: N818  no ending yet: becomes the error below with the samples
    """A control law raised, or gave no torques."""


class ControlError(FlexlinkError, ValueError):
    """A control law raised, or gave no torques; `trajectory` holds every sample before.

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
    """Ctrl-C or SIGTERM during a run; a KeyboardInterrupt for all who stop at one.

    `trajectory` holds every sample up to there, `signal` the number of the signal; of `simulate_many`, `runs` holds all
    runs as far as they went.

    Examples
    --------
    >>> try:
    ...     found = fl.simulate(scene)
    ... except fl.errors.InterruptedRunError as stopped:
    ...     found = stopped.trajectory  # Ctrl-C: the samples so far
    """

    def __init__(
        self,
        trajectory: Trajectory,
        number: int = signal.SIGINT,
        where: str = "",
        runs: Sequence[Trajectory] = (),
    ) -> None:
        kept = len(trajectory.t)
        super().__init__(f"{word(number)} at t = {trajectory.t[-1]:.6g} s; {kept} sample{'s' * (kept > 1)} kept{where}")
        self.trajectory, self.signal, self.where, self.runs = trajectory, number, where, runs

    def __reduce__(self) -> tuple[type[InterruptedRunError], tuple[Trajectory, int, str, Sequence[Trajectory]]]:
        """Keep the samples in a process pool, which otherwise rebuilds an error from its message alone."""
        return InterruptedRunError, (self.trajectory, self.signal, self.where, self.runs)
