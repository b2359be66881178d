"""All errors that flexlink raises on purpose; `FlexlinkError` is their base class, except for interruptions.

Examples
--------
>>> try:
...     fl.simulate(scene, step=2e-3)
... except fl.errors.UnstableStepError as error:
...     run = fl.simulate(scene, tolerance=1e-4)
... except fl.FlexlinkError as error:  # any other
...     print(error)
"""

from flexlink.common.errors import (
    ArgumentError,
    ConvergenceError,
    DataFileError,
    EngineError,
    IdentifiabilityError,
    MissingDependencyError,
    OutputError,
    SceneError,
    SingularMassError,
    UnstableStepError,
)
from flexlink.common.versions import old_name
from flexlink.results.stop_reasons import ControlError, DivergenceError, InterruptedRunError

__all__ = [
    "ArgumentError", "ControlError", "ConvergenceError", "DataFileError", "DivergenceError", "EngineError",
    "IdentifiabilityError", "InterruptedRunError", "MissingDependencyError", "OutputError", "SceneError",
    "SingularMassError", "UnstableStepError",
]  # fmt: skip


def __getattr__(name: str) -> object:
    return old_name(f"{__name__}.{name}", required=True)
