"""Problems and results of parameter identification, for the functions `flexlink.fit`, `check_fit` and `propose`."""

from flexlink.common.versions import old_name
from flexlink.identification.compared_fits import compare_fits, folds
from flexlink.identification.experiments import Experiments
from flexlink.identification.fit import check_fit
from flexlink.identification.frequency_response import frequency_response
from flexlink.identification.problem import FitFrf, FitModes, FitParameter, FitProblem, FitRun, FitStatic
from flexlink.identification.propose import propose

__all__ = [
    "Experiments", "FitFrf", "FitModes", "FitParameter", "FitProblem", "FitRun", "FitStatic", "check_fit",
    "compare_fits", "folds", "frequency_response", "propose",
]  # fmt: skip


def __getattr__(name: str) -> object:
    return old_name(f"{__name__}.{name}", required=True)
