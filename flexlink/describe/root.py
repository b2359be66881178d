"""Springs at the root of a link: what clamps its beam, a bearing, a flange, a screwed joint, gives way."""

from __future__ import annotations

from typing import Annotated

from flexlink.describe.spec import NonNegative, Positive, Spec, measured_in


class RootStiffness(Spec, frozen=True):
    """Springs about axes of a link's frame, where its beam begins; about an axis without a number it is rigid.

    They hold what turns at the root against the hub: the moment there is k times the angle, and every axis with a
    spring is a hinge of the chain, of the name `boom.root.z`. A beam of rigidity EI and length L that is clamped so
    stiffly that k L / EI is 100 has a first frequency 2 % lower than one that is clamped rigidly.

    Examples
    --------
    >>> clamp = fl.details.RootStiffness(z=2e4)  # N m/rad
    >>> soft = fl.lump(scene.varied({"link.upper.root_stiffness": clamp}))
    >>> print(soft.joint_names[:3], soft.stiffness[1])
    ('upper', 'upper.root.z', 'upper.1.z') 20000.0
    """

    x: Annotated[Positive | None, measured_in("N m/rad")] = None
    """About the x of the link's frame [N m/rad]. Default: rigid."""
    y: Annotated[Positive | None, measured_in("N m/rad")] = None
    """About the y of the link's frame [N m/rad]. Default: rigid."""
    z: Annotated[Positive | None, measured_in("N m/rad")] = None
    """About the z of the link's frame [N m/rad]. Default: rigid."""


class RootDamping(Spec, frozen=True):
    """Viscous damping of the springs at a link's root, each beside its spring.

    Examples
    --------
    >>> screwed = fl.details.RootDamping(z=1.5)  # N m s/rad
    >>> clamp = {"root_stiffness": fl.details.RootStiffness(z=2e4), "root_damping": screwed}
    >>> print(fl.lump(scene.varied({f"link.upper.{key}": value for key, value in clamp.items()})).damping[1])
    1.5
    """

    x: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """About the x of the link's frame [N m s/rad]."""
    y: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """About the y of the link's frame [N m s/rad]."""
    z: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """About the z of the link's frame [N m s/rad]."""


ROOT_AXES = "xyz"
"""Axes of the springs at a root, in the order in which its hinges stand."""
