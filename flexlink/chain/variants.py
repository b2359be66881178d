"""Lump several scenes at once; scenes that share a `Frame` differ in a few values, which are computed as arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.builder import symmetric
from flexlink.chain.chain import Chain
from flexlink.chain.constant_ratio import posture_of
from flexlink.chain.forces import with_forces
from flexlink.chain.lumping import Frame, frame_of, has_user_rules, lump, situation
from flexlink.chain.rigid import HERE, NOTHING, Pose, SpatialInertia
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.scene import Scene
from flexlink.kernels.layout import COUPLING, HINGE


def lump_many(scenes: Sequence[Scene]) -> list[Chain | FlexlinkError]:
    """Chain of every scene, bitwise equal to the result of `lump`, or the error that `lump` raises."""
    shared: dict[int, list[int]] = {}
    frames: dict[int, Frame] = {}
    frame = None
    for k, scene in enumerate(scenes):
        if not k or not _same_frame(scenes[k - 1], scene):
            frame = _frame(scene)
        if frame is not None:
            frames[id(frame)] = frame
            shared.setdefault(id(frame), []).append(k)
    chains: list[Chain | FlexlinkError | None] = [None] * len(scenes)
    for frame_id, members in shared.items():
        if len(members) > 1:
            for k, chain in zip(members, _of_frame(frames[frame_id], [scenes[k] for k in members]), strict=True):
                chains[k] = chain
    return [_alone(scene) if chain is None else chain for scene, chain in zip(scenes, chains, strict=True)]


def _same_frame(before: Scene, scene: Scene) -> bool:
    """Whether two scenes obviously share a `Frame`, or both have none, without computing one."""
    a, b = before.arm, scene.arm
    same = a.links is b.links and a.sections is b.sections and a.rigidities is b.rigidities
    if not (same and before.motion is scene.motion):
        return False
    densities = (a.materials[name].density == b.materials[name].density for name in a.materials if name in b.materials)
    held = situation(before) == situation(scene)
    return held and a.materials.keys() == b.materials.keys() and all(densities)


def _frame(scene: Scene) -> Frame | None:
    try:
        alone = has_user_rules(scene) or posture_of(scene) or any(link.modes for link in scene.arm.links)
        return None if alone else frame_of(scene)
    except FlexlinkError:
        return None


def _alone(scene: Scene) -> Chain | FlexlinkError:
    try:
        return lump(scene)
    except FlexlinkError as error:
        return error


def _of_frame(frame: Frame, scenes: Sequence[Scene]) -> list[Chain | None]:
    """Chains that share a `Frame`; None for scenes whose error `lump` must raise."""
    b = len(scenes)
    bodies, hinges = np.empty((b, len(frame.bodies)), frame.bodies.dtype), np.empty((b, len(frame.hinges)), HINGE)
    couplings = np.empty((b, len(frame.couplings)), COUPLING)
    bodies[:], hinges[:], couplings[:] = frame.bodies, frame.hinges, frame.couplings
    good = np.ones(b, dtype=bool)
    with np.errstate(all="ignore"):
        for springs in frame.springs:
            good &= springs.write([scene.arm for scene in scenes], hinges, couplings)
        _write_tips(frame, [scene.arm.tip for scene in scenes], bodies)
        good &= np.isfinite(bodies.view(np.float64)).all(axis=1)
        good &= np.isfinite(couplings.view(np.float64)).all(axis=1)
        limits = [name in {"lower", "upper"} for name in HINGE.names or ()]
        finite = np.isfinite(hinges.view(np.float64)).reshape(b, -1, len(limits))
        good &= (finite | limits).all(axis=(1, 2))
    chains: list[Chain | None] = []
    for k, scene in enumerate(scenes):
        if not good[k]:
            chains.append(None)
            continue
        numbers = {"bodies": bodies[k], "hinges": hinges[k], "couplings": couplings[k]}
        frame.chain = frame.chain.with_numbers(name=scene.name, gravity=np.array(scene.gravity), **numbers)
        chains.append(with_forces(frame.chain, scene, frame.builder.pieces))
    return chains


def _write_tips(frame: Frame, tips: Sequence[RigidBody], bodies: NDArray[np.void]) -> None:
    """Write the body that carries the payload, with the payload of each scene."""
    if frame.carrier.stop == 0:  # the base
        return
    last = bodies[:, frame.carrier.start]
    carrying = np.array([bool(tip.mass or any(tip.inertia)) for tip in tips])
    rigid = frame.builder.body.rigid
    last["mass"], last["center"], last["inertia"] = rigid.mass, rigid.center, symmetric(rigid.inertia.copy())
    if not carrying.any():
        return
    payloads = [tip for tip, loaded in zip(tips, carrying.tolist(), strict=True) if loaded]
    masses, centers, inertias = _joined(rigid, frame.builder.running, payloads)
    last["mass"][carrying], last["center"][carrying], last["inertia"][carrying] = masses, centers, symmetric(inertias)


def _joined(rigid: SpatialInertia, frame_id: Pose, payloads: Sequence[RigidBody]) -> tuple[Array, Array, Array]:
    """`SpatialInertia.plus` and `moved` for b bodies: masses (b,), centres (b, 3), inertias (b, 3, 3)."""
    masses = np.array([body.mass for body in payloads])
    centers, inertias = np.array([body.center for body in payloads]), _matrices(payloads)
    if frame_id is not HERE:
        R, p = frame_id
        centers = p + (R * centers[:, None, :]).sum(axis=2)
        turned = (R[:, :, None] * inertias[:, None]).sum(axis=2)
        inertias = (turned[..., None] * R.T).sum(axis=2)
    if rigid is NOTHING:
        return masses, centers, inertias
    total = rigid.mass + masses
    d = centers - rigid.center
    square = (d * d).sum(axis=1)[:, None, None] * np.eye(3) - d[:, :, None] * d[:, None, :]
    between = (rigid.mass * masses / total)[:, None, None] * square
    joined = rigid.inertia + between + inertias
    center = rigid.center + d * (masses / total)[:, None]
    none = total == 0
    center[none], joined[none] = 0.0, rigid.inertia + inertias[none]
    return total, center, joined


def _matrices(payloads: Sequence[RigidBody]) -> Array:
    """`RigidBody.matrix` of each payload, (b, 3, 3)."""
    xx, yy, zz, xy, xz, yz = np.array([(*body.inertia, 0.0, 0.0, 0.0)[:6] for body in payloads]).T
    return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
