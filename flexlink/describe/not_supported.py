"""What people look for in a scene and do not find: what to do instead, by the words that they use."""

from __future__ import annotations

SLIDING = (
    "sliding joints are not supported, all joints are hinges: fix this one where it stands, with joint.locked = true, "
    "and place the link by mount.xyz"
)
LOOPS = (
    "closed loops are not supported, an arm is one chain from the base to the tip: cut the loop, and let a wrench at "
    "the tip stand for the rest"
)
TREES = (
    "trees are not supported, an arm is one chain: give what hangs on a link as its hub or end, and take one branch a "
    "scene"
)
CONTACT = "contact is not supported: give the force of what is touched as wrench, in time if need be"
HINGES = "all joints are hinges: leave this out, and give their axis"

BY_VALUE = {
    **dict.fromkeys(("prismatic", "sliding", "slide", "slider", "telescopic", "linear", "translational"), SLIDING),
    **dict.fromkeys(("revolute", "continuous", "hinge", "rotational", "rotary"), HINGES),
    **dict.fromkeys(("ball", "spherical", "universal", "free", "floating", "planar", "cylindrical"),
                    "joints of several axes are not supported: give a link without length per axis"),
    "fixed": "a joint that does not move has locked = true",
}  # fmt: skip
BY_KEY = {
    **dict.fromkeys(("prismatic", "slide", "slider", "stroke", "telescope"), SLIDING),
    **dict.fromkeys(("loop", "loops", "closure", "constraint", "constraints", "equality", "parallel"), LOOPS),
    **dict.fromkeys(("parent", "child", "children", "branch", "branches", "tree"), TREES),
    **dict.fromkeys(("contact", "contacts", "collision", "collisions", "ground", "floor", "obstacle", "wall_contact",
                     "friction_ground"), CONTACT),
}  # fmt: skip


def why_not(key: str, value: object) -> str:
    """What to do instead, as the end of a message on an unknown key or a value of the wrong type; empty if unknown."""
    by_value = BY_VALUE.get(value.casefold(), "") if isinstance(value, str) else ""
    found = by_value or BY_KEY.get(key.casefold(), "")
    return f": {found}" if found else ""
