"""Drag of air, or of another fluid at rest, on a link that moves through it."""

from __future__ import annotations

from typing import Annotated

from flexlink.describe.spec import Positive, Spec, measured_in


class Drag(Spec, frozen=True):
    """Drag against motion across a link, in proportion to the square of its speed; motion along it meets none.

    Per length of the beam, v the velocity of its axis across the link, along the section's y and z,

        f_y = −½ ρ c_d b_y |v| v_y        f_z = −½ ρ c_d b_z |v| v_z        ρ = `air_density` of the scene

    the cross-flow principle (Hoerner 1965, Fluid-Dynamic Drag, chapter 3), of a fluid at rest. What the fluid adds to
    the inertia, π/4 ρ b² per length, is left out: in air 0.05 % of a round bar of aluminium, 2 % of a strip of it that
    is 60 times as broad as thick; in water it is not small.

    Examples
    --------
    >>> round_bar = fl.Drag(coefficient=1.2)  # breadth: the diameter of its section
    >>> panel = fl.Drag(coefficient=2.0, breadth=(0.4, 0.002))  # m, seen along the section's y and along its z
    >>> moving = fl.lump(scene.varied({"link.upper.drag": panel}))
    >>> print(fl.drag_torque(moving, q, np.ones(chain.n))[0].round(3))  # N m about the first joint, rates of 1 rad/s
    0.398
    """

    coefficient: Positive
    """Drag coefficient c_d [1]: about 1.2 of a round bar, 2 of a flat one."""
    breadth: Annotated[tuple[Positive, Positive] | None, measured_in("m")] = None
    """How broad the link is, seen along the section's y and along its z [m]. Default: as its section, which tapers
    with it; a general section and a table of rigidities have none."""
