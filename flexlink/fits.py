"""Problems and results of parameter identification, for the functions `flexlink.fit`, `check_fit` and `propose`."""

from flexlink.identification.compared_fits import compare_fits, folds
from flexlink.identification.estimated_response import frequency_response
from flexlink.identification.experiments import Experiments, load_experiments
from flexlink.identification.fit import check_fit
from flexlink.identification.fitted import Fitted
from flexlink.identification.loading import load_fit
from flexlink.identification.problem import FitFrf, FitModes, FitParameter, FitProblem, FitRun, FitStatic
from flexlink.identification.proposals import Proposals
from flexlink.identification.propose import propose

__all__ = [
    "Experiments",
    "FitFrf",
    "FitModes",
    "FitParameter",
    "FitProblem",
    "FitRun",
    "FitStatic",
    "Fitted",
    "Proposals",
    "check_fit",
    "compare_fits",
    "folds",
    "frequency_response",
    "load_experiments",
    "load_fit",
    "propose",
]
