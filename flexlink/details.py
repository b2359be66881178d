"""Details of a description that few scenes have: links by Denavit and Hartenberg, springs at a root, a free base."""

from flexlink.describe.initial import BaseState
from flexlink.describe.joint import DenavitHartenberg
from flexlink.describe.root import RootDamping, RootStiffness

__all__ = [
    "BaseState",
    "DenavitHartenberg",
    "RootDamping",
    "RootStiffness",
]
