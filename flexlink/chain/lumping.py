"""Lump a scene into a chain: positions of hinges, their stiffness and damping, and the inertia of the segments."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from flexlink.chain.arguments import require_type
from flexlink.chain.beam_hinges import Springs, add_beam
from flexlink.chain.beams import SectionBeam, TableBeam, table_of
from flexlink.chain.builder import Builder, Piece, described, record_inertia, recorded
from flexlink.chain.chain import Chain
from flexlink.chain.constant_ratio import posture_of, with_constant_ratios
from flexlink.chain.coordinates import BASE_AXES, Kind
from flexlink.chain.forces import with_forces
from flexlink.chain.odd_bodies import require_positive_mass
from flexlink.chain.rigid import HERE, about_axis_deg, matrix_from_rpy, matrix_from_rpy_deg, reference_rotation, turn_to
from flexlink.chain.shapes import with_shapes
from flexlink.common.errors import FlexlinkError, SceneError, or_error
from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.data.documents import is_user_file
from flexlink.describe.arm import Arm
from flexlink.describe.hinges import hinges_of
from flexlink.describe.joint import Limits
from flexlink.describe.link import ROOT_AXES, Link
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import build_unchecked
from flexlink.describe.tie import refuse_ties
from flexlink.kernels.layout import COUPLING, HINGE, SLIDES


def lump(scene: Scene) -> Chain:
    """Divide the arm of a scene into rigid segments connected by hinges; locked joints keep their initial position.

    Parameters
    ----------
    scene
        The scene: its arm, gravity, angles of locked joints and prescribed joints.

    Returns
    -------
    Chain
        A chain with n = Σ over links of (1 if the joint is free) + axes · (segments − 1) degrees of freedom. For one
        rigid link and equal flexible links this is eq. 1 of the paper, ngl = n [tip (nseg − 1) + 1] − tip (nseg − 1).

    Raises
    ------
    SceneError
        A lumping rule does not exist or cannot be used for its link, or the dimensions lead to a mass, inertia or
        stiffness beyond float64; or M is indefinite, because a body has an inertia that no real body has.
    DataFileError
        The file of a lumping rule is not valid.
    ArgumentError
        `scene` is not a Scene.

    Examples
    --------
    >>> chain = fl.lump(scene)
    >>> chain
    <Chain 'two_links': 6 joints, 2 of them driven; 6.15281 kg>
    >>> print(chain.joint_names)
    ('upper', 'upper.1.z', 'upper.2.z', 'fore', 'fore.1.z', 'fore.2.z')
    """
    refuse_ties(require_type("scene", scene, Scene).ties)
    return _lumped(scene) if has_user_rules(scene) else _kept(scene, lambda: _lumped(scene))


def _kept(scene: Scene, find: Callable[[], Chain]) -> Chain:
    """The chain of an equal arm in an equal situation, if there was one lately, else the one that `find` makes."""
    known = scene.name, scene.gravity, scene.fluid_density, situation(scene), posture_of(scene)
    return CHAINS(scene.arm, known, find)


def open_chain(scene: Scene) -> Scene:
    """The scene without its ties and stops."""
    opened: Scene = build_unchecked(replace, scene, tie=(), limits=Limits()) if scene.ties else scene
    return opened


def situation(scene: Scene) -> tuple[object, ...]:
    """Settings of the scene, apart from the links, on which the `Frame` depends."""
    arm, initial = scene.arm, scene.initial
    starts = zip(arm.links, initial.joint_deg, initial.positions_m, strict=True)
    locked = tuple((deg, m) for link, deg, m in starts if link.joint.locked)
    moved = tuple(motion.link for motion in scene.motion)
    turned = (initial.base.rpy_deg, initial.base.quaternion) if arm.base.free else None
    return locked, moved, turned, arm.base, scene.wrench.on


def has_user_rules(scene: Scene) -> bool:
    """Whether a lumping rule is a user's file, which may change."""
    return any(is_user_file(link.lumping) for link in scene.arm.links)


CHAINS = Memo(64)
"""Cache of chains; runs of an arm with different loads and settings share its chain and data derived from it."""


def _lumped(scene: Scene) -> Chain:
    """Build the chain. Arms that differ only in payload, springs and gravity share a `Frame`, which is built once."""
    frame = frame_of(scene)
    return _finished(frame, scene, *(rows[0] for rows in _numbers(frame, [scene.arm])))


Records = NDArray[np.void]


def _numbers(frame: Frame, arms: Sequence[Arm]) -> tuple[Records, Records, Records]:
    """Bodies, hinges and couplings of arms that share a frame, (b, …) each."""
    bare = frame.bare.bodies, frame.bare.hinges, frame.bare.couplings
    bodies, hinges, couplings = (np.repeat(rows[None], len(arms), axis=0) for rows in bare)
    # index of the body that carries the payload, as a slice; empty if the payload is fixed to the base
    carrier = slice(max(0, frame.builder.on - 1), frame.builder.on)
    with np.errstate(all="ignore"):  # `_finished` refuses such values by name
        for springs in frame.springs:
            springs.write(arms, hinges, couplings)
        for own, arm in zip(bodies, arms, strict=True):
            record_inertia(own[carrier], [frame.builder.carrying(arm.tip)])
    return bodies, hinges, couplings


def _finished(frame: Frame, scene: Scene, bodies: Records, hinges: Records, couplings: Records) -> Chain:
    """The chain of a scene with these numbers; errors as in `lump`."""
    for springs in frame.springs:
        if not hinges["stiffness"][springs.rows].all():
            raise SceneError(f"link {springs.link.name!r}: the stiffness of a hinge underflows float64", id="underflow")
    for array in (bodies, hinges, couplings):
        _check_finite(scene.name, array)
    chain = frame.chain = frame.chain.with_numbers(
        name=scene.name, bodies=bodies, hinges=hinges, gravity=np.array(scene.gravity), couplings=couplings
    )
    require_positive_mass(chain, scene.arm)
    chain = with_shapes(with_constant_ratios(chain, scene), scene)
    return with_forces(chain, scene, frame.builder.pieces)


def lump_many(scenes: Sequence[Scene]) -> list[Chain | FlexlinkError]:
    """Chain of every scene, bitwise equal to `lump`, or its error; those that share a frame are computed together."""
    shared: dict[int, tuple[Frame, list[int]]] = {}
    frame = None
    for k, scene in enumerate(scenes):
        if not k or not _same_frame(scenes[k - 1], scene):
            frame = _shared_frame(scene)
        if frame is not None:
            shared.setdefault(id(frame), (frame, []))[1].append(k)
    ready: dict[int, Callable[[], Chain]] = {}
    for one, members in shared.values():
        if len(members) > 1:
            made = zip(members, *_numbers(one, [scenes[k].arm for k in members]), strict=True)
            ready |= {k: partial(_kept, scenes[k], partial(_finished, one, scenes[k], *own)) for k, *own in made}
    return [or_error(ready.get(k, partial(lump, scene))) for k, scene in enumerate(scenes)]


def _same_frame(before: Scene, scene: Scene) -> bool:
    """Whether two scenes obviously share a `Frame`, or both have none, without computing one."""
    a, b = before.arm, scene.arm
    same = a.links is b.links and a.sections is b.sections and a.rigidities is b.rigidities
    if not (same and before.motion is scene.motion):
        return False
    densities = (a.materials[name].density == b.materials[name].density for name in a.materials if name in b.materials)
    return situation(before) == situation(scene) and a.materials.keys() == b.materials.keys() and all(densities)


def _shared_frame(scene: Scene) -> Frame | None:
    """The frame of a scene; None if it has an error, or if its chain needs more than the frame and a few numbers."""
    try:
        alone = has_user_rules(scene) or posture_of(scene) or any(link.modes for link in scene.arm.links)
        return None if alone else frame_of(scene)
    except FlexlinkError:
        return None


def pieces(scene: Scene) -> list[Piece]:
    """Straight pieces of the links that `lump` makes, from the base outward, for pictures; errors as in `lump`."""
    return frame_of(require_type("scene", scene, Scene)).builder.pieces


@dataclasses.dataclass
class Frame:
    """Chain data of an arm before its payload and the springs of its beams are added."""

    bare: Chain
    builder: Builder
    springs: tuple[Springs, ...]
    chain: Chain  # the latest chain built from the frame; its cached layout data are reused


def frame_of(scene: Scene) -> Frame:
    """The frame of a scene's arm; errors as in `lump`."""
    arm = scene.arm
    beams = tuple(_beam_of(arm, link) for link in arm.links)
    user_rules = tuple(lumping_rule(link.lumping) for link in arm.links if is_user_file(link.lumping))
    return FRAMES(arm.links, (beams, user_rules, situation(scene)), lambda: _framed(scene, beams))


FRAMES = Memo(64)
"""Cache of frames, keyed by the links and by all other data on which a `Frame` depends."""


def _framed(scene: Scene, beams: Sequence[SectionBeam | TableBeam | None]) -> Frame:
    """Build bodies, hinges and pieces, from the base outward to the tip frames."""
    arm, builder, initial = scene.arm, Builder(), scene.initial
    moved = {arm.number(motion.link) for motion in scene.motion}
    springs: list[Springs] = []
    ends, tips = {}, {}
    placed, ends_of_arm = hinges_of(arm), arm.tips
    with np.errstate(all="ignore"):  # `_finished` refuses such values by name
        _add_base(builder, scene)
        ends[0] = builder.place
        for number, (link, parent) in enumerate(zip(arm.links, arm.parents, strict=True), 1):
            builder.go_to(ends[parent])
            _add_mount(builder, link, arm.links[parent - 1] if parent else None)
            start = initial.joint_deg[number - 1], initial.positions_m[number - 1]
            _add_joint(builder, link, number, start, number in moved)
            springs += _add_line(builder, link, number, beams[number - 1], *placed[number - 1])
            ends[number] = builder.place
            if number == len(arm.links):
                _add_lags(builder, arm)
            if number in ends_of_arm:
                builder.start_body(section=_end_turn(link).T @ link.beam.frame)  # tip frame, without hinges
                tips[link.name] = len(builder.bodies) - 2
    builder.go_to(ends[len(arm.links)])
    bodies = recorded(builder.bodies[1:])  # bodies[0] is the base
    if arm.base.free:
        bodies["turned"][1] = 1  # for any initial attitude
    bodies["loaded"][tips[scene.wrench.on or arm.links[-1].name]] = 1
    chain = Chain(
        name=scene.name, bodies=bodies, hinges=np.array(builder.hinges, dtype=HINGE), gravity=np.array(scene.gravity),
        coordinates=tuple(builder.coordinates), link_names=tuple(link.name for link in arm.links),
        joints_of_links=arm.joint_names, couplings=np.array(builder.couplings, dtype=COUPLING), tips=tips,
        described=described(builder.bodies[1:]),
    )  # fmt: skip
    return Frame(chain, builder, tuple(springs), chain)


def _beam_of(arm: Arm, link: Link) -> SectionBeam | TableBeam | None:
    """Beam of a link; None if the link has no beam with mass."""
    if link.material is None or link.section is None:
        return table_of(arm, link)
    root, tip = arm.sections[link.section], arm.sections[link.section_tip or link.section]
    return SectionBeam(link.beam.length, arm.materials[link.material].density, root, tip)


def _check_finite(name: str, array: Records) -> None:
    finite = np.isfinite(array.view(np.float64))  # all fields at once: the small integers count as finite
    limits = [field for field in array.dtype.names or () if field in {"lower", "upper"}]  # ±inf means no limit
    if np.count_nonzero(finite) == finite.size - sum(np.count_nonzero(~np.isfinite(array[name])) for name in limits):
        return
    for field in array.dtype.names or ():
        if field not in limits and not np.isfinite(array[field]).all():
            raise SceneError(f"{name}: {field} of a segment overflows float64", id="overflow")


def _add_base(builder: Builder, scene: Scene) -> None:
    """Add the joints of a free base, and its body."""
    base, hinges = scene.arm.base, itertools.count()
    if not base.free:
        return
    for turns in (False, True):
        if turns:
            builder.turn(reference_rotation(scene.initial.base))
        builder.start_body()
        for axis in (axis for axis in BASE_AXES if (axis < SLIDES) == turns):
            builder.add_hinge(Kind.BASE.at(0, axis=next(hinges)), axis)
    builder.add_payload(base)


def _add_mount(builder: Builder, link: Link, before: Link | None) -> None:
    """Move from the end of the previous link to the axes of a link at angle zero."""
    mount, row = link.mount, link.dh
    modified = row is not None and row.convention == "modified"
    if modified and before is not None:
        builder.move(-np.array(before.stop))
    builder.move(np.array(mount.xyz), matrix_from_rpy(mount.rpy) if mount.rpy else matrix_from_rpy_deg(mount.rpy_deg))
    if row is not None and modified:
        builder.move(np.array([row.a, 0, 0]), about_axis_deg(0, row.alpha_deg))
        builder.move(np.array([0, 0, row.d]))
    if row is not None:
        builder.turn(about_axis_deg(2, row.theta_deg))


def _add_joint(builder: Builder, link: Link, number: int, start: tuple[float, float], held: bool) -> None:
    """Add joint, gear and hub of a link; a locked joint remains at `start` [deg, m]."""
    joint = link.joint
    axis, turn = turn_to(joint.axis)
    builder.turn(turn)
    if joint.locked and joint.slides:
        builder.move(np.eye(3)[axis] * start[1])
    elif joint.locked:
        builder.turn(about_axis_deg(axis, start[0]))
    if not joint.locked or joint.gear_stiffness is not None:
        builder.start_body(turn.T, turn.T @ link.beam.frame)
    axis += SLIDES * joint.slides
    if not joint.locked:
        lower, upper = (joint.position(limit, limit) for limit in joint.limits or (-np.inf, np.inf))
        viscous = 0.0 if joint.lags else joint.viscous
        builder.add_hinge(
            Kind.JOINT.at(number), axis, damping=viscous, coulomb=joint.coulomb, width=joint.coulomb_width,
            armature=joint.armature, lower=lower, upper=upper, held=held,
        )  # fmt: skip
    if joint.gear_stiffness is not None:
        builder.add_hinge(Kind.GEAR.at(number), axis, joint.gear_stiffness, joint.gear_damping)
    builder.turn(turn.T)
    builder.add_payload(link.hub)


def _add_lags(builder: Builder, arm: Arm) -> None:
    """Add internal coordinates for lagging joint friction: rotors of inertia d τ with dampers d, without a body."""
    last = builder.place
    for number, link in enumerate(arm.links, 1):
        joint = link.joint
        if joint.lags:
            builder.go_to((0, HERE))
            builder.start_body()
            rotor = joint.viscous * joint.viscous_lag
            builder.add_hinge(Kind.LAG.at(number), SLIDES * joint.slides, 0.0, joint.viscous, armature=rotor)
    builder.go_to(last)


def _add_line(
    builder: Builder, link: Link, number: int, beam: SectionBeam | TableBeam | None, nodes: Array, weights: Array
) -> list[Springs]:
    """Add the part between a link's joint and its end: the beam, and the end body."""
    start, length, frame = link.beam
    builder.move(start)
    if link.root_springs:  # about axes of the link's frame
        builder.start_body(section=frame)
    for axis, (stiffness, damping) in link.root_springs.items():
        turned = ROOT_AXES.index(axis)
        builder.add_hinge(Kind.ROOT.at(number, axis=turned), turned, stiffness, damping)
    builder.turn(frame)
    springs: list[Springs] = []
    if beam is None:
        builder.advance(number, (0.0, 1.0), np.array([length, 0, 0]))
    else:
        springs = add_beam(builder, link, number, beam, nodes, weights)
    builder.turn(frame.T)
    if link.dh is not None and link.dh.convention == "standard":
        builder.move(np.subtract(link.dh.end, link.stop), _end_turn(link))
    builder.add_payload(link.end)
    return springs


def _end_turn(link: Link) -> Array:
    """Rotation from axes of a link's end frame to axes of the link: Rx(α) of a standard row, else none."""
    row = link.dh
    return about_axis_deg(0, row.alpha_deg) if row is not None and row.convention == "standard" else HERE.R
