"""The rigid model of an arm, as used by a controller that ignores bending."""

from __future__ import annotations

from msgspec.structs import replace

from flexlink.common.errors import ArgumentError
from flexlink.common.wording import truncated
from flexlink.describe.link import RIGID, Link
from flexlink.describe.scene import Scene
from flexlink.describe.spec import build_validated


def rigidified(scene: Scene) -> Scene:
    """Return the scene with all links, their roots and gears rigid, so its chain has only the driven joints.

    All masses, joint friction and rotor inertia are unchanged; hinges, their friction and damping are removed. The
    initial angles and rates of the joints remain: `initial.joint_deg`, `rate_deg`, and for prismatic joints `joint_m`,
    `rate_m`.

    Parameters
    ----------
    scene
        The scene.

    Returns
    -------
    Scene
        The rigid scene, without drive, motions and wrench.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene.

    Examples
    --------
    >>> model = fl.lump(fl.rigidified(scene))
    >>> print(model.n, "joints instead of", chain.n)
    2 joints instead of 6
    >>> torque = fl.inverse_dynamics(model, q[chain.active], qd[chain.active], [1.0, 0.0])  # N m, rad/s²
    """
    if not isinstance(scene, Scene):
        raise ArgumentError(
            f"scene = {truncated(scene)}: expected a Scene, got {type(scene).__name__}", id="wrong-type"
        )
    return build_validated(_rigidified, scene)


def _rigidified(scene: Scene) -> Scene:
    links, given = scene.arm.links, scene.initial
    free = [
        position for position, link in zip(scene.joint_positions.tolist(), links, strict=True) if not link.joint.locked
    ]
    # coordinates of a free base, which come first in a chain
    of_base = (given.q or ())[: 6 if scene.arm.base.free else 0]
    q = None if given.q is None else (*of_base, *free)  # a complete state may exceed the limits
    initial = replace(given, q=q, qd=None, passive="zero")
    arm = replace(scene.arm, links=tuple(map(_rigid, links)))
    return Scene(name=scene.name, arm=arm, initial=initial, about=scene.about, gravity=scene.gravity, run=scene.run)


def _rigid(link: Link) -> Link:
    joint = replace(link.joint, gear_stiffness=None, gear_damping=0.0, viscous_lag=0.0)
    return replace(
        link, joint=joint, damping=None, friction=None, root_stiffness=None, root_damping=None, **RIGID
    )  # fmt: skip
