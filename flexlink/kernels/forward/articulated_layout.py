"""Which way `articulated` takes out the hinges of a body, and where working axes begin: whole numbers of a chain.

    way     hinges of the body, all at one point      passes inward
    HINGES  any, one after another                    J, H, M
    ALONG   one, along the working axis z             J, H, M; along z only the rotor's part, to the last bit
    PAIR    Y and Z in either order, without rotors   j, h, M: J = j t tᵀ and H = t hᵀ, t normal to both axes
    TRIPLE  X, Y and Z in any order, without rotors   M: J = H = 0
    TIP     none, nor any mass: the frame of the tip  nothing

Hinges of prescribed motion go one after another. Working axes are those of frame 0 and begin anew, as axes of the body,
at every single hinge Z that is not along the working axis z as it is. Links that bend in a plane carry z on without
rounding: what is left of J along their hinges is small, and stays right only where it does not share its numbers with
the inertia of the link across its plane, which is n³ times that of one of its n segments.
"""

import numpy as np

from flexlink.kernels.tools.compiler import kernel

# Whole numbers of a body: its hinges first … stop − 1; turned by a mount; working axes begin anew; way of its hinges.
FIRST, STOP, TURNED, ANEW, WAY, LAYOUT_SIZE = range(6)
HINGES, ALONG, PAIR, TRIPLE, TIP = range(5)


@kernel
def layout_of(bodies, hinges):
    """Layout of a chain, shape (bodies, LAYOUT_SIZE)."""
    layout = np.zeros((len(bodies), LAYOUT_SIZE), np.int64)
    along = True  # whether z of the present body, before it turns, is the working axis z to the last bit
    for i in range(len(bodies)):
        b = bodies[i]
        z = b.rotation[:, 2]
        along = along and z[0] == 0.0 and z[1] == 0.0 and z[2] == 1.0
        if b.stop > b.first:
            single = b.stop == b.first + 1 and hinges[b.first].axis == 2
            layout[i, ANEW] = single and not along
            along = single
        layout[i, FIRST], layout[i, STOP], layout[i, TURNED] = b.first, b.stop, b.turned
        layout[i, WAY] = way_of(b, hinges)
    b = bodies[-1]
    if b.first == b.stop and b.mass == 0.0 and not np.any(b.inertia):
        layout[-1, WAY] = TIP
    return layout


@kernel
def way_of(body, hinges):
    """Way of a body's hinges by their axes, as a set, if they are all different."""
    axes, rotors = 0, False
    for k in range(body.first, body.stop):
        axis = 1 << hinges[k].axis
        if hinges[k].prescribed or axes & axis:
            return HINGES
        axes, rotors = axes | axis, rotors or hinges[k].armature != 0.0
    if axes == 0b100:
        return ALONG
    if axes == 0b110 and not rotors:
        return PAIR
    if axes == 0b111 and not rotors:
        return TRIPLE
    return HINGES


@kernel
def common_layout(layouts):
    """Layout that serves chains side by side, layouts of shape (lanes, bodies, LAYOUT_SIZE): alike in their hinges."""
    layout = layouts[0].copy()
    for i in range(len(layout)):
        for lane in range(1, len(layouts)):
            one = layouts[lane, i]
            layout[i, TURNED] |= one[TURNED]
            layout[i, ANEW] |= one[ANEW]
            if one[WAY] != layout[i, WAY]:
                layout[i, WAY] = HINGES
    return layout
