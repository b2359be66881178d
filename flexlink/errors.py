"""What can go wrong, one base class: every message names the thing, its value and what is allowed."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

from flexlink.interruption import word

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from flexlink.trajectory import Trajectory


class FlexlinkError(Exception):
    """Base of every error that flexlink raises on purpose; the command line prints it as one line."""


class SceneError(FlexlinkError, ValueError):
    """A description (TOML file or Python object) that is not a valid arm, scene, rule or tableau."""


class ArgumentError(FlexlinkError, ValueError):
    """An argument of a public function with a wrong shape, dtype, value or name."""


class SingularMassError(FlexlinkError, ArithmeticError):
    """The mass matrix is not positive definite at this posture: some joint moves no inertia."""


class OutputError(FlexlinkError, OSError):
    """A result that could not be written; the message says where it was kept instead."""


class MissingDependencyError(FlexlinkError, ImportError):
    """An optional package (an engine, matplotlib) is not installed; the message names the extra to install."""


class UnstableStepError(FlexlinkError, ValueError):
    """The step is larger than the largest stable one, `largest` [s]; `unstable = "allow"` insists on it."""

    def __init__(self, message: str, largest: float) -> None:
        super().__init__(message)
        self.largest = largest

    def __reduce__(self) -> tuple[type[UnstableStepError], tuple[str, float]]:
        """As `DivergenceError`."""
        return UnstableStepError, (str(self), self.largest)


class DivergenceError(FlexlinkError, ArithmeticError):
    """A run left the finite numbers, or its energy does not balance; `trajectory` holds every good sample before.

    Of `simulate_many`, `runs` holds all runs, this one's samples among them.
    """

    def __init__(self, message: str, trajectory: Trajectory, runs: Sequence[Trajectory] = ()) -> None:
        super().__init__(message)
        self.trajectory, self.runs = trajectory, runs

    def __reduce__(self) -> tuple[type[DivergenceError], tuple[str, Trajectory, Sequence[Trajectory]]]:
        """With all it holds through a process pool, which otherwise breaks on an error of two arguments."""
        return DivergenceError, (str(self), self.trajectory, self.runs)


class InterruptedRunError(KeyboardInterrupt):
    """Ctrl-C or SIGTERM during a run; a KeyboardInterrupt for all who stop at one.

    `trajectory` holds every sample up to there, `signal` the number of the signal; of `simulate_many`, `runs` holds all
    runs as far as they went.
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
        """As `DivergenceError`."""
        return InterruptedRunError, (self.trajectory, self.signal, self.where, self.runs)


class ConvergenceError(FlexlinkError, ArithmeticError):
    """An equilibrium that was not reached; `q` is the one on the way with the largest part, `load`, of the load."""

    def __init__(self, message: str, q: NDArray[np.float64], load: float) -> None:
        super().__init__(message)
        self.q, self.load = q, load

    def __reduce__(self) -> tuple[type[ConvergenceError], tuple[str, NDArray[np.float64], float]]:
        """As `DivergenceError`."""
        return ConvergenceError, (str(self), self.q, self.load)
