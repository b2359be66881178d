"""How `articulated` eliminates the hinges of a body, and where working axes restart: whole numbers of a chain.

    group   hinges of the body, all at one point      passes inward
    slides  that slide, one after another             J, H, M
    hinges  any, one after another                    J, H, M
    along   one, along the working axis z             J, H, M; along z only the rotor's part, to the last bit
    pair    Y and Z in either order, without rotors   j, h, M: J = j t tᵀ and H = t hᵀ, t normal to both axes
    triple  X, Y and Z in any order, without rotors   M: J = H = 0
    tip     none, nor any mass: the frame of the tip  nothing

Hinges of prescribed motion go one after another. Working axes are those of frame 0 and restart, as axes of the body,
at every single hinge Z that is not along the working axis z as it is. Links that bend in a plane carry z on without
rounding: what is left of J along their hinges is small, and stays right only where it does not share its numbers with
the inertia of the link across its plane, which is n³ times that of one of its n segments. A branch goes on in the
working axes of the body that it begins on.
"""

import numpy as np

from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.numbered import numbered

LAYOUT = numbered("first stop turned restart group parent begins slot fork loaded next")
"""Whole numbers of a body: its hinges are first … stop − 1; turned by a mount; working axes restart here; its group;
place in the tree, and whether the tip wrench acts on it, as in `BODY`; number of the body after it if that hangs on it,
otherwise how many bodies there are."""
GROUP = numbered("slides hinges along pair triple tip")


@kernel
def layout_of(bodies, hinges):
    """Layout of a chain, shape (bodies, LAYOUT_SIZE)."""
    layout = np.zeros((len(bodies), LAYOUT.size), np.int64)
    along = True  # whether z of the present body, before it turns, is the working axis z to the last bit
    beyond = np.ones(1 + len(bodies), np.bool_)  # the same of what hangs on a body, from 1, and on the base
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
        layout[i, LAYOUT.first], layout[i, LAYOUT.stop], layout[i, LAYOUT.turned] = b.first, b.stop, b.turned
        layout[i, LAYOUT.parent], layout[i, LAYOUT.begins], layout[i, LAYOUT.slot] = b.parent, b.begins, b.slot
        layout[i, LAYOUT.fork], layout[i, LAYOUT.loaded] = b.fork, b.loaded
        last = i == len(bodies) - 1 or bodies[i + 1].begins
        layout[i, LAYOUT.next] = len(bodies) if last else i + 1
        massless = b.first == b.stop and b.mass == 0.0 and not np.any(b.inertia)
        layout[i, LAYOUT.group] = GROUP.tip if last and b.fork == 0 and massless else group_of(b, hinges)
    return layout


@kernel
def group_of(body, hinges):
    """Group of a body's hinges by their axes, as a set, if they are all different."""
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


@kernel
def common_layout(layouts):
    """Layout that serves chains side by side, layouts of shape (lanes, bodies, LAYOUT_SIZE): alike in their hinges."""
    layout = layouts[0].copy()
    for i in range(len(layout)):
        for lane in range(1, len(layouts)):
            one = layouts[lane, i]
            layout[i, LAYOUT.turned] |= one[LAYOUT.turned]
            layout[i, LAYOUT.restart] |= one[LAYOUT.restart]
            if one[LAYOUT.group] != layout[i, LAYOUT.group]:
                layout[i, LAYOUT.group] = GROUP.hinges
    return layout
