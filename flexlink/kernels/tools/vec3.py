"""3-vectors as tuples, which are readable and, by measurement, as fast as hand-expanded scalars."""

from flexlink.kernels.tools.compiler import inlined
from flexlink.kernels.tools.lanes import at

ZERO = (0.0, 0.0, 0.0)


@inlined
def vector(a):
    """The first three numbers of an array as a tuple."""
    return (a[0], a[1], a[2])


@inlined
def add(a, b):
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@inlined
def sub(a, b):
    """a − b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inlined
def add_scaled(a, s, b):
    """a + s b."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@inlined
def put(field, a):
    """Write a vector into an array of shape (3,)."""
    field[0], field[1], field[2] = a


@inlined
def scale(s, a):
    """s a."""
    return (s * a[0], s * a[1], s * a[2])


@inlined
def dot(a, b):
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inlined
def apply(R, a):
    """R a, for an array R of shape (3, 3), or eight side by side (3, 3, 8)."""
    return (
        at(R, 0, 0) * a[0] + at(R, 0, 1) * a[1] + at(R, 0, 2) * a[2],
        at(R, 1, 0) * a[0] + at(R, 1, 1) * a[1] + at(R, 1, 2) * a[2],
        at(R, 2, 0) * a[0] + at(R, 2, 1) * a[1] + at(R, 2, 2) * a[2],
    )


@inlined
def apply_transposed(R, a):
    """Rᵀ a, for an array R of shape (3, 3)."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )
