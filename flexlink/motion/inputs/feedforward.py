"""Torques and motion computed when a run is prepared: references that the tip follows, and static feed-forward."""

import math

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import SceneError, errors_at
from flexlink.common.memo import Memo, keep_last
from flexlink.common.types import Array
from flexlink.describe.joint import refuse_beyond
from flexlink.describe.reference import smooth_pieces
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.reference_trajectory import from_rest_to_rest as resting
from flexlink.describe.scene import Scene
from flexlink.dynamics.equilibrium import static_postures
from flexlink.dynamics.tip_inversion.feedforward import Feedforward, feedforward_of, refuse
from flexlink.dynamics.tip_inversion.moves import move_of
from flexlink.kernels.derivatives.static_continuation import gravity_torques
from flexlink.kernels.inputs.record import PiecewisePolynomial
from flexlink.motion.inputs.references import pieces_of


def tip_arrays(scene: Scene, chain: Chain) -> tuple[PiecewisePolynomial, PiecewisePolynomial]:
    """Reference and feedforward torques of the driven joints with which the tip follows the drive's reference.

    Errors are as in `invert`; or the torques would begin before t = 0, or the arm does not start at rest on the path.
    """
    joints, times, torques = TIPS(scene, (), lambda: _tip_arrays(scene, chain))
    return (
        PiecewisePolynomial(joints.knots.copy(), joints.coefficients.copy()),
        PiecewisePolynomial(times.copy(), pieces_of("drive.reference", times, torques, smooth=True)),
    )


TIPS = Memo(16)  # cache of computed tip motions by scene


def _tip_arrays(scene: Scene, chain: Chain) -> tuple[ReferenceTrajectory, Array, Array]:
    refuse(scene, chain)
    wrench = scene.tip_wrench
    found = feedforward_of(scene, chain, move_of(scene, chain, None, None, wrench), wrench)
    _require_start(scene, chain, found)
    parts = [part[:, chain.active] for part in from_rest_to_rest(found)]
    joints = resting(found.times, smooth_pieces(found.times, parts), parts[0][-1])
    driven = [scene.arm.links[chain.coordinate(int(k)).link - 1] for k in chain.active]
    with errors_at("drive.reference: with follows = 'tip', "):
        refuse_beyond(joints, [(link.name, link.joint) for link in driven])
    return joints, found.times, acting_torques(scene, found)


def _require_start(scene: Scene, chain: Chain, found: Feedforward) -> None:
    """Refuse a start after the first torque, or elsewhere than at rest at the start of the path."""
    initial, move = scene.initial, found.move
    if found.times[0] < -1e-9:  # more than rounding
        needed = math.ceil(1e4 * (move.start - float(found.times[0])) - 1e-6) / 1e4
        text = f"drive.reference.start = {move.start:g}: the torques begin {needed:g} s before the tip moves; start at "
        raise SceneError(f"{text}{needed:g} s or later", id="move-too-early")
    if initial.q is not None or initial.time:  # continues another run
        return
    links = [chain.coordinate(int(k)).link - 1 for k in chain.active]
    if not np.allclose(scene.joint_positions[links], found.path.postures[0, chain.active], rtol=0.0, atol=1e-9):
        text = "drive.reference: starts elsewhere than initial; with follows = 'tip' the arm starts on the path"
        raise SceneError(text, id="start-differs-from-motion")
    if initial.passive == "zero" and (any(scene.gravity) or found.path.wrench.any()):
        text = "initial.passive = 'zero': with follows = 'tip' the arm starts at rest; set passive = 'static'"
        raise SceneError(text, id="springs-start-slack")


def from_rest_to_rest(found: Feedforward) -> tuple[Array, Array, Array]:
    """Motion whose first and last state are exactly at rest, from which it differs by the decay of torques."""
    q, qd, qdd = (part.copy() for part in (found.motion.q, found.motion.qd, found.motion.qdd))
    q[[0, -1]] = found.path.postures[[0, -1]]
    qd[[0, -1]] = qdd[[0, -1]] = 0.0
    return q, qd, qdd


def acting_torques(scene: Scene, found: Feedforward) -> Array:
    """Torques to command, shape (m, d): for sampled drives such that they are right on average while they act."""
    times, torques, rate = found.times, found.motion.torques, scene.drive.rate
    if rate is None:
        return torques
    from scipy.interpolate import CubicSpline  # noqa: PLC0415  slow to import: 0.1 s

    begins, late = scene.drive.delay, scene.drive.delay + 1.0 / rate
    padded = np.concatenate([times[:1] - late, times, times[-1:] + late])
    total = CubicSpline(padded, np.concatenate([torques[:1], torques, torques[-1:]])).antiderivative()
    return np.asarray((total(times + late) - total(times + begins)) * rate)


# Static feed-forward: the torque that holds the arm, with its hinges bent by gravity, along a reference.


TURN = np.radians(8.0)
"""Largest rotation of a joint within one polynomial of degree 5 [rad]; the torque error is then below 1e-6 of the
largest torque."""
NODES = np.linspace(0.0, 1.0, 6)
TO_POWERS = np.linalg.inv(np.vander(NODES, increasing=True))


def holding_torque(chain: Chain, target: PiecewisePolynomial) -> PiecewisePolynomial:
    """Torque of the driven joints that keeps the arm in equilibrium along its reference, as polynomials in time [N m].

    Each polynomial passes through six equilibria, with the errors of `static_postures`; large rotations need more.
    """
    return PiecewisePolynomial(*(part.copy() for part in _holding_torque(chain, target)))


@keep_last(16)  # each requires hundreds of equilibria
def _holding_torque(chain: Chain, target: PiecewisePolynomial) -> PiecewisePolynomial:
    course = ReferenceTrajectory(*target)
    knots = _divided(*target)
    c, h = course.restated(knots), np.diff(knots, append=knots[-1] + 1.0)  # the last piece is constant
    x = NODES * h[:, None]
    angles = np.einsum("kjd,knj->knd", c, x[:, :, None] ** np.arange(c.shape[1]))
    moving = np.asarray(c[:, 1:].any(axis=(1, 2)))
    needed = np.arange(len(NODES)) < np.where(moving, len(NODES), 1)[:, None]  # a constant piece needs one node
    every = angles[needed]
    new = np.append(True, (np.diff(every, axis=0) != 0).any(axis=1))  # consecutive repetitions are left out
    nodes, which = np.ascontiguousarray(every[new]), np.cumsum(new) - 1
    postures = nodes if len(chain.active) == chain.n else static_postures(chain, nodes)
    holding = np.empty_like(postures)
    gravity_torques(chain.arrays, postures, holding)
    torques = np.zeros_like(angles)
    torques[needed] = holding[which][:, chain.active]
    torques[~moving] = torques[~moving, :1]
    powers = np.einsum("jn,knd->kjd", TO_POWERS, torques) / h[:, None, None] ** np.arange(len(NODES))[:, None]
    powers[~moving, 1:] = 0.0
    return PiecewisePolynomial(knots, powers)


def _divided(knots: Array, c: Array) -> Array:
    """Start times after dividing pieces so that no joint turns by more than `TURN`; the last one is constant."""
    h = np.diff(knots)
    farthest = (np.abs(c[:-1, 1:]) * h[:, None, None] ** np.arange(1, c.shape[1])[:, None]).sum(axis=1)
    parts = np.maximum(1, np.ceil(farthest.max(axis=1, initial=0.0) / TURN).astype(np.int64)).tolist()
    pieces = zip(knots[:-1].tolist(), knots[1:].tolist(), parts, strict=True)
    begins = [np.linspace(start, end, n, endpoint=False) if n > 1 else [start] for start, end, n in pieces]
    return np.concatenate([*begins, knots[-1:]])
