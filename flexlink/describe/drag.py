"""Drag of air, or of another fluid at rest, on a moving link."""

from __future__ import annotations

from typing import Annotated

from flexlink.describe.spec import Positive, Spec, measured_in


class Drag(Spec, frozen=True):
    """Drag on a link that moves across its beam, proportional to speed squared; motion along the beam causes no drag.

    The force per unit length along the section's y and z, with v the velocity of the beam's axis across the link, is

        f_y = −½ ρ c_d b_y |v| v_y        f_z = −½ ρ c_d b_z |v| v_z        ρ = `air_density` of the scene

    by the cross-flow principle (Hoerner 1965, Fluid-Dynamic Drag, chapter 3) in a fluid at rest. The added mass of the
    fluid, π/4 ρ b² per length, is neglected: in air it adds 0.05 % to the mass of a round aluminium bar, and 2 % to the
    mass of an aluminium strip 60 times as wide as thick; in water it is not small.

    Examples
    --------
    >>> round_bar = fl.Drag(coefficient=1.2)  # breadth: the diameter of its section
    >>> panel = fl.Drag(coefficient=2.0, breadth=(0.4, 0.002))  # m, seen along the section's y and z
    >>> moving = fl.lump(scene.varied({"link.upper.drag": panel}))
    >>> print(fl.drag_torque(moving, q, np.ones(chain.n))[0].round(3))  # N m about the first joint, rates of 1 rad/s
    0.398
    """

    coefficient: Positive
    """Drag coefficient c_d [1]: about 1.2 for a round bar, 2 for a flat one."""
    breadth: Annotated[tuple[Positive, Positive] | None, measured_in("m")] = None
    """Breadth of the link, seen along the section's y and along its z [m]. Default: the breadth of its section,
    including taper; required for a general section and for a table of rigidities."""
