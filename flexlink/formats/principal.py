"""Principal moments and axes of an inertia by Jacobi's method, whose rotations each zero one product of inertia.

The order is cyclic by rows (Golub & Van Loan, Matrix Computations, 8.5.4). All sums have a fixed order, so a file is
the same on every CPU. With LAPACK the last digits, and the axes of nearly equal moments, depend on the BLAS.
"""

import math
from xml.etree import ElementTree as ET

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.rigid import quaternion_from_matrix
from flexlink.common.errors import ArgumentError
from flexlink.common.products import dot
from flexlink.common.types import Array
from flexlink.describe.rigid_body import ROUNDING
from flexlink.formats.document import decimals


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Return the moments in ascending order, and the axes as columns of a rotation R: I = R diag(moments) Rᵀ."""
    I, R = np.array(inertia, dtype=float), np.eye(3)
    negligible = np.finfo(float).eps ** 2 * np.abs(I).max()  # a product this small does not change moments or axes
    sweeps = 5  # convergence is quadratic from sweep 2 on; more sweeps of equal moments only add rounding errors
    for _ in range(sweeps):
        rotated = False
        for j, k in ((0, 1), (0, 2), (1, 2)):
            if abs(I[j, k]) > negligible:
                rotated = True
                _rotate(I, R, j, k)
        if not rotated:
            break
    moments, order = np.diag(I), np.argsort(np.diag(I), kind="stable")
    axes = R[:, order]
    right_handed = dot(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2]) > 0
    return moments[order], axes if right_handed else -axes


def _rotate(I: Array, R: Array, j: int, k: int) -> None:
    """Update I → Jᵀ I J and R → R J in place, with the smaller of the angles that make I_jk zero."""
    τ = (I[k, k] - I[j, j]) / (2 * I[j, k])
    t = math.copysign(1.0, τ) / (abs(τ) + math.hypot(1.0, τ))  # tan(angle)
    c = 1 / math.hypot(1.0, t)
    s, change = t * c, t * I[j, k]
    ends = I[j, j] - change, I[k, k] + change
    for matrix in (I, I.T, R):  # columns of I, rows of I, columns of R
        matrix[:, j], matrix[:, k] = c * matrix[:, j] - s * matrix[:, k], s * matrix[:, j] + c * matrix[:, k]
    (I[j, j], I[k, k]), I[j, k], I[k, j] = ends, 0.0, 0.0


SMALLEST = 1e-15  # kg, kg m²: MuJoCo's mjMINVAL


def _principal(body: np.void) -> tuple[Array, Array]:
    """Return principal moments and axes, accurate to 2e-15; MuJoCo's `fullinertia` has errors of 1e-14.

    MuJoCo replaces axes within 1e-6 of the body's axes by the body's axes, and a centre within 1e-6 m of the body's
    origin by the origin. It does not do so if the axes are in the order Y, Z, X, which is used in these cases.
    """
    I, center = body["inertia"], np.abs(body["center"]).max()
    moments, axes = (np.diag(I), np.eye(3)) if np.array_equal(I, np.diag(np.diag(I))) else principal_axes(I)
    away = np.abs(axes - np.eye(3)).max()
    near = 4e-6  # rotations [rad] and offsets [m] below this are "in these cases"; MuJoCo's limit is 1e-6
    if away < near and (away or 0 < center < near):
        return moments[[1, 2, 0]], axes[:, [1, 2, 0]]
    return moments, axes


def _require_loadable(chain: Chain, body: np.void, moments: Array) -> None:
    """Raise an error for a body that MuJoCo refuses, because MJCF has no other representation of this body."""
    light = body["mass"] < SMALLEST or moments.min() < SMALLEST
    if not light and moments.max() * (1 - ROUNDING) <= _largest_possible(moments):
        return
    joint = int(body["stop"]) - 1
    number = chain.coordinate(joint).link
    link = f"link {chain.link_names[number - 1]!r}" if number else "the base"
    rule = f"requires {SMALLEST:g} or more of each" if light else "accepts no moment larger than the other two together"
    text = f"segment after joint {chain.joint_name(joint)!r}: mass {body['mass']:.3g} kg, principal moments of inertia "
    text += f"{', '.join(f'{moment:.3g}' for moment in moments)} kg m²: MuJoCo {rule}; change section, segments or hub "
    raise ArgumentError(f"{text}of {link} or the payload, or use URDF", id="inertia-impossible")


def _largest_possible(moments: Array) -> float:
    """Return the sum of the two smaller moments, which bounds the largest; it is added in MuJoCo's order."""
    low, middle, _ = np.sort(moments)
    return float(low + middle)


def _inertial(parent: ET.Element, body: np.void, moments: Array, axes: Array) -> None:
    """Write mass, centre and principal moments."""
    ET.SubElement(
        parent, "inertial", mass=decimals([body["mass"]]), pos=decimals(body["center"]),
        quat=decimals(quaternion_from_matrix(axes)), diaginertia=decimals(moments),
    )  # fmt: skip
