"""Integers that define how `articulated` eliminates the hinges of each body, and where working axes restart.

    group   hinges of the body, all at one point      passed inboard
    slides  prismatic, one after another              J, H, M
    hinges  any, one after another                    J, H, M
    along   one, along the working axis z             J, H, M; along z only the rotor's part, exactly
    pair    Y and Z in either order, without rotors   j, h, M: J = j t tᵀ and H = t hᵀ, t normal to both axes
    triple  X, Y and Z in any order, without rotors   M: J = H = 0
    tip     no hinges, no mass: the tip frame         nothing

Prescribed hinges are handled one after another. Working axes are initially those of frame 0. They restart as the axes
of the body at every single hinge Z that is not exactly along the working axis z. Links that bend in a plane pass on z
without rounding. This matters because the remainder of J along their hinges is small: it stays accurate only if it is
not added to the link's inertia about other axes, which is n³ times the inertia of one of its n segments. A branch
continues in the working axes of its parent body.
"""

import numpy as np

from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import allocating, kernel
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep

LAYOUT = numbered("first stop turned restart group parent begins slot fork loaded next")
"""Integers of a body: its hinges first … stop − 1; 1 if a mount rotates it; 1 if working axes restart at it; its group;
its position in the tree, and 1 if the tip wrench acts on it, as in `BODY`; index of the next body if that is its child,
otherwise the number of bodies."""
GROUP = numbered("slides hinges along pair triple tip")


@kernel
def layout_of(bodies, hinges):
    """Layout of a chain, shape (bodies, LAYOUT.size)."""
    layout = np.zeros((len(bodies), LAYOUT.size), np.int64)
    along = True  # whether z of the current body, before its hinges, is exactly the working axis z
    beyond = np.ones(1 + len(bodies), np.bool_)  # the same after each body, counted from 1, and after the base
    for i in range(len(bodies)):
        b = bodies[i]
        if b.begins:
            along = beyond[b.parent]
        z = b.rotation[:, 2]
        along = along and z[0] == 0.0 and z[1] == 0.0 and z[2] == 1.0
        if b.stop > b.first and hinges[b.first].axis < SLIDES:
            single = b.stop == b.first + 1 and hinges[b.first].axis == 2
            layout[i, LAYOUT.restart] = single and not along
            along = single
        beyond[i + 1] = along
        last = i == len(bodies) - 1 or bodies[i + 1].begins
        keep(layout, i, (b.first, b.stop, b.turned))
        keep(layout, i, (b.parent, b.begins, b.slot, b.fork, b.loaded, len(bodies) if last else i + 1), LAYOUT.parent)
        massless = b.first == b.stop and b.mass == 0.0 and not np.any(b.inertia)
        layout[i, LAYOUT.group] = GROUP.tip if last and b.fork == 0 and massless else group_of(b, hinges)
    return layout


@allocating
def group_of(body, hinges):
    """Group of a body's hinges by the set of their axes, if all axes are different."""
    axes, rotors = 0, False
    if body.stop > body.first and hinges[body.first].axis >= SLIDES:
        return GROUP.slides
    for k in range(body.first, body.stop):
        axis = 1 << hinges[k].axis
        if hinges[k].prescribed or axes & axis:
            return GROUP.hinges
        axes, rotors = axes | axis, rotors or hinges[k].armature != 0.0
    if axes == 0b100:
        return GROUP.along
    if axes == 0b110 and not rotors:
        return GROUP.pair
    if axes == 0b111 and not rotors:
        return GROUP.triple
    return GROUP.hinges


@allocating
def common_layout(layouts):
    """Common layout for chains side by side, from layouts (lanes, bodies, LAYOUT.size) with equal hinges."""
    layout = layouts[0].copy()
    for i in range(len(layout)):
        for lane in range(1, len(layouts)):
            one = layouts[lane, i]
            layout[i, LAYOUT.turned] |= one[LAYOUT.turned]
            layout[i, LAYOUT.restart] |= one[LAYOUT.restart]
            if one[LAYOUT.group] != layout[i, LAYOUT.group]:
                layout[i, LAYOUT.group] = GROUP.hinges
    return layout
