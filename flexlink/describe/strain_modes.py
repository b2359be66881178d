"""Strain modes of a link: how many shapes of each direction replace the motion of its hinges one by one."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from flexlink.describe.spec import Spec

Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]


class StrainModes(Spec, frozen=True):
    """Numbers of strain modes of a flexible link, by direction; its hinges then move only by these shapes.

    The link's curvature is a sum of shapes, so large deflections are not linearised. The chain keeps all its hinges, as
    stations at which the shapes are evaluated. Fewer coordinates have lower frequencies, so explicit methods can take
    longer steps.

    Examples
    --------
    >>> few = scene.varied({"link.*.segments": 11, "link.*.modes": fl.details.StrainModes(z=2)})
    >>> chain = fl.lump(few)
    >>> print(chain.n, chain.freedoms)  # hinges, coordinates
    22 6
    """

    x: Count = 1
    """Number of modes of twist, with flex = "xyz"."""
    y: Count = 2
    """Number of modes of bending about y, with flex = "yz" or "xyz"."""
    z: Count = 2
    """Number of modes of bending about z."""
    shapes: Literal["eigenmodes", "polynomials"] = "eigenmodes"
    """Shapes: eigenmodes of the link with its distal mass, all other joints locked, or moments that are Legendre
    polynomials along the link."""

    def of_axis(self, axis: int) -> int:
        """Number of modes of a direction: axis 1 twists, 2 and 3 bend about y and z."""
        return (self.x, self.y, self.z)[axis - 1]


def of_number(modes: int | StrainModes | None) -> StrainModes | None:
    """The modes if one number is given for all directions."""
    return StrainModes(x=modes, y=modes, z=modes) if isinstance(modes, int) else modes
