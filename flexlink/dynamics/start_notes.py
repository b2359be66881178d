"""Notes on a scene whose start is probably not what was intended; each names the cause and the remedy."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import Diagnostic
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.scene import Scene
from flexlink.dynamics.forces import deflections
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.dynamics.terms import elastic_torque, gravity_torque

VISIBLE_DROP = 1e-4
"""Smallest drop of the tip that is reported, relative to the size of the arm."""
MAX_JOINTS = 300
"""Number of joints above which eigenvalues take seconds and stability is not checked."""
BALANCED = 2e-3
"""Gravity torque below which a joint hardly moves, relative to the largest torque that the arm's weight can exert."""


def is_free_fall(scene: Scene) -> bool:
    """Whether gravity acts and no joint is driven, held or braked."""
    free = [link.joint for link in scene.arm.links if not link.joint.locked]
    braked = any(joint.viscous or joint.coulomb for joint in free)
    return bool(free) and scene.drive.kind == "none" and not scene.motion and any(scene.gravity) and not braked


def slack_springs(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if joints are held against gravity while the springs of links and gears start slack."""
    drive, initial = scene.drive, scene.initial
    fed = f"drive.gravity = {drive.gravity!r}" if drive.kind in {"pd", "cascade"} else f"drive.kind = {drive.kind!r}"
    holds = drive.kind == "computed_torque" or drive.gravity != "none"
    if not holds or initial.passive != "zero" or initial.q is not None or not any(scene.gravity):
        return
    chain = lump(scene)
    drop = _drop(chain, _angles(scene, chain))
    if drop > VISIBLE_DROP * chain.size:
        yield Diagnostic(
            f"initial.passive = 'zero', the default: the springs start slack while {fed} holds the joints, so the "
            f"tip drops by about {1e3 * drop:.3g} mm at t = 0 and swings; set initial.passive = 'static'",
            "springs-start-slack",
        )


def unheld_joints(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if undriven joints fall while others are driven."""
    if scene.drive.kind == "none" or not any(scene.gravity):
        return
    moved = {scene.arm.number(motion.link) - 1 for motion in scene.motion}
    chain = lump(scene)
    pulled = np.abs(gravity_torque(chain, _angles(scene, chain)))
    names, small = [], BALANCED * chain.weight * np.where(chain.slides, 1.0, chain.size)
    for joint in chain.active:
        k = chain.coordinates[int(joint)].link - 1
        joint_data = scene.arm.links[k].joint
        free = not (joint_data.viscous or joint_data.coulomb or _driven(scene, k))
        if k not in moved and pulled[joint] > small[joint] and free:
            names.append(scene.arm.links[k].name)
    if names:
        yield Diagnostic(
            f"drive.kind = {scene.drive.kind!r}: gravity moves {short_list(names)}, with no drive or friction; add a "
            "torque, gains or friction there, or set joint.locked = true",
            "joint-unheld",
        )


def weak_drives(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if a torque limit does not hold the initial configuration; it may have been given in kN m."""
    effort = scene.drive.effort
    if effort is None or not any(scene.gravity):
        return
    chain = lump(scene)
    pulled = np.abs(gravity_torque(chain, _angles(scene, chain)))
    for joint in chain.active:
        k, unit = chain.coordinates[int(joint)].link, chain.torque_units[joint]
        limit, needed = effort[k - 1], float(pulled[joint])
        if limit < needed:
            # a limit below a twentieth of the holding torque suggests a wrong unit
            in_k = f", or if given in k{unit}, {1000 * limit:g} {unit}" if 20 * limit < needed <= 1000 * limit else ""
            yield Diagnostic(
                f"{scene.arm.path(k, 'drive.effort')} = {limit:g} {unit}: holding the initial configuration takes "
                f"{needed:.3g} {unit}, so the joint gives way; give a larger limit{in_k}",
                "weak-drive",
            )


def balance(scene: Scene) -> Iterator[Diagnostic]:
    """Warn if an arm starts at rest in equilibrium: it never moves, or only after a long time."""
    initial = scene.initial
    acts = scene.drive.kind != "none" or scene.motion or scene.wrench.acts or scene.joint_rates.any() or initial.qd
    if acts or initial.q is not None or initial.passive != "zero" or not any(scene.gravity):
        return
    chain = lump(scene)
    q = _angles(scene, chain)
    small = BALANCED * chain.weight * np.where(chain.slides, 1.0, chain.size)
    if (np.abs(gravity_torque(chain, q) + elastic_torque(chain, q)) > small).any():
        return
    if not (np.abs(gravity_torque(chain, q + 0.1)) > small).any():
        return  # gravity drives no joint in any configuration
    unstable = _is_unstable(chain, q)
    how = "in unstable equilibrium and hardly moves for a long time" if unstable else "in equilibrium and stays there"
    yield Diagnostic(
        f"initial.joint_deg = {list(initial.joint_deg)}: the arm starts {how}; change the angles, or apply a load",
        "unstable-equilibrium" if unstable else "equilibrium",
    )


def _is_unstable(chain: Chain, q: Array) -> bool:
    """Whether the equilibrium is unstable; False for long chains, for which the check would take seconds."""
    if chain.n > MAX_JOINTS:
        return False
    K = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
    return bool(np.isfinite(K).all() and np.linalg.eigvalsh(K)[0] < 0)


def _angles(scene: Scene, chain: Chain) -> Array:
    """Initial joint coordinates, springs slack [rad, m]."""
    q, starts = np.zeros(chain.n), scene.joint_positions
    q[chain.active] = [starts[chain.coordinates[int(k)].link - 1] for k in chain.active]
    return q


def _drop(chain: Chain, q: Array) -> float:
    """First-order estimate of how far the tip drops under gravity from the configuration with slack springs [m]."""
    bent = q - deflections(chain, gravity_torque(chain, q))
    return float(np.linalg.norm(tip_position(chain, bent) - tip_position(chain, q)))


def _driven(scene: Scene, k: int) -> bool:
    """Whether the drive acts on the joint of link k, counted from 0."""
    drive = scene.drive
    rows = [drive.torque, drive.kp, drive.kd, *(drive.torques or ())]
    return any(row is not None and row[k] != 0 for row in rows)
