"""Public names that `import flexlink` loads when one is used: they bring other engines, pages and workers."""

# ruff: noqa: PLC0414  to import a name here is to publish it

from flexlink.diagnosis.comparison import compare as compare
from flexlink.diagnosis.trajectories import compare_trajectories as compare_trajectories
from flexlink.identification.fit import check_fit as check_fit
from flexlink.identification.fit import fit as fit
from flexlink.identification.fitted import Fitted as Fitted
from flexlink.identification.loading import load_fit as load_fit
from flexlink.identification.problem import FitModes as FitModes
from flexlink.identification.problem import FitParameter as FitParameter
from flexlink.identification.problem import FitProblem as FitProblem
from flexlink.identification.problem import FitRun as FitRun
from flexlink.identification.problem import FitStatic as FitStatic
from flexlink.scene_report.report import report as report
from flexlink.sweeps.plan import Sweep as Sweep
from flexlink.sweeps.plan import load_sweep as load_sweep
from flexlink.sweeps.run import sweep as sweep
