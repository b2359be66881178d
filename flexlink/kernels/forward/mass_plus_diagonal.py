"""(M + A) x = r for a diagonal A, and what small changes of the angles move, in a plane or in space.

The type of the posture says which recursion it is for, as in `forward`. All numbers may be complex but the posture's.
"""

from numba.extending import overload

from flexlink.kernels.forward.mass_plus_diagonal_plane import (
    PlanePosture,
    displacement_in_plane,
    factor_in_plane,
    place_in_plane,
    solve_in_plane,
)
from flexlink.kernels.forward.mass_plus_diagonal_space import (
    SpacePosture,
    displacement_in_space,
    factor_in_space,
    place_in_space,
    solve_in_space,
)
from flexlink.kernels.tools.compiler import INLINED

PLACE = {PlanePosture: place_in_plane, SpacePosture: place_in_space}
FACTOR = {PlanePosture: factor_in_plane, SpacePosture: factor_in_space}
SOLVE = {PlanePosture: solve_in_plane, SpacePosture: solve_in_space}
DISPLACEMENT = {PlanePosture: displacement_in_plane, SpacePosture: displacement_in_space}
A, INVERSE, FACTORS = 0, 1, 8  # where A and 1 / D of a hinge stand among its factors, and how many they are


def place_bodies(q, posture):
    """Take on the posture of angles q (n,)."""
    PLACE[type(posture)](q, posture)


def factor(factors, posture):
    """Prepare `solve` for the diagonal A in the first column of `factors` (n, 8)."""
    FACTOR[type(posture)](factors, posture)


def solve(factors, r, x, posture):
    """Write x (n,) with (M + A) x = r, 0 at prescribed joints, M without rotors; after `factor`."""
    SOLVE[type(posture)](factors, r, x, posture)


def displacement(δ, posture):
    """Largest displacement [m] that small changes δ (n,) of the angles give to the far end of any segment."""
    return DISPLACEMENT[type(posture)](δ, posture)


@overload(place_bodies, jit_options=INLINED)
def _place_bodies(q, posture):
    algorithm = PLACE[posture.instance_class]
    return lambda q, posture: algorithm(q, posture)  # noqa: PLW0108


@overload(factor, jit_options=INLINED)
def _factor(factors, posture):
    algorithm = FACTOR[posture.instance_class]
    return lambda factors, posture: algorithm(factors, posture)  # noqa: PLW0108


@overload(solve, jit_options=INLINED)
def _solve(factors, r, x, posture):
    algorithm = SOLVE[posture.instance_class]
    return lambda factors, r, x, posture: algorithm(factors, r, x, posture)  # noqa: PLW0108


@overload(displacement, jit_options=INLINED)
def _displacement(δ, posture):
    algorithm = DISPLACEMENT[posture.instance_class]
    return lambda δ, posture: algorithm(δ, posture)  # noqa: PLW0108
