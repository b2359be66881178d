"""Positions of the hinges of an arm's links, by their lumping rules."""

import functools

import numpy as np

from flexlink.common.errors import ArgumentError, SceneError, errors_at
from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.data.documents import is_user_file
from flexlink.describe.arm import Arm
from flexlink.describe.link import ROOT_AXES, Link
from flexlink.describe.schemes.lumping_rules import LumpingRule, lumping_rule


def hinges_of(arm: Arm) -> list[tuple[Array, Array]]:
    """Nodes and weights of every link's lumping rule, shape (segments − 1,) each; empty for a rigid link."""
    if any(is_user_file(link.lumping) for link in arm.links):  # not cached: the file may change
        return _of_all(arm)
    return HINGES(arm.links, None, lambda: _of_all(arm))


HINGES = Memo(64)
"""Cached nodes and weights, keyed by an arm's links; arms that differ only in materials or payload share them."""


def _of_all(arm: Arm) -> list[tuple[Array, Array]]:
    hinges = []
    for k, link in enumerate(arm.links, 1):
        with errors_at(f"{arm.path(k)}.", ArgumentError):
            hinges.append(_hinges_of(link))
    return hinges


def _hinges_of(link: Link) -> tuple[Array, Array]:
    rule = lumping_rule(link.lumping)
    _check_root(link)
    if link.flex == "rigid":
        return np.empty(0), np.empty(0)
    count = link.segments - 1
    try:
        nodes, weights = _placed(rule, count)
    except ArgumentError as error:
        default = ", the default," * (link.lumping == Link(name="any").lumping)
        given = f"segments = {link.segments}, so {count} hinge{'s' * (count != 1)}"
        raise SceneError(f"{given}: rule {link.lumping!r}{default} {error}") from None
    if nodes[0] == 0 and link.root_springs:
        text = "puts a hinge on the springs of root_stiffness, with no inertia between them; use a rule without a "
        text += "hinge at the root, such as 'gauss' or 'gregory'"
        raise SceneError(f"lumping = {link.lumping!r}: {text}", id="hinge-without-inertia")
    if nodes[0] == 0 and not link.joint.backs(link.hub):
        raise SceneError(f"lumping = {link.lumping!r}: puts a hinge on {_bare(link)}", id="hinge-without-inertia")
    if nodes[-1] == 1:
        text = f"lumping = {link.lumping!r}: puts a hinge at the link's end, with no inertia beyond it"
        raise SceneError(text, id="hinge-without-inertia")
    return nodes, weights


def _check_root(link: Link) -> None:
    """Refuse root springs that turn about the same line as a free joint, with no inertia in between."""
    if not link.root_springs:
        return
    axis, lever = link.joint.direction, link.beam.start
    sprung = np.array([name in link.root_springs for name in ROOT_AXES])
    if axis[~sprung].any() or np.cross(axis, lever).any() or link.joint.backs(link.hub):
        return
    text = f"root_stiffness: turns about the axis {truncated(link.joint.axis)} of {_bare(link)}"
    raise SceneError(text, id="root-stiffness-axis")


def _bare(link: Link) -> str:
    """End of a message: the joint or gear before the beam, with no inertia in between, and how to add inertia."""
    between = "with no inertia between the two"
    if link.joint.gear_stiffness is not None:
        remedy = "give the link a hub with inertia about the joint's axis, or leave gear_stiffness out"
        return f"the elastic gear, {between}: the armature is on the motor side; {remedy}"
    return f"the free joint, {between}; lock the joint, or give it an armature or a hub"


@functools.lru_cache(maxsize=64)
def _placed(rule: LumpingRule, count: int) -> tuple[Array, Array]:
    """Nodes and weights, read-only because scenes of a sweep share them."""
    nodes, weights = rule.hinges(count)
    if not ((np.diff(nodes) > 0).all() and np.isfinite([nodes, weights]).all() and (weights > 0).all()):
        text = "has spacings or weights below float64 resolution; use fewer segments or another rule"
        raise ArgumentError(text, id="rule-resolution")
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights
