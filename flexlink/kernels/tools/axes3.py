"""Turns about coordinate axes, and sums of three axes, the columns of a rotation matrix."""

import math

from flexlink.kernels.tools.compiler import inlined

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@inlined
def combine(x, a, y, b, z, c):
    """x a + y b + z c."""
    return (x * a[0] + y * b[0] + z * c[0], x * a[1] + y * b[1] + z * c[1], x * a[2] + y * b[2] + z * c[2])


@inlined
def combine2(x, a, y, b):
    """x a + y b."""
    return (x * a[0] + y * b[0], x * a[1] + y * b[1], x * a[2] + y * b[2])


@inlined
def unit(axis):
    """Unit vector of a coordinate axis 0, 1, 2."""
    if axis == 2:
        return (0.0, 0.0, 1.0)
    if axis == 1:
        return (0.0, 1.0, 0.0)
    return (1.0, 0.0, 0.0)


@inlined
def turn(axis, c, s, a):
    """R_axis(θ) a with c = cos θ, s = sin θ: components in the frame before the hinge, without products with 0 or 1."""
    if axis == 2:
        return (c * a[0] - s * a[1], s * a[0] + c * a[1], a[2])
    if axis == 1:
        return (c * a[0] + s * a[2], a[1], c * a[2] - s * a[0])
    return (a[0], c * a[1] - s * a[2], s * a[1] + c * a[2])


@inlined
def add_along(axis, x, a):
    """a + x e_axis."""
    if axis == 2:
        return (a[0], a[1], a[2] + x)
    if axis == 1:
        return (a[0], a[1] + x, a[2])
    return (a[0] + x, a[1], a[2])


@inlined
def cross_unit(a, axis, zero):
    """a × e_axis; `zero` has the type of a's components."""
    if axis == 2:
        return (a[1], -a[0], zero)
    if axis == 1:
        return (-a[2], zero, a[0])
    return (zero, a[2], -a[1])


@inlined
def cos_sin(angle):
    """Cosine and sine of an angle [rad]."""
    return (math.cos(angle), math.sin(angle))


@inlined
def turn_axes(axis, c, s, x, y, z):
    """The columns x, y, z of R after R ← R R_axis(θ)."""
    if axis == 2:
        return combine2(c, x, s, y), combine2(c, y, -s, x), z
    if axis == 1:
        return combine2(c, x, -s, z), y, combine2(c, z, s, x)
    return x, combine2(c, y, s, z), combine2(c, z, -s, y)


@inlined
def rotate(a, x, y, z):
    """R a, for the columns x, y, z of R."""
    return combine(a[0], x, a[1], y, a[2], z)


@inlined
def place_axes(R, x, y, z):
    """The columns x, y, z after a constant rotation by an array R of shape (3, 3): (x y z) ← (x y z) R."""
    return (
        combine(R[0, 0], x, R[1, 0], y, R[2, 0], z),
        combine(R[0, 1], x, R[1, 1], y, R[2, 1], z),
        combine(R[0, 2], x, R[1, 2], y, R[2, 2], z),
    )


@inlined
def pick(axis, x, y, z):
    """Return x, y or z for `axis` = 0, 1 or 2."""
    return z if axis == 2 else (y if axis == 1 else x)
