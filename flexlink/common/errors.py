"""What can go wrong, one base class: every message names the thing, its value and what is allowed."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class FlexlinkError(Exception):
    """Base of every error that flexlink raises on purpose; the command line prints it as one line."""


class SceneError(FlexlinkError, ValueError):
    """A scene, or a part of one such as a link (TOML file or Python object), that is not valid."""


class DataFileError(FlexlinkError, ValueError):
    """A file of data that is not valid: a lumping rule, a Runge-Kutta method, an engine's XML, a case of the study."""


class ArgumentError(FlexlinkError, ValueError):
    """An argument of a function with a wrong shape, dtype, value or name."""


class SingularMassError(FlexlinkError, ArithmeticError):
    """The mass matrix is not positive definite at this posture: some joint moves no inertia."""


class AdviceError(FlexlinkError, RuntimeError):
    """No model of a scene can be judged: no two of them can be run, or nothing moves; the message says which."""


class OutputError(FlexlinkError, OSError):
    """A result that could not be written; the message says where it was kept instead."""


class MissingDependencyError(FlexlinkError, ImportError):
    """An optional package (an engine, matplotlib) is not installed; the message names the extra to install."""


class EngineError(FlexlinkError, RuntimeError):
    """Another engine failed on its own account: its process crashed, or gave no answer in time."""


class UnstableStepError(FlexlinkError, ValueError):
    """The step is larger than the largest stable one, `largest` [s]; `unstable = "allow"` insists on it."""

    def __init__(self, message: str, largest: float) -> None:
        super().__init__(message)
        self.largest = largest

    def __reduce__(self) -> tuple[type[UnstableStepError], tuple[str, float]]:
        """Whole through a process pool, which otherwise breaks on an error of two arguments."""
        return UnstableStepError, (str(self), self.largest)


class ConvergenceError(FlexlinkError, ArithmeticError):
    """An equilibrium that was not reached; `q` is the one on the way with the largest part, `load`, of the load."""

    def __init__(self, message: str, q: NDArray[np.float64], load: float) -> None:
        super().__init__(message)
        self.q, self.load = q, load

    def __reduce__(self) -> tuple[type[ConvergenceError], tuple[str, NDArray[np.float64], float]]:
        """As `UnstableStepError`."""
        return ConvergenceError, (str(self), self.q, self.load)


class InterruptedSweepError(KeyboardInterrupt):
    """Ctrl-C or SIGTERM during a sweep; a KeyboardInterrupt for all who stop at one. `signal` is its number."""

    def __init__(self, message: str, number: int = signal.SIGINT) -> None:
        super().__init__(message)
        self.signal = number
