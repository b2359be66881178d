"""What people look for in a scene and do not find: what to do instead, by the words that they use."""

from __future__ import annotations

SLIDING = (
    "a joint that slides is written joint = { kind = 'prismatic', axis = [1.0, 0.0, 0.0] }; telescopes are stages of "
    "constant length on such joints, a beam that slides out of a guide is another mechanism"
)
LOOPS = (
    "closed loops are not supported, an arm is a chain or a tree from the base outward: cut the loop, and let a wrench "
    "at the tip stand for the rest"
)
TREES = "a link names the one that it hangs on, on = 'torso'; by default it is the one before it in the list"
FLOATING = "a base that floats is written base = { kind = 'free', mass = 100.0, inertia = [10.0, 10.0, 10.0] }"
CONTACT = "contact is not supported: give the force of what is touched as wrench, in time if need be"
DRAG = "drag of the air is written link.NAME.drag = { coefficient = 1.2 }, of a density air_density = 1.225"
HINGES = "a joint turns unless its kind is 'prismatic': leave this out, and give its axis"

BY_VALUE = {
    **dict.fromkeys(("prismatic", "sliding", "slide", "slider", "telescopic", "linear", "translational"), SLIDING),
    **dict.fromkeys(("revolute", "continuous", "hinge", "rotational", "rotary"), HINGES),
    **dict.fromkeys(("ball", "spherical", "universal", "planar", "cylindrical"),
                    "joints of several axes are not supported: give a link without length per axis"),
    **dict.fromkeys(("free", "floating", "freejoint", "free_flyer"), FLOATING),
    "fixed": "a joint that does not move has locked = true",
}  # fmt: skip
BY_KEY = {
    **dict.fromkeys(("prismatic", "slide", "slider", "stroke", "telescope"), SLIDING),
    **dict.fromkeys(("loop", "loops", "closure", "constraint", "constraints", "equality", "parallel",
                     "weld", "welds", "closed", "connect", "loop_joint"), LOOPS),
    **dict.fromkeys(("free_base", "floating_base", "floating"), FLOATING),
    **dict.fromkeys(("parent", "child", "children", "branch", "branches", "tree"), TREES),
    **dict.fromkeys(("contact", "contacts", "collision", "collisions", "ground", "floor", "obstacle", "wall_contact",
                     "friction_ground"), CONTACT),
    **dict.fromkeys(("air", "air_drag", "drag_coefficient", "aerodynamics", "fluid", "density", "wind"), DRAG),
}  # fmt: skip


def why_not(key: str, value: object) -> str:
    """What to do instead, as the end of a message on an unknown key or a value of the wrong type; empty if unknown."""
    by_value = BY_VALUE.get(value.casefold(), "") if isinstance(value, str) else ""
    found = by_value or BY_KEY.get(key.casefold(), "")
    return f": {found}" if found else ""
