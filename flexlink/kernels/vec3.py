"""Vectors of three as tuples: measured as fast as hand-expanded scalars, and readable."""

import math

from flexlink.kernels.compiler import kernel

ZERO = (0.0, 0.0, 0.0)


@kernel
def vector(a):
    return (a[0], a[1], a[2])


@kernel
def add(a, b):
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale(s, a):
    return (s * a[0], s * a[1], s * a[2])


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def apply(R, a):
    """R a, for an array R of shape (3, 3)."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@kernel
def apply_transposed(R, a):
    """Rᵀ a, for an array R of shape (3, 3)."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@kernel
def unit(axis):
    """Unit vector of a coordinate axis 0, 1, 2."""
    if axis == 2:
        return (0.0, 0.0, 1.0)
    if axis == 1:
        return (0.0, 1.0, 0.0)
    return (1.0, 0.0, 0.0)


@kernel
def turn(axis, c, s, a):
    """R_axis(θ) a with c = cos θ, s = sin θ: components in the frame before the hinge. No product with 0 or 1."""
    if axis == 2:
        return (c * a[0] - s * a[1], s * a[0] + c * a[1], a[2])
    if axis == 1:
        return (c * a[0] + s * a[2], a[1], c * a[2] - s * a[0])
    return (a[0], c * a[1] - s * a[2], s * a[1] + c * a[2])


@kernel
def add_along(axis, x, a):
    """a + x e_axis."""
    if axis == 2:
        return (a[0], a[1], a[2] + x)
    if axis == 1:
        return (a[0], a[1] + x, a[2])
    return (a[0] + x, a[1], a[2])


@kernel
def cross_unit(a, axis):
    """a × e_axis."""
    if axis == 2:
        return (a[1], -a[0], 0.0)
    if axis == 1:
        return (-a[2], 0.0, a[0])
    return (0.0, a[2], -a[1])


@kernel
def cos_sin(angle):
    return (math.cos(angle), math.sin(angle))
