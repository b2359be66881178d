"""Symmetric 3×3 tensors as tuples (xx, yy, zz, yz, xz, xy)."""

from flexlink.kernels.tools.axes3 import combine
from flexlink.kernels.tools.compiler import inlined
from flexlink.kernels.tools.lanes import vec_of
from flexlink.kernels.tools.vec3 import dot

ZERO6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def symmetric(J):
    """Return the tensor of an array of shape (3, 3)."""
    return (J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1])


@inlined
def sym_of(rows, i, first):
    """Return the tensor stored in row `i` of an array (m, p), with xx in column `first`."""
    a, b = vec_of(rows, i, first), vec_of(rows, i, first + 3)
    return a[0], a[1], a[2], b[0], b[1], b[2]


@inlined
def sym_add(A, B):
    """A + B."""
    return (A[0] + B[0], A[1] + B[1], A[2] + B[2], A[3] + B[3], A[4] + B[4], A[5] + B[5])


@inlined
def sym_apply(A, v):
    """A v."""
    return (
        A[0] * v[0] + A[5] * v[1] + A[4] * v[2],
        A[5] * v[0] + A[1] * v[1] + A[3] * v[2],
        A[4] * v[0] + A[3] * v[1] + A[2] * v[2],
    )


@inlined
def sym_rotate(R, A):
    """R A Rᵀ, for an array R of shape (3, 3), or eight side by side (3, 3, 8)."""
    x, y, z = vec_of(R, 0, 0), vec_of(R, 1, 0), vec_of(R, 2, 0)
    Ax, Ay, Az = sym_apply(A, x), sym_apply(A, y), sym_apply(A, z)
    return (dot(x, Ax), dot(y, Ay), dot(z, Az), dot(y, Az), dot(x, Az), dot(x, Ay))


@inlined
def sym_from_axes(x, y, z, A):
    """R A Rᵀ, for the columns x, y, z of R."""
    p = combine(A[0], x, A[5], y, A[4], z)
    q = combine(A[5], x, A[1], y, A[3], z)
    r = combine(A[4], x, A[3], y, A[2], z)
    return (
        x[0] * p[0] + y[0] * q[0] + z[0] * r[0],
        x[1] * p[1] + y[1] * q[1] + z[1] * r[1],
        x[2] * p[2] + y[2] * q[2] + z[2] * r[2],
        x[1] * p[2] + y[1] * q[2] + z[1] * r[2],
        x[0] * p[2] + y[0] * q[2] + z[0] * r[2],
        x[0] * p[1] + y[0] * q[1] + z[0] * r[1],
    )


@inlined
def sym_add_dyad(A, s, u):
    """A + s u uᵀ."""
    x, y, z = s * u[0], s * u[1], s * u[2]
    return (
        A[0] + x * u[0], A[1] + y * u[1], A[2] + z * u[2], A[3] + y * u[2], A[4] + x * u[2], A[5] + x * u[1],
    )  # fmt: skip


@inlined
def sym_turn(axis, c, s, A):
    """R A Rᵀ for the rotation about a coordinate axis with c = cos θ, s = sin θ."""
    xx, yy, zz, yz, xz, xy = A
    cc, ss, cs = c * c, s * s, c * s
    if axis == 2:
        swing = 2.0 * cs * xy
        return (
            cc * xx + ss * yy - swing, ss * xx + cc * yy + swing, zz,
            s * xz + c * yz, c * xz - s * yz, cs * (xx - yy) + (cc - ss) * xy,
        )  # fmt: skip
    if axis == 1:
        swing = 2.0 * cs * xz
        return (
            cc * xx + ss * zz + swing, yy, ss * xx + cc * zz - swing,
            c * yz - s * xy, cs * (zz - xx) + (cc - ss) * xz, c * xy + s * yz,
        )  # fmt: skip
    swing = 2.0 * cs * yz
    return (
        xx, cc * yy + ss * zz - swing, ss * yy + cc * zz + swing,
        cs * (yy - zz) + (cc - ss) * yz, s * xy + c * xz, c * xy - s * xz,
    )  # fmt: skip


@inlined
def point_inertia(m, d):
    """m (d·d 1 − d dᵀ): inertia of a mass at d."""
    x, y, z = d
    return (
        m * (y * y + z * z), m * (z * z + x * x), m * (x * x + y * y), -m * y * z, -m * x * z, -m * x * y,
    )  # fmt: skip


@inlined
def product_inertia(h, r):
    """2 h·r 1 − h rᵀ − r hᵀ: change of inertia by a displacement r, for a body with first moment h."""
    x, y, z = h[0] * r[0], h[1] * r[1], h[2] * r[2]
    return (
        2.0 * (y + z), 2.0 * (z + x), 2.0 * (x + y),
        -h[1] * r[2] - r[1] * h[2], -h[0] * r[2] - r[0] * h[2], -h[0] * r[1] - r[0] * h[1],
    )  # fmt: skip
