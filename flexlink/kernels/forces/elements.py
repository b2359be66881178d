"""Force elements: what acts on a chain beside inertia, gravity, and the spring and friction of each joint.

All that a chain has is a tuple of records, one of every kind, of a plain chain none at all; each function here is that
of every record, by its type, and the sum of what they return. A new kind is a record with these functions, written into
the tables below and into `in_motion`; its numbers are a structured array of the chain, named in `layout.FORCES`:

    of a chain      (chain) -> record                             its constants and scratch
    torque          (record, q, qd, torque) -> power lost [W]     adds T (n,), which resists as T_FR does
    energy          (record, q) -> V [J]                          of what has a potential
    slopes          (record, q, qd, by_angle, by_rate)            adds ∂T/∂q and ∂T/∂q̇ (n, n)
    brakes          (record, q, qd, brakes)                       adds ∂T_k/∂q̇_k (n,), or less, for implicit steps

None of them makes arrays. Springs and dampers between hinges go eight states side by side, too.
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
from flexlink.kernels.forces.drag import Drag, drag_of, drag_slopes, drag_torque
from flexlink.kernels.forces.rotation_tangent import (
    Rotation,
    rotation_energy,
    rotation_of,
    rotation_side_by_side,
    rotation_slopes,
    rotation_torque,
)
from flexlink.kernels.layout import ChainArrays, Rare
from flexlink.kernels.tools.compiler import kernel, of_each, recursion
from flexlink.kernels.tools.lanes import at, empty_lanes, put_at, zero_of


@recursion
def no_energy(element, q):
    """Of what has no potential [J]."""
    return 0.0


@recursion
def no_brake(element, q, qd, brakes):
    """Of what implicit steps do not count, or count elsewhere."""


class Forces(NamedTuple):
    """All force elements of a chain."""

    elements: Any  # a tuple of records
    torque: Any  # (n,) scratch, or (n, 8)


@of_each({Couplings: coupling_torque, Rotation: rotation_torque, Drag: drag_torque, Dampers: damper_torque})
def add_torques(elements, q, qd, torque):
    """Add T of all elements to `torque` (n,), or (n, 8); returns the power that is lost [W]."""


@of_each({Couplings: coupling_energy, Rotation: rotation_energy, Drag: no_energy, Dampers: no_energy})
def elastic_energy(elements, q):
    """Energy that all elements hold [J]."""


@of_each(
    {Couplings: coupling_slopes, Rotation: rotation_slopes, Drag: drag_slopes, Dampers: damper_slopes}, summed=False
)
def add_slopes(elements, q, qd, by_angle, by_rate):
    """Add the slopes of all elements' T to (n, n) each."""


@of_each({Couplings: no_brake, Rotation: no_brake, Drag: no_brake, Dampers: damper_brakes}, summed=False)
def add_brakes(elements, q, qd, brakes):
    """Add to (n,) the slopes of T by each joint's own rate that implicit steps and their errors are to count."""


@recursion
def find_brakes(forces, q, qd, brakes):
    """Write them (n,)."""
    for k in range(len(brakes)):
        brakes[k] = 0.0
    add_brakes(forces.elements, q, qd, brakes)


@kernel
def forces_of(chain):
    """Those of a chain; None of a plain one."""
    if chain.rare is None:
        return None
    return Forces((couplings_of(chain), rotation_of(chain)) + in_motion(chain), np.empty(len(chain.hinges)))  # noqa: RUF005


@kernel
def in_motion(chain):
    """Those that are no springs between hinges, nor dampers."""
    return drag_of(chain), dampers_of(chain)


@kernel
def motion_torques(chain, qs, qds, found):
    """Add T of those `in_motion` to `found` (b, n), of states (b, n)."""
    elements = in_motion(chain)
    for row in range(len(qs)):
        add_torques(elements, qs[row], qds[row], found[row])


@kernel
def motion_slopes(chain, q, qd, by_angle, by_rate):
    """Add the slopes of T of those `in_motion` to (n, n) each."""
    add_slopes(in_motion(chain), q, qd, by_angle, by_rate)


@kernel
def one_of(bodies, hinges, gravity, rare, lane):
    """One of eight chains, arrays (8, …)."""
    return ChainArrays(bodies[lane], hinges[lane], gravity[lane], one_rare(rare, lane))


@kernel
def one_rare(rare, lane):
    """What is rare of it."""
    if rare is None:
        return None
    return Rare(rare.couplings[lane], rare.drag[lane], rare.dampers[lane])


@kernel
def eight_of(bodies, hinges, gravity, rare):
    """All of them."""
    return (
        one_of(bodies, hinges, gravity, rare, 0), one_of(bodies, hinges, gravity, rare, 1),
        one_of(bodies, hinges, gravity, rare, 2), one_of(bodies, hinges, gravity, rare, 3),
        one_of(bodies, hinges, gravity, rare, 4), one_of(bodies, hinges, gravity, rare, 5),
        one_of(bodies, hinges, gravity, rare, 6), one_of(bodies, hinges, gravity, rare, 7),
    )  # fmt: skip


@kernel
def forces_side_by_side(chains):
    """Those of eight chains, alike in hinges, none of them `in_motion`; None of plain ones."""
    if chains[0].rare is None:
        return None
    elements = couplings_side_by_side(chains), rotation_side_by_side(chains)
    return Forces(elements, empty_lanes((len(chains[0].hinges),)))


@recursion
def subtract_torques(forces, rows, q, qd, net):
    """Subtract T of all elements from column `net` of the rows of the hinges; returns the power that is lost [W]."""
    torque = forces.torque
    for k in range(len(torque)):
        put_at(torque, zero_of(qd), k)
    lost = add_torques(forces.elements, q, qd, torque)
    for k in range(len(torque)):
        put_at(rows, at(rows, k, net) - at(torque, k), k, net)
    return lost
