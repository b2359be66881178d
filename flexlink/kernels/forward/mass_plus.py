"""Solve (M + A) x = r with A diagonal or, with coupled springs, block-diagonal; find displacements due to small angles.

The type of the posture selects the recursion for a plane or for space, as in `forward`. This type also decides whether
springs are coupled: if `first` is None, no code for cells is compiled. All numbers except the posture's may be complex.
"""

from flexlink.kernels.bodies.plane import PlanarWork
from flexlink.kernels.bodies.rne import RneWork
from flexlink.kernels.bodies.shaped_mass import weigh_in_plane, weigh_in_space
from flexlink.kernels.forward.mass_plus_cells import columns, put_couplings
from flexlink.kernels.forward.mass_plus_plane import (
    PlanePosture,
    displacement_in_plane,
    factor_in_plane,
    place_in_plane,
    plane_posture_of,
    plane_without_cells,
    solve_in_plane,
)
from flexlink.kernels.forward.mass_plus_shapes import (
    ShapedPosture,
    as_given,
    closest_sum,
    factor_shapes,
    shaped_columns,
    shaped_without_cells,
    solve_shapes,
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
from flexlink.kernels.tools.compiler import by_type, inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.rare import rarely


@kernel
def hinge_columns(posture):
    """`factor_columns` of a chain whose hinges move one by one."""
    return columns(posture.first)


@by_type({PlanePosture: hinge_columns, SpacePosture: hinge_columns, ShapedPosture: shaped_columns})
def factor_columns(posture):
    """Number of columns of `factors` (n, columns)."""


@inlined
def shaped_posture_of(i, postures):
    """`posture_of_stage` of hinges that move by shapes."""
    return ShapedPosture(
        postures.chain, postures.shapes, postures.mass, postures.M[i], postures.y,
        posture_of_stage(i, postures.hinges), postures.first, postures.coupled, postures.radius,
    )  # fmt: skip


@by_type({PlanePosture: plane_posture_of, SpacePosture: space_posture_of, ShapedPosture: shaped_posture_of})
def posture_of_stage(i, postures):
    """Posture `i` of s postures, whose arrays have a leading dimension (s,)."""


@by_type({
    PlanarWork: weigh_in_plane, PlanePosture: weigh_in_plane, RneWork: weigh_in_space, SpacePosture: weigh_in_space,
})  # fmt: skip
def weigh(q, work, placed):
    """Write Φᵀ M Φ without rotors to `work.M`; the bodies are `placed` at the same angles q (n,)."""


@subroutine
def place_shapes(q, posture):
    """Set the posture to the angles q (n,), and compute Φᵀ M Φ."""
    place_bodies(q, posture.hinges)
    weigh(q, posture, posture.hinges)


@by_type({PlanePosture: place_in_plane, SpacePosture: place_in_space, ShapedPosture: place_shapes})
def place_bodies(q, posture):
    """Set the posture to the angles q (n,)."""


@by_type({PlanePosture: plane_without_cells, SpacePosture: space_without_cells, ShapedPosture: shaped_without_cells})
def without_cells(posture):
    """The same posture, with the type that belongs to a chain without coupled springs."""


@by_type({PlanePosture: factor_in_plane, SpacePosture: factor_in_space, ShapedPosture: factor_shapes})
def factor_by_type(factors, posture):
    """`factor` for a chain with or without cells, selected by type."""


@subroutine
def factor_cells(factors, posture):
    """`factor` for a chain with cells; not inlined into other kernels because such chains are rare."""
    factor_by_type(factors, posture)


@inlined
def shift_cells(z, factors, posture):
    """Write A_kj = z D_kj + z² K_kj of coupled springs to `factors`; a chain without them has none."""
    if posture.first is not None and len(posture.first) > 0:
        put_couplings(z, z * z, posture.coupled, factors)


@recursion
def factor(factors, posture):
    """Prepare `solve`; column 0 of `factors` (n, 8) is the diagonal of A, columns from `COUPLED.L` the other A_kj."""
    if posture.first is not None and len(posture.first) > 0:
        factor_cells(factors, posture)
    else:
        factor_by_type(factors, without_cells(posture))


@by_type({PlanePosture: solve_in_plane, SpacePosture: solve_in_space, ShapedPosture: solve_shapes})
def solve_by_type(factors, r, x, posture):
    """`solve` for a chain with or without cells, selected by type."""


@subroutine
def solve_cells(factors, r, x, posture):
    """`solve` for a chain with cells; not inlined into other kernels because such chains are rare."""
    solve_by_type(factors, r, x, posture)


@recursion
def solve(factors, r, x, posture):
    """Write x (n,) with (M + A) x = r, 0 at prescribed joints; M excludes rotors. Call `factor` first."""
    if posture.first is not None and len(posture.first) > 0:
        solve_cells(factors, r, x, posture)
    else:
        solve_by_type(factors, r, x, without_cells(posture))


@inlined
def displacement_of_hinges(δ, posture):
    """`displacement_of_places` of hinges that move by shapes."""
    return displacement_of_places(δ, posture.hinges)


@by_type({
    PlanePosture: displacement_in_plane, SpacePosture: displacement_in_space, ShapedPosture: displacement_of_hinges,
})  # fmt: skip
def displacement_of_places(δ, posture):
    """Largest displacement [m] of the outboard end of any segment for small changes δ (n,) of the angles."""


@by_type({PlanePosture: as_given, SpacePosture: as_given, ShapedPosture: closest_sum})
def make_possible(x, posture):
    """Replace accelerations x (n,) by the closest possible ones; without shapes all are possible."""


@inlined
def displacement(δ, posture):
    """Maximum of `displacement_of_places` and of radius · |δ_k| over the joints that displace no point."""
    largest = displacement_of_places(δ, posture)
    if rarely(len(posture.radius) > 0):
        for k in range(len(δ)):
            largest = max(largest, posture.radius[k] * abs(δ[k]))  # propagates nan
    return largest
