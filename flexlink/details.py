"""Details of a description that few scenes need: Denavit-Hartenberg parameters, root springs, filters, ties, stops."""

from flexlink.describe.drive import DriveFilter
from flexlink.describe.filters import Filter
from flexlink.describe.initial import BaseState
from flexlink.describe.joint import DenavitHartenberg, Limits
from flexlink.describe.link import RootDamping, RootStiffness, StrainModes
from flexlink.describe.tie import Tie, TieEnd

__all__ = [
    "BaseState", "DenavitHartenberg", "DriveFilter", "Filter", "Limits", "RootDamping", "RootStiffness", "StrainModes",
    "Tie", "TieEnd",
]  # fmt: skip
