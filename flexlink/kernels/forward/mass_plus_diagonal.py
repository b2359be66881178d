"""(M + A) x = r for an A that is diagonal, or full in cells of coupled springs; and what small changes of angles move.

The type of the posture says whether the recursion is for a plane or for space, as in `forward`. All numbers may be
complex but the posture's.
"""

from flexlink.kernels.forward.mass_plus_cells_plane import factor_cells_in_plane, solve_cells_in_plane
from flexlink.kernels.forward.mass_plus_cells_space import factor_cells_in_space, solve_cells_in_space
from flexlink.kernels.forward.mass_plus_diagonal_plane import (
    PlanePosture,
    displacement_in_plane,
    factor_in_plane,
    place_in_plane,
    plane_posture_of,
    solve_in_plane,
)
from flexlink.kernels.forward.mass_plus_diagonal_space import (
    SpacePosture,
    displacement_in_space,
    factor_in_space,
    place_in_space,
    solve_in_space,
    space_posture_of,
)
from flexlink.kernels.tools.compiler import by_type, inlined, recursion
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.rare import rarely

FACTORS = numbered("A inverse others:6")  # of a hinge: A, 1 / D, and what else each of the two keeps


@by_type({PlanePosture: plane_posture_of, SpacePosture: space_posture_of})
def posture_of_stage(i, postures):
    """One of several postures, whose arrays have a leading dimension (s,)."""


@by_type({PlanePosture: place_in_plane, SpacePosture: place_in_space})
def place_bodies(q, posture):
    """Take on the posture of angles q (n,)."""


@recursion
def factor_plane(factors, posture):
    """In a plane."""
    if posture.first is not None and len(posture.first) > 0:
        factor_cells_in_plane(factors, posture)
    else:
        factor_in_plane(factors, posture)


@recursion
def factor_space(factors, posture):
    """In space."""
    if posture.first is not None and len(posture.first) > 0:
        factor_cells_in_space(factors, posture)
    else:
        factor_in_space(factors, posture)


@by_type({PlanePosture: factor_plane, SpacePosture: factor_space})
def factor(factors, posture):
    """Prepare `solve` for the diagonal of A in the first column of `factors` (n, 8), the rest from `COUPLED.L` on."""


@recursion
def solve_plane(factors, r, x, posture):
    """In a plane."""
    if posture.first is not None and len(posture.first) > 0:
        solve_cells_in_plane(factors, r, x, posture)
    else:
        solve_in_plane(factors, r, x, posture)


@recursion
def solve_space(factors, r, x, posture):
    """In space."""
    if posture.first is not None and len(posture.first) > 0:
        solve_cells_in_space(factors, r, x, posture)
    else:
        solve_in_space(factors, r, x, posture)


@by_type({PlanePosture: solve_plane, SpacePosture: solve_space})
def solve(factors, r, x, posture):
    """Write x (n,) with (M + A) x = r, 0 at prescribed joints, M without rotors; after `factor`."""


@by_type({PlanePosture: displacement_in_plane, SpacePosture: displacement_in_space})
def displacement_of_places(δ, posture):
    """Largest displacement [m] that small changes δ (n,) of the angles give to the far end of any segment."""


@inlined
def displacement(δ, posture):
    """The same, or the largest by a joint that moves no place and counts by a radius."""
    largest = displacement_of_places(δ, posture)
    if rarely(len(posture.radius) > 0):
        for k in range(len(δ)):
            largest = max(largest, posture.radius[k] * abs(δ[k]))  # nan stays
    return largest
