"""Problems and results of parameter identification, for the functions `flexlink.fit` and `check_fit`."""

from flexlink.identification.fit import check_fit
from flexlink.identification.fitted import Fitted
from flexlink.identification.loading import load_fit
from flexlink.identification.problem import FitModes, FitParameter, FitProblem, FitRun, FitStatic

__all__ = [
    "FitModes",
    "FitParameter",
    "FitProblem",
    "FitRun",
    "FitStatic",
    "Fitted",
    "check_fit",
    "load_fit",
]
