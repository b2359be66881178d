"""A rigid body on an arm: a hub, a body at the end of a link, or the payload."""

from typing import Annotated

import numpy as np

from flexlink.common.products import dot, product
from flexlink.common.types import Array
from flexlink.describe.spec import NonNegative, Spec, Vector3, measured_in

ROUNDING = 32 * np.finfo(float).eps
"""Rounding error of principal moments, relative to the largest: one eps for each of three given numbers, 12 for
an earlier rotation I → R I Rᵀ (two products of three terms, and R itself), 12 for the eigenvalues."""


class RigidBody(Spec, frozen=True):
    """Rigid body with `mass` [kg], centre of mass `center` [m] and `inertia` [kg m²] about that centre.

    Centre and axes are in the frame to which the body is fixed: for a hub the link's frame, for an end the end frame of
    the link, for the payload the tip frame. `inertia` has three moments, xx, yy, zz, or six
    numbers, xx, yy, zz and the products xy, xz, yz, the elements of I = ∫ (ρ² 1 − ρ ρᵀ) dm (I_xy = −∫ x y dm, the sign
    convention of URDF).

    A real body has a positive semidefinite covariance ∫ ρ ρᵀ dm = tr(I)/2 · 1 − I, that is, no principal moment exceeds
    the sum of the other two. A body without mass represents pure inertia, such as a rotor's about its axis; then I
    itself is positive semidefinite. Rounded, simplified or identified inertias may violate this by `excess`: they are
    used as given, with a note, if the arm's mass matrix is positive.

    Examples
    --------
    >>> payload = fl.RigidBody(mass=5.0, center=(0.1, 0.0, 0.0), inertia=(0.02, 0.05, 0.05))  # kg, m, kg m²
    >>> print(f"{fl.lump(scene.varied({'tip': payload})).mass:.2f} kg")
    7.15 kg
    """

    mass: Annotated[NonNegative, measured_in("kg")] = 0.0
    """Mass [kg]."""
    center: Annotated[Vector3, measured_in("m")] = (0.0, 0.0, 0.0)
    """Centre of mass in the frame to which the body is fixed [m]."""
    inertia: Annotated[tuple[float, ...], measured_in("kg m²")] = (0.0, 0.0, 0.0)
    """Inertia about the centre of mass [kg m²]: three moments xx, yy, zz, or six numbers xx, yy, zz, xy, xz, yz."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.inertia) not in {3, 6}:
            why = "expected 3 moments, xx, yy, zz, or 6 numbers, xx, yy, zz, xy, xz, yz"
            raise self._refused("inertia", why, "inertia-form")

    @property
    def principal_moments(self) -> tuple[float, ...]:
        """Principal moments of inertia about the centre of mass, ascending [kg m²]."""
        if len(self.inertia) == 3:
            return tuple(sorted(self.inertia))
        return tuple(np.linalg.eigvalsh(self.matrix).tolist())

    @property
    def excess(self) -> float:
        """How far the principal moments are from those of a real body [kg m²]; 0 for a real body, up to rounding.

        With mass: the largest moment minus the sum of the others; without mass: minus the smallest moment.
        """
        if not any(self.inertia):
            return 0.0
        size = max(map(abs, self.inertia))
        low, middle, high = (moment / size for moment in self.principal_moments)
        excess = high - low - middle if self.mass else -low
        return size * excess if excess > ROUNDING * max(abs(low), high) else 0.0

    @property
    def matrix(self) -> Array:
        """Inertia about the centre of mass, shape (3, 3) [kg m²]."""
        xx, yy, zz, xy, xz, yz = (*self.inertia, 0.0, 0.0, 0.0)[:6]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def about(self, axis: Array) -> float:
        """Moment of inertia about an axis (a unit vector) through the origin of the body's frame [kg m²]."""
        arm = np.cross(axis, self.center)
        return dot(axis, product(self.matrix, axis)) + self.mass * dot(arm, arm)
