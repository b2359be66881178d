"""notes(scene): what is legal but likely not meant; defaults(scene): what decides a run unsaid."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.chain.arguments import require_type
from flexlink.chain.lumping import lump
from flexlink.describe.hinges import hinges_of
from flexlink.describe.joint import Joint
from flexlink.describe.link import Link
from flexlink.describe.run_settings import DEFAULT_TOLERANCE
from flexlink.describe.scene import Scene
from flexlink.dynamics.start_notes import balance, slack_springs, unheld_joints
from flexlink.dynamics.terms import elastic_torque

ENOUGH = 3
"""Hinges of a link through whose strains a parabola goes, as that of a uniform load."""


def notes(scene: Scene) -> tuple[str, ...]:
    """What is likely not meant: what has no effect, and how the arm starts; key, value, cause, what to change.

    Parameters
    ----------
    scene
        The scene; its chain is built, nothing is solved.

    Returns
    -------
    tuple of str
        One line each, empty if there is nothing to say.

    Raises
    ------
    ArgumentError
        `scene` is no Scene.
    """
    require_type("scene", scene, Scene)
    starts = _stillness, slack_springs, unheld_joints, balance
    idle = _stiff_static, _idle_drive, _idle_link_keys, _centers_of_nothing, _beside_the_arm, _falling_base, _few_hinges
    with np.errstate(all="ignore"):  # numbers beyond float64 are refused where a run is made of them
        return tuple(note for each in (*starts, *idle) for note in each(scene))


def defaults(scene: Scene) -> tuple[str, ...]:
    """What a scene leaves to defaults that decide what comes out: the steps of a run without a word on them.

    Parameters
    ----------
    scene
        The scene.

    Returns
    -------
    tuple of str
        One line each, empty if there is nothing to say.
    """
    run = scene.run
    if run.duration == 0 or (run.step is not None or run.has_tolerance):
        return ()
    if not run.by_default:
        return (f"run: no step given; fixed ones of {run.fixed_step:g} s by {run.method}, unless a tolerance is given",)
    chain = lump(scene)
    tolerance, of = run.tolerance_within(chain.size), f"{DEFAULT_TOLERANCE:g} of the {chain.size_name}"
    length = f"{1e3 * tolerance:.3g} mm"
    if not chain.reach:
        of += f", {chain.size:.3g} m"
    if not chain.has_levers:
        length = f"{tolerance / chain.size:.3g} rad or {length}"
    return (f"run: no step given; tolerance {length} ({of}), method auto",)


def _stillness(scene: Scene) -> Iterator[str]:
    """Gravity along all hinge axes turns none of them; with nothing else that pushes, a run shows an arm at rest."""
    g = np.array(scene.gravity) / (np.abs(scene.gravity).max() or 1.0)
    pushed = [
        *scene.joint_rates, scene.wrench.acts, *(scene.drive.torque or ()),
        *np.ravel(scene.drive.torques or ()), *(scene.drive.kp or ()), len(scene.motion),
    ]  # fmt: skip
    if any(pushed) or not g.any() or any(scene.arm.slides) or scene.arm.base.free:
        return
    chain = lump(scene)
    sprung = scene.initial.q is not None and bool(elastic_torque(chain, scene.initial.q).any())
    if not sprung and chain.all_axes_parallel_to(g / np.linalg.norm(g)):
        yield (
            f"gravity = {list(scene.gravity)}: is parallel to the axes of all joints and moves none, and nothing else "
            "moves them; turn gravity, or the first joint by link.1.joint.axis"
        )


def _stiff_static(scene: Scene) -> Iterator[str]:
    if scene.initial.passive == "static" and not any(link.elastic for link in scene.arm.links):
        yield "initial.passive = 'static': has no effect, no link bends"


def _idle_drive(scene: Scene) -> Iterator[str]:
    """A prescribed joint takes what torque it needs, whatever the drive says."""
    drive = scene.drive
    for motion in scene.motion:
        k = scene.arm.number(motion.link) - 1
        keys = ["torque"] if drive.torque and drive.torque[k] else []
        keys += ["torques"] if any(row[k] for row in drive.torques or ()) else []
        for key in keys:
            yield f"drive.{key}: has no effect on {motion.link!r}, whose motion is prescribed"


def _beside_the_arm(scene: Scene) -> Iterator[str]:
    """Of several tips the last link's is the arm's: unlikely where it has no length, as a wheel or a thruster."""
    arm, last = scene.arm, scene.arm.links[-1]
    if len(arm.tips) < 2 or any(last.stop) or last.line is not None:
        return
    others = ", ".join(repr(arm.links[number - 1].name) for number in arm.tips[:-1])
    where = f"at {last.name!r}, the last link, which has no length; other tips: {others}"
    if arm.tip.mass or any(arm.tip.inertia):
        yield f"tip: the payload is {where}; put it into another link's end, or list that link last"
    if scene.wrench.acts and not scene.wrench.on:
        yield f"wrench: acts {where}; wrench.on names another"


def _falling_base(scene: Scene) -> Iterator[str]:
    """In orbit nothing falls; that gravity is there by default is easily forgotten."""
    if scene.arm.base.free and any(scene.gravity) and not scene.wrench.acts:
        yield f"gravity = {list(scene.gravity)}: nothing holds the free base, which falls; in an orbit it is [0, 0, 0]"


def _few_hinges(scene: Scene) -> Iterator[str]:
    """A moment that is a parabola along a link, of its weight and loads, takes three hinges."""
    placed = hinges_of(scene.arm)
    for sensor in scene.sensor:
        if sensor.kind == "strain" and (found := len(placed[scene.arm.number(sensor.link) - 1][0])) < ENOUGH:
            course = "one, so its strain is even" if found == 1 else "two, so its strain runs straight"
            yield f"sensor.{sensor.name}: of hinges link {sensor.link!r} has {course}; take 5 segments or more"


def _centers_of_nothing(scene: Scene) -> Iterator[str]:
    bodies = {"tip": scene.arm.tip}
    for k, link in enumerate(scene.arm.links, 1):
        path = scene.arm.path(k)
        bodies |= {f"{path}.hub": link.hub, f"{path}.end": link.end}
    for key, body in bodies.items():
        if any(body.center) and not body.mass:
            yield f"{key}.center = {body.center!r}: has no effect, the body has no mass"


def _idle_link_keys(scene: Scene) -> Iterator[str]:
    for k, link in enumerate(scene.arm.links, 1):
        for key, value, why in _idle(link):
            yield f"{scene.arm.path(k)}.{key} = {value!r}: has no effect, {why}"


def _idle(link: Link) -> Iterator[tuple[str, object, str]]:
    if link.flex == "rigid" and link.damping is not None:
        yield "damping.ratio", link.damping.ratio, f"{link.name!r} is rigid"
    if link.flex == "rigid" and link.friction is not None:
        yield "friction.coulomb", link.friction.coulomb, f"{link.name!r} is rigid"
    if link.up is not None and link.material is None:
        yield "up", link.up, f"{link.name!r} has no section"
    if link.joint.locked:
        for key in ("viscous", "coulomb", "armature"):
            value = getattr(link.joint, key)
            if value != getattr(Joint(), key):
                yield f"joint.{key}", value, f"the joint of {link.name!r} is locked"
