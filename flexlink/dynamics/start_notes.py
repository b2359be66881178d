"""How a scene starts, where it likely starts otherwise than meant: each note names the cause and what to change."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.springs import deflections
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.dynamics.terms import elastic_torque, gravity_torque

SEEN = 1e-4
"""Part of the size by which a tip drops visibly."""
MANY = 300
"""Joints beyond which eigenvalues take seconds."""
BALANCED = 2e-3
"""Torque of gravity, as a part of the largest that the arm's weight can have, that hardly moves a joint."""


def is_free_fall(scene: Scene) -> bool:
    """Whether gravity pulls and nothing drives, holds or brakes any joint."""
    free = [link.joint for link in scene.arm.links if not link.joint.locked]
    braked = any(joint.viscous or joint.coulomb for joint in free)
    return bool(free) and scene.drive.kind == "none" and not scene.motion and any(scene.gravity) and not braked


def slack_springs(scene: Scene) -> Iterator[str]:
    """Joints that are held against gravity while the springs of links and gears start slack."""
    drive, initial = scene.drive, scene.initial
    fed = f"drive.gravity = {drive.gravity!r}" if drive.kind == "pd" else f"drive.kind = {drive.kind!r}"
    holds = drive.kind == "computed_torque" or drive.gravity != "none"
    if not holds or initial.passive != "zero" or initial.q is not None or not any(scene.gravity):
        return
    chain = lump(scene)
    drop = _drop(chain, _angles(scene, chain))
    if drop > SEEN * chain.size:
        yield (
            f"initial.passive = 'zero', the default: the springs start slack while {fed} holds the joints, so that the "
            f"tip drops by about {1e3 * drop:.3g} mm at t = 0 and swings; take initial.passive = 'static'"
        )


def unheld_joints(scene: Scene) -> Iterator[str]:
    """Joints that fall beside others that are driven."""
    if scene.drive.kind == "none" or not any(scene.gravity):
        return
    moved = {scene.arm.number(motion.link) - 1 for motion in scene.motion}
    chain = lump(scene)
    pulled = np.abs(gravity_torque(chain, _angles(scene, chain)))
    names, some = [], BALANCED * chain.weight * np.where(chain.slides, 1.0, chain.size)
    for joint in chain.active:
        k = chain.coordinates[int(joint)].link - 1
        own = scene.arm.links[k].joint
        if k not in moved and pulled[joint] > some[joint] and not (own.viscous or own.coulomb or _driven(scene, k)):
            names.append(scene.arm.links[k].name)
    if names:
        yield (
            f"drive.kind = {scene.drive.kind!r}: nothing drives or brakes {short_list(names)}, which gravity makes "
            "fall; give a torque or gains there, friction, or joint.locked = true"
        )


def balance(scene: Scene) -> Iterator[str]:
    """An arm that starts at rest in balance: a run shows an arm that does not move, or only after a long time."""
    initial = scene.initial
    acts = scene.drive.kind != "none" or scene.motion or scene.wrench.acts or scene.joint_rates.any() or initial.qd
    if acts or initial.q is not None or initial.passive != "zero" or not any(scene.gravity):
        return
    chain = lump(scene)
    q = _angles(scene, chain)
    some = BALANCED * chain.weight * np.where(chain.slides, 1.0, chain.size)
    if (np.abs(gravity_torque(chain, q) + elastic_torque(chain, q)) > some).any():
        return
    if not (np.abs(gravity_torque(chain, q + 0.1)) > some).any():
        return  # gravity turns none of its joints, wherever they are
    how = "stands in unstable balance, and hardly moves for long" if _topples(chain, q) else "is in balance, and stays"
    yield f"initial.joint_deg = {list(initial.joint_deg)}: the arm {how}; start it at another angle, or push it"


def _topples(chain: Chain, q: Array) -> bool:
    """Whether balance is unstable; of long chains nobody waits for it."""
    if chain.n > MANY:
        return False
    K = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
    return bool(np.isfinite(K).all() and np.linalg.eigvalsh(K)[0] < 0)


def _angles(scene: Scene, chain: Chain) -> Array:
    """Where the joints start, springs slack [rad, m]."""
    q, starts = np.zeros(chain.n), scene.joint_positions
    q[chain.active] = [starts[chain.coordinates[int(k)].link - 1] for k in chain.active]
    return q


def _drop(chain: Chain, q: Array) -> float:
    """How far the springs let the tip down from where they are slack [m], to first order."""
    bent = q - deflections(chain, gravity_torque(chain, q))
    return float(np.linalg.norm(tip_position(chain, bent) - tip_position(chain, q)))


def _driven(scene: Scene, k: int) -> bool:
    """Whether the drive acts on the joint of link k, from 0."""
    drive = scene.drive
    rows = [drive.torque, drive.kp, drive.kd, *(drive.torques or ())]
    return any(row is not None and row[k] != 0 for row in rows)
