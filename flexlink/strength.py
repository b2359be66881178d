"""Loads inside the links, strains of their surfaces, and the loads at which they buckle."""

from flexlink.dynamics.buckling import buckling_loads
from flexlink.dynamics.loads import internal_loads
from flexlink.dynamics.strain import beam_strain

__all__ = [
    "beam_strain",
    "buckling_loads",
    "internal_loads",
]
