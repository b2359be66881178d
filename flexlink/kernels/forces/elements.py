"""Force elements: forces on a chain besides inertia, gravity, and the springs and friction of single joints.

A chain has a tuple of records, one of each kind; a plain chain has none. Each function here calls the function of every
record, by its type, and returns the sum of their results. To add a kind, write a record with these functions, and enter
them in the tables below and in `in_motion`. Its numbers are a structured array of the chain, named in `layout.FORCES`:

    of a chain      (chain) -> record                             its constants and scratch arrays
    torque          (record, q, qd, torque) -> power loss [W]     adds T (n,), which resists like T_FR
    energy          (record, q) -> V [J]                          if the law has a potential
    slopes          (record, q, qd, by_angle, by_rate)            adds ∂T/∂q and ∂T/∂q̇ (n, n)
    brakes          (record, q, qd, brakes)                       adds ∂T_k/∂q̇_k (n,) for implicit steps

These functions allocate no arrays. Derivatives may have a separate record, with more scratch. A law with internal
states is made of internal coordinates and gyrators (`gyrators`). Springs and dampers between hinges can be computed for
eight states side by side.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forces.couplings import (
    Couplings,
    coupling_energy,
    coupling_slopes,
    coupling_torque,
    couplings_of,
    couplings_side_by_side,
)
from flexlink.kernels.forces.dampers import Dampers, damper_brakes, damper_slopes, damper_torque, dampers_of
from flexlink.kernels.forces.drag import Drag, DragSlopes, drag_of, drag_slopes, drag_slopes_of, drag_torque
from flexlink.kernels.forces.gyrators import Gyrators, gyrator_slopes, gyrator_torque, gyrators_of
from flexlink.kernels.forces.rotation_springs import (
    RotationSprings,
    rotation_energy,
    rotation_of,
    rotation_springs_side_by_side,
    rotation_torque,
)
from flexlink.kernels.forces.rotation_tangent import RotationTangent, rotation_slopes, rotation_tangent
from flexlink.kernels.layout import ChainArrays, Rare
from flexlink.kernels.tools.compiler import kernel, of_each, recursion, subroutine
from flexlink.kernels.tools.lanes import at, empty_lanes, put_at, zero_of


class Forces(NamedTuple):
    """All force elements of a chain."""

    elements: Any  # a tuple of records
    act: bool  # whether there is any
    torque: Any  # (n,) scratch, or (n, 8)


class Slopes(NamedTuple):
    """Derivatives of all force elements."""

    elements: Any  # a tuple of records
    act: bool
    found: Any  # (2, n, n) ∂T/∂q and ∂T/∂q̇; (2, 0, 0) without force elements


@of_each({
    Couplings: coupling_torque, RotationSprings: rotation_torque, Drag: drag_torque,
    Dampers: damper_torque, Gyrators: gyrator_torque,
})  # fmt: skip
def add_torques(elements, q, qd, torque):
    """Add T of all elements to `torque` (n,), or (n, 8); return the power loss [W]."""


@of_each({Couplings: coupling_energy, RotationSprings: rotation_energy}, optional=True)
def elastic_energy(elements, q):
    """Potential energy of all elements [J]."""


@of_each({
    Couplings: coupling_slopes, RotationTangent: rotation_slopes, DragSlopes: drag_slopes,
    Dampers: damper_slopes, Gyrators: gyrator_slopes,
}, summed=False)  # fmt: skip
def add_slopes(elements, q, qd, by_angle, by_rate):
    """Add ∂T/∂q and ∂T/∂q̇ of all elements to (n, n) each."""


@of_each({Dampers: damper_brakes}, summed=False, optional=True)
def add_brakes(elements, q, qd, brakes):
    """Add ∂T_k/∂q̇_k to (n,) for elements that count in implicit steps and their error estimates."""


@recursion
def find_brakes(forces, q, qd, brakes):
    """Write ∂T_k/∂q̇_k (n,)."""
    for k in range(len(brakes)):
        brakes[k] = 0.0
    if forces.act:
        add_brakes(forces.elements, q, qd, brakes)


@recursion
def find_slopes(slopes, q, qd):
    """Write ∂T/∂q and ∂T/∂q̇ of all elements."""
    if slopes.act:
        for part in range(2):
            for i in range(len(q)):
                for j in range(len(q)):
                    slopes.found[part, i, j] = 0.0
        add_slopes(slopes.elements, q, qd, slopes.found[0], slopes.found[1])


@kernel
def forces_of(chain):
    """Force elements of a chain; None for a plain chain."""
    if chain.rare is None:
        return None
    elements = (couplings_of(chain), rotation_of(chain)) + in_motion(chain)  # noqa: RUF005
    return Forces(elements, any_acts(chain.rare, elements[1]), np.empty(len(chain.hinges)))


@recursion
def any_acts(rare, rotation):
    """Whether a chain has any force element."""
    springs = len(rare.couplings) > 0 or len(rotation.hinges) > 0
    return springs or len(rare.drag) > 0 or len(rare.dampers) > 0 or len(rare.gyrators) > 0


@kernel
def force_slopes_of(chain, forces):
    """Derivatives of the force elements of a chain; None for a plain chain."""
    if forces is None:
        return None
    couplings, rotation, _, dampers, gyrators = forces.elements
    elements = couplings, rotation_tangent(rotation), drag_slopes_of(chain), dampers, gyrators
    n = len(chain.hinges) if forces.act else 0
    return Slopes(elements, forces.act, np.empty((2, n, n)))


@kernel
def in_motion(chain):
    """Elements other than springs and dampers between hinges."""
    return drag_of(chain), dampers_of(chain), gyrators_of(chain)


@kernel
def motion_torques(chain, qs, qds, found):
    """Add T of the elements `in_motion` at states (b, n) to `found` (b, n)."""
    elements = in_motion(chain)
    for row in range(len(qs)):
        add_torques(elements, qs[row], qds[row], found[row])


@kernel
def motion_slopes(chain, q, qd, by_angle, by_rate):
    """Add ∂T/∂q and ∂T/∂q̇ of the elements `in_motion` to (n, n) each."""
    add_slopes((drag_slopes_of(chain), dampers_of(chain), gyrators_of(chain)), q, qd, by_angle, by_rate)


@kernel
def one_of(bodies, hinges, gravity, rare, lane):
    """Chain number `lane` of eight, from arrays (8, …)."""
    return ChainArrays(bodies[lane], hinges[lane], gravity[lane], one_rare(rare, lane))


@kernel
def one_rare(rare, lane):
    """Optional features of that chain."""
    if rare is None:
        return None
    return Rare(rare.couplings[lane], rare.drag[lane], rare.dampers[lane], rare.gyrators[lane])


@kernel
def eight_of(bodies, hinges, gravity, rare):
    """All eight chains."""
    return (
        one_of(bodies, hinges, gravity, rare, 0), one_of(bodies, hinges, gravity, rare, 1),
        one_of(bodies, hinges, gravity, rare, 2), one_of(bodies, hinges, gravity, rare, 3),
        one_of(bodies, hinges, gravity, rare, 4), one_of(bodies, hinges, gravity, rare, 5),
        one_of(bodies, hinges, gravity, rare, 6), one_of(bodies, hinges, gravity, rare, 7),
    )  # fmt: skip


@kernel
def forces_side_by_side(chains):
    """Force elements of eight chains with equal hinges, none of them `in_motion`; None for plain chains."""
    if chains[0].rare is None:
        return None
    elements = couplings_side_by_side(chains), rotation_springs_side_by_side(chains)
    return Forces(elements, any_acts(chains[0].rare, elements[1]), empty_lanes((len(chains[0].hinges),)))


@subroutine
def subtract_torques(forces, rows, q, qd, net):
    """Subtract T of all elements from column `net` of the hinges' rows; return the power loss [W]."""
    torque = forces.torque
    for k in range(len(torque)):
        put_at(torque, zero_of(qd), k)
    lost = add_torques(forces.elements, q, qd, torque)
    for k in range(len(torque)):
        put_at(rows, at(rows, k, net) - at(torque, k), k, net)
    return lost
