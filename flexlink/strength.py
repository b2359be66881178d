"""Internal loads of the links, strains at their surfaces, and buckling loads."""

from flexlink.dynamics.equilibrium import buckling_loads
from flexlink.dynamics.loads import internal_loads
from flexlink.dynamics.strain import beam_strain

__all__ = ["beam_strain", "buckling_loads", "internal_loads"]
