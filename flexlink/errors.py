"""All errors that flexlink raises on purpose; `FlexlinkError` is the base of all but those of an interruption."""

# ruff: noqa: PLC0414  to import a name here is to publish it

from flexlink.common.errors import (
    AdviceError as AdviceError,
)
from flexlink.common.errors import (
    ArgumentError as ArgumentError,
)
from flexlink.common.errors import (
    ConvergenceError as ConvergenceError,
)
from flexlink.common.errors import (
    DataFileError as DataFileError,
)
from flexlink.common.errors import (
    EngineError as EngineError,
)
from flexlink.common.errors import (
    FlexlinkError as FlexlinkError,
)
from flexlink.common.errors import (
    InterruptedSweepError as InterruptedSweepError,
)
from flexlink.common.errors import (
    MissingDependencyError as MissingDependencyError,
)
from flexlink.common.errors import (
    OutputError as OutputError,
)
from flexlink.common.errors import (
    SceneError as SceneError,
)
from flexlink.common.errors import (
    SingularMassError as SingularMassError,
)
from flexlink.common.errors import (
    UnstableStepError as UnstableStepError,
)
from flexlink.results.stop_reasons import (
    ControlError as ControlError,
)
from flexlink.results.stop_reasons import (
    DivergenceError as DivergenceError,
)
from flexlink.results.stop_reasons import (
    EvaluationLimitError as EvaluationLimitError,
)
from flexlink.results.stop_reasons import (
    InterruptedRunError as InterruptedRunError,
)
