"""Springs at the root of a link: compliance of the beam's attachment, such as a bearing, flange or screwed joint."""

from __future__ import annotations

from typing import Annotated

from flexlink.describe.spec import NonNegative, Positive, Spec, measured_in


class RootStiffness(Spec, frozen=True):
    """Springs at the beam's root, about axes of the link's frame; the root is rigid about axes without a number.

    Springs connect the beam's root to the hub: the moment is k times the angle. Each axis with a spring adds a hinge to
    the chain, such as `boom.root.z`. For a beam of rigidity EI and length L with k L / EI = 100, the first frequency is
    2 % lower than with a rigid clamp.

    Examples
    --------
    >>> clamp = fl.details.RootStiffness(z=2e4)  # N m/rad
    >>> soft = fl.lump(scene.varied({"link.upper.root_stiffness": clamp}))
    >>> print(soft.joint_names[:3], soft.stiffness[1])
    ('upper', 'upper.root.z', 'upper.1.z') 20000.0
    """

    x: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness about x of the link's frame [N m/rad]. Default: rigid."""
    y: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness about y of the link's frame [N m/rad]. Default: rigid."""
    z: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness about z of the link's frame [N m/rad]. Default: rigid."""


class RootDamping(Spec, frozen=True):
    """Viscous damping of the springs at a link's root, by axis; each axis needs a spring.

    Examples
    --------
    >>> screwed = fl.details.RootDamping(z=1.5)  # N m s/rad
    >>> clamp = {"root_stiffness": fl.details.RootStiffness(z=2e4), "root_damping": screwed}
    >>> print(fl.lump(scene.varied({f"link.upper.{key}": value for key, value in clamp.items()})).damping[1])
    1.5
    """

    x: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """Damping about x of the link's frame [N m s/rad]."""
    y: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """Damping about y of the link's frame [N m s/rad]."""
    z: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """Damping about z of the link's frame [N m s/rad]."""


ROOT_AXES = "xyz"
"""Axes of root springs, in the order of their hinges."""
