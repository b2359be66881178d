"""(M + A) x = r for an A that is diagonal, or full in cells of coupled springs; and what small changes of angles move.

The type of the posture says whether the recursion is for a plane or for space, as in `forward`, and whether springs are
coupled: where `first` is None the same recursion has no code for cells. All numbers may be complex but the posture's.
"""

from flexlink.kernels.forward.mass_plus_plane import (
    PlanePosture,
    displacement_in_plane,
    factor_in_plane,
    place_in_plane,
    plane_posture_of,
    plane_without_cells,
    solve_in_plane,
)
from flexlink.kernels.forward.mass_plus_space import (
    SpacePosture,
    displacement_in_space,
    factor_in_space,
    place_in_space,
    solve_in_space,
    space_posture_of,
    space_without_cells,
)
from flexlink.kernels.tools.compiler import by_type, inlined, recursion, subroutine
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.rare import rarely

FACTORS = numbered("A inverse others:6")  # of a hinge: A, 1 / D, and what else each of the two keeps


@by_type({PlanePosture: plane_posture_of, SpacePosture: space_posture_of})
def posture_of_stage(i, postures):
    """One of several postures, whose arrays have a leading dimension (s,)."""


@by_type({PlanePosture: place_in_plane, SpacePosture: place_in_space})
def place_bodies(q, posture):
    """Take on the posture of angles q (n,)."""


@by_type({PlanePosture: plane_without_cells, SpacePosture: space_without_cells})
def without_cells(posture):
    """The posture by whose type no springs are coupled."""


@by_type({PlanePosture: factor_in_plane, SpacePosture: factor_in_space})
def factor_by_type(factors, posture):
    """`factor` with cells or without."""


@subroutine
def factor_cells(factors, posture):
    """`factor` with cells, which few chains have: no kernel holds a copy."""
    factor_by_type(factors, posture)


@recursion
def factor(factors, posture):
    """Prepare `solve` for the diagonal of A in the first column of `factors` (n, 8), the rest from `COUPLED.L` on."""
    if posture.first is not None and len(posture.first) > 0:
        factor_cells(factors, posture)
    else:
        factor_by_type(factors, without_cells(posture))


@by_type({PlanePosture: solve_in_plane, SpacePosture: solve_in_space})
def solve_by_type(factors, r, x, posture):
    """`solve` with cells or without."""


@subroutine
def solve_cells(factors, r, x, posture):
    """`solve` with cells, which few chains have: no kernel holds a copy."""
    solve_by_type(factors, r, x, posture)


@recursion
def solve(factors, r, x, posture):
    """Write x (n,) with (M + A) x = r, 0 at prescribed joints, M without rotors; after `factor`."""
    if posture.first is not None and len(posture.first) > 0:
        solve_cells(factors, r, x, posture)
    else:
        solve_by_type(factors, r, x, without_cells(posture))


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
