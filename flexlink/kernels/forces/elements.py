"""Force elements: what acts on a chain beside inertia, gravity, and the spring and friction of each joint.

All that a chain has is a tuple of records, one of every kind, of a plain chain none at all; each function here is that
of every record, by its type, and the sum of what they return. A new kind is a record with these functions:

    of a chain      record                                        its constants and scratch
    side by side    record of eight chains                        where eight states may go at once
    torque          (record, q, qd, torque) -> power lost [W]     adds T (n,), which resists as T_FR, or of eight states
    energy          (record, q) -> V [J]                          of what has a potential
    slopes          (record, q, qd, by_angle, by_rate)            adds dT/dq and dT/dqd (n, n)
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
from flexlink.kernels.forces.drag import Drag, drag_of, drag_slopes, drag_torque, no_energy
from flexlink.kernels.forces.rotation_tangent import (
    Rotation,
    rotation_energy,
    rotation_of,
    rotation_side_by_side,
    rotation_slopes,
    rotation_torque,
)
from flexlink.kernels.tools.compiler import kernel, of_each, recursion
from flexlink.kernels.tools.lanes import at, empty_lanes, put_at, zero_of


class Forces(NamedTuple):
    """All force elements of a chain."""

    elements: Any  # a tuple of records
    torque: Any  # (n,) scratch, or (n, 8)


@of_each({Couplings: coupling_torque, Rotation: rotation_torque, Drag: drag_torque})
def add_torques(elements, q, qd, torque):
    """Add T of all elements to `torque` (n,), or (n, 8); returns the power that is lost [W]."""


@of_each({Couplings: coupling_energy, Rotation: rotation_energy, Drag: no_energy})
def elastic_energy(elements, q):
    """Energy that all elements hold [J]."""


@of_each({Couplings: coupling_slopes, Rotation: rotation_slopes, Drag: drag_slopes}, summed=False)
def add_slopes(elements, q, qd, by_angle, by_rate):
    """Add the slopes of all elements' T to (n, n) each."""


@kernel
def forces_of(chain):
    """Those of a chain; None of a plain one."""
    if chain.rare is None:
        return None
    return Forces((couplings_of(chain), rotation_of(chain), drag_of(chain)), np.empty(len(chain.hinges)))


@kernel
def forces_side_by_side(chains):
    """Those of eight chains, alike in hinges, without drag; None of plain ones."""
    if chains[0].rare is None:
        return None
    elements = couplings_side_by_side(chains), rotation_side_by_side(chains)
    return Forces(elements, empty_lanes((len(chains[0].hinges),)))


@kernel
def force_slopes(chain, q, qd, by_angle, by_rate):
    """Add the slopes of T of a chain that is not plain, at one state."""
    add_slopes(forces_of(chain).elements, q, qd, by_angle, by_rate)


@kernel
def force_torques(chain, q, qd, torque):
    """Add T of a chain that is not plain, at one state."""
    add_torques(forces_of(chain).elements, q, qd, torque)


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
