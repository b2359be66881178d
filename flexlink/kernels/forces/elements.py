"""Force elements: forces on a chain besides inertia, gravity, and the spring and friction of each joint.

The force elements of a chain are a tuple with one record of every kind; a plain chain has no tuple. Each function here
selects a function by the type of each record, calls it and adds up the results. A record is an array of rows of the
chain, of a dtype in `layout.FORCES`, or is made of the chain, with constants and scratch. To add a new kind, write the
functions below for it, and enter it in `KINDS`, `in_motion`, `any_acts` and `one_rare`:

    torque          (record, q, qd, torque) -> power [W]          adds T (n,), with the sign of T_FR; dissipated power
    energy          (record, q) -> V [J]                          if the law has a potential; T_FL then includes it
    slopes          (record, q, qd, by_angle, by_rate)            adds ∂T/∂q and ∂T/∂q̇ (n, n)
    own slopes      (record, q, qd, own)                          adds ∂T_k/∂q_k, ∂T_k/∂q̇_k (2, n) for implicit steps

These functions allocate no arrays. The slopes may have a separate record with more scratch. A law with internal states
is made of internal coordinates and gyrators (`joint_laws`). Springs and dampers between hinges also work on eight
states at once, one per SIMD lane.
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
from flexlink.kernels.forces.drag import Drag, DragSlopes, drag_of, drag_slopes, drag_slopes_of, drag_torque
from flexlink.kernels.forces.joint_laws import (
    damper_own_slopes,
    damper_slopes,
    damper_torque,
    gyrator_slopes,
    gyrator_torque,
    hardening_energy,
    hardening_own_slopes,
    hardening_slopes,
    hardening_torque,
)
from flexlink.kernels.forces.rotation_springs import (
    RotationSprings,
    rotation_energy,
    rotation_of,
    rotation_springs_side_by_side,
    rotation_torque,
)
from flexlink.kernels.forces.rotation_tangent import RotationTangent, rotation_slopes, rotation_tangent
from flexlink.kernels.layout import FORCES, ChainArrays, Rare
from flexlink.kernels.tools.compiler import allocating, kernel, of_each, recursion, subroutine
from flexlink.kernels.tools.lanes import at, empty_lanes, put_at


class Forces(NamedTuple):
    """All force elements of a chain."""

    elements: Any  # a tuple of records
    act: bool  # whether the chain has at least one element
    torque: Any  # (n,) scratch, or (n, 8)


class Slopes(NamedTuple):
    """Derivatives of the torques of all force elements."""

    elements: Any  # a tuple of records
    act: bool
    found: Any  # (2, n, n) ∂T/∂q and ∂T/∂q̇; (2, 0, 0) without force elements


class Kind(NamedTuple):
    """Functions of a kind of force element, and types of its records for torques and for slopes; None: rows."""

    torque: Any
    slopes: Any
    energy: Any = None
    own_slopes: Any = None
    record: type | None = None
    tangent: type | None = None


KINDS = {
    "couplings": Kind(coupling_torque, coupling_slopes, coupling_energy, None, Couplings, Couplings),
    "rotation": Kind(rotation_torque, rotation_slopes, rotation_energy, None, RotationSprings, RotationTangent),
    "drag": Kind(drag_torque, drag_slopes, None, None, Drag, DragSlopes),
    "dampers": Kind(damper_torque, damper_slopes, None, damper_own_slopes),
    "gyrators": Kind(gyrator_torque, gyrator_slopes),
    "hardening": Kind(hardening_torque, hardening_slopes, hardening_energy, hardening_own_slopes),
}
"""All kinds by the names of `layout.FORCES`; "rotation" consists of springs of hinges."""
POTENTIALS = frozenset(name for name, kind in KINDS.items() if kind.energy)
"""Names of the kinds with a potential: their torques belong to T_FL."""


def functions(part: str, record: str = "record") -> dict[Any, Any]:
    """The functions of all kinds that have this part, by the types of their records or the dtypes of their rows."""
    each = ((getattr(kind, record) or FORCES[name], getattr(kind, part)) for name, kind in KINDS.items())
    return {key: function for key, function in each if function}


@of_each(functions("torque"))
def add_torques(elements, q, qd, torque):
    """Add T of all elements to `torque` (n,), or (n, 8); returns the dissipated power [W]."""


@of_each(functions("energy"), optional=True)
def elastic_energy(elements, q):
    """Elastic energy of all elements [J]."""


@of_each(functions("slopes", "tangent"), summed=False)
def add_slopes(elements, q, qd, by_angle, by_rate):
    """Add ∂T/∂q and ∂T/∂q̇ of all elements to `by_angle` and `by_rate`, (n, n) each."""


@of_each(functions("own_slopes"), summed=False, optional=True)
def add_own_slopes(elements, q, qd, own):
    """Add to `own` (2, n) the ∂T_k/∂q_k and ∂T_k/∂q̇_k that implicit steps and error norms take into account."""


@recursion
def find_own_slopes(forces, q, qd, own):
    """Write the slopes of `add_own_slopes` to `own` (2, n)."""
    own[:] = 0.0
    if forces.act:
        add_own_slopes(forces.elements, q, qd, own)


@recursion
def find_slopes(slopes, q, qd):
    """Write ∂T/∂q and ∂T/∂q̇ of all elements to `slopes.found`."""
    if slopes.act:
        slopes.found[:] = 0.0
        add_slopes(slopes.elements, q, qd, slopes.found[0], slopes.found[1])


@kernel
def forces_of(chain):
    """The force elements of a chain; None for a plain chain."""
    if chain.rare is None:
        return None
    elements = (couplings_of(chain.rare.couplings, chain.hinges), rotation_of(chain)) + in_motion(chain)  # noqa: RUF005
    return Forces(elements, any_acts(chain.rare, elements[1]), np.empty(len(chain.hinges)))


@recursion
def any_acts(rare, rotation):
    """Whether a chain has a force element."""
    springs = len(rare.couplings) > 0 or len(rotation.hinges) > 0
    return springs or len(rare.drag) + len(rare.dampers) + len(rare.gyrators) + len(rare.hardening) > 0


@allocating
def force_slopes_of(chain, forces):
    """Scratch for the derivatives of the force elements of a chain; None for a plain chain."""
    if forces is None:
        return None
    springs = forces.elements[0], rotation_tangent(forces.elements[1])
    elements = springs + (drag_slopes_of(chain),) + forces.elements[3:]  # noqa: RUF005
    n = len(chain.hinges) if forces.act else 0
    return Slopes(elements, forces.act, np.empty((2, n, n)))


@allocating
def in_motion(chain):
    """The elements that are not couplings or springs of rotation vectors; the first one is drag."""
    return drag_of(chain), chain.rare.dampers, chain.rare.gyrators, chain.rare.hardening


@kernel
def motion_torques(chain, qs, qds, found):
    """Add T of the elements of `in_motion` at states (b, n) to `found` (b, n)."""
    elements = in_motion(chain)
    for row in range(len(qs)):
        add_torques(elements, qs[row], qds[row], found[row])


@kernel
def motion_slopes(chain, q, qd, by_angle, by_rate):
    """Add ∂T/∂q and ∂T/∂q̇ of the elements of `in_motion` to `by_angle` and `by_rate`, (n, n) each."""
    add_slopes((drag_slopes_of(chain),) + in_motion(chain)[1:], q, qd, by_angle, by_rate)  # noqa: RUF005


@allocating
def one_of(chains, lane):
    """Chain number `lane` of eight chains, whose arrays have shape (8, …)."""
    return ChainArrays(chains.bodies[lane], chains.hinges[lane], chains.gravity[lane], one_rare(chains.rare, lane))


@allocating
def one_rare(rare, lane):
    """The optional features of chain number `lane` of eight; None for plain chains."""
    if rare is None:
        return None
    return Rare(rare.couplings[lane], rare.drag[lane], rare.dampers[lane], rare.gyrators[lane], rare.hardening[lane])


@allocating
def forces_side_by_side(chains):
    """The springs of eight chains (8, …) with the same hinges, without the elements of `in_motion`; None if plain."""
    if chains.rare is None:
        return None
    elements = couplings_side_by_side(chains), rotation_springs_side_by_side(chains)
    return Forces(elements, any_acts(one_rare(chains.rare, 0), elements[1]), empty_lanes((chains.hinges.shape[1],)))


@subroutine
def subtract_torques(forces, rows, q, qd, net):
    """Subtract T of all elements from column `net` of the hinge rows; returns the dissipated power [W]."""
    torque = forces.torque
    torque[:] = 0.0
    lost = add_torques(forces.elements, q, qd, torque)
    for k in range(len(torque)):
        put_at(rows, at(rows, k, net) - at(torque, k), k, net)
    return lost
