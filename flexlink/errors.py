"""All errors that flexlink raises on purpose; `FlexlinkError` is their base class, except for interruptions.

Examples
--------
>>> try:
...     fl.simulate(scene, step=2e-3)
... except fl.errors.UnstableStepError as error:
...     run = fl.simulate(scene, tolerance=1e-4)
... except fl.errors.FlexlinkError as error:  # any other
...     print(error)
"""

from flexlink.common.errors import (
    AdviceError,
    ArgumentError,
    ConvergenceError,
    DataFileError,
    EngineError,
    FlexlinkError,
    IdentifiabilityError,
    InterruptedSweepError,
    MissingDependencyError,
    OutputError,
    SceneError,
    SingularMassError,
    UnstableStepError,
)
from flexlink.results.stop_reasons import (
    ControlError,
    DivergenceError,
    EvaluationLimitError,
    InterruptedRunError,
)

__all__ = [
    "AdviceError",
    "ArgumentError",
    "ControlError",
    "ConvergenceError",
    "DataFileError",
    "DivergenceError",
    "EngineError",
    "EvaluationLimitError",
    "FlexlinkError",
    "IdentifiabilityError",
    "InterruptedRunError",
    "InterruptedSweepError",
    "MissingDependencyError",
    "OutputError",
    "SceneError",
    "SingularMassError",
    "UnstableStepError",
]
