"""The rigid model of an arm, as used by a controller that ignores bending."""

from __future__ import annotations

import warnings

from msgspec.structs import replace

from flexlink.common.errors import ArgumentError, Diagnostic
from flexlink.common.wording import short_list, truncated
from flexlink.describe.link import RIGID, Link
from flexlink.describe.scene import Scene
from flexlink.describe.spec import build_validated


def rigidified(scene: Scene) -> Scene:
    """Return the scene with all links, their roots and gears rigid, so its chain has only the driven joints.

    All masses, joint friction and rotor inertia are unchanged; hinges, their friction and damping are removed. The
    initial angles and rates of the joints remain: `initial.joint_deg`, `rate_deg`, and for prismatic joints `joint_m`,
    `rate_m`. Drive, motions, wrench and sensors remain as well, except strain gauges: a warning names them.

    Parameters
    ----------
    scene
        The scene.

    Returns
    -------
    Scene
        The rigid scene.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene.

    Examples
    --------
    >>> model = fl.lump(fl.rigidified(scene))
    >>> print(model.n, "joints instead of", chain.n)
    2 joints instead of 6
    >>> stiff = fl.simulate(fl.rigidified(scene))  # the same task, without bending
    >>> torque = fl.inverse_dynamics(model, q[chain.active], qd[chain.active], [1.0, 0.0])  # N m, rad/s²
    """
    if not isinstance(scene, Scene):
        raise ArgumentError(
            f"scene = {truncated(scene)}: expected a Scene, got {type(scene).__name__}", id="wrong-type"
        )
    gauges = [sensor.name for sensor in scene.sensor if sensor.kind == "strain"]
    if gauges:
        text = f"{scene.name}: strain gauges left out: {short_list(gauges)}; rigid links do not bend; read run.loads"
        warnings.warn(Diagnostic(text, id="strain-gauges-left-out"), UserWarning, stacklevel=2)
    kept = {name: getattr(scene, name) for name in ("drive", "motion", "wrench")}
    sensors = tuple(sensor for sensor in scene.sensor if sensor.kind != "strain")
    rigid: Scene = build_validated(replace, bare_and_rigid(scene), sensor=sensors, **kept)
    return rigid


def bare_and_rigid(scene: Scene) -> Scene:
    """The rigid scene without drive, motions, wrench and sensors, as control laws use it."""
    return build_validated(_bare_and_rigid, scene)


def _bare_and_rigid(scene: Scene) -> Scene:
    links, given = scene.arm.links, scene.initial
    free = [
        position for position, link in zip(scene.joint_positions.tolist(), links, strict=True) if not link.joint.locked
    ]
    # coordinates of a free base, which come first in a chain
    of_base = (given.q or ())[: 6 if scene.arm.base.free else 0]
    q = None if given.q is None else (*of_base, *free)  # a complete state may exceed the limits
    kept = {name: getattr(scene, name) for name in ("name", "about", "gravity", "air_density", "run")}
    initial = replace(given, q=q, qd=None, passive="zero")
    return Scene(arm=replace(scene.arm, links=tuple(map(_rigid, links))), initial=initial, **kept)


def _rigid(link: Link) -> Link:
    joint = replace(link.joint, gear_stiffness=None, gear_damping=0.0, viscous_lag=0.0)
    return replace(link, joint=joint, root_stiffness=None, root_damping=None, **RIGID)
