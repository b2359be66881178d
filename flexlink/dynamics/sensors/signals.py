"""Ideal signals of a scene's sensors along a run, without effects of the instruments, and derivatives at a state."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.beams import table_of
from flexlink.chain.builder import Piece
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, open_chain, pieces
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.directions import unit
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import OF_THE_DRIVE, Sensor, is_on_base
from flexlink.dynamics.floating_base import BODY
from flexlink.dynamics.point_motion import motion_in_body, point_slopes
from flexlink.dynamics.strain import known_at, strains_in
from flexlink.kernels.geometry.kinematics import forward_kinematics

Samples = Any  # the samples of a run: an object with `RunSamples`' chain, t, q, qd, tau and, for accelerometers, qdd


def signal_of(sensor: Sensor, scene: Scene, run: Samples) -> Array:
    """Ideal signal of a sensor at the samples of a run, in SI units and radians, shape (columns, samples)."""
    if sensor.kind == "strain":
        return gauge_strain(sensor, scene, run.q)[None]
    if sensor.kind == "pressure":
        return np.asarray(run.pressures[sensor.tie].T)
    if sensor.kind == "force":
        force = run.tie_forces[sensor.tie]
        return np.asarray(force if force.ndim == 1 else np.linalg.norm(force, axis=1))[None]
    if sensor.kind in OF_THE_DRIVE:
        k = joint_of(sensor, run.chain, scene)
        seen: Array = run.q if sensor.kind == "joint" else run.tau
        return seen[None, :, k] / (sensor.torque_constant or 1.0)
    body, point, axes = placement_of(sensor, scene)
    qdd = run.qdd if sensor.kind == "accelerometer" else np.zeros_like(run.q)
    moving = motion_in_body(run.chain, run.q, run.qd, qdd, body=body, point=point)
    return np.asarray(axes @ getattr(moving, sensor.kind).T)


def joint_of(sensor: Sensor, chain: Chain, scene: Scene) -> int:
    """Sequential index of the joint at which a joint sensor is mounted."""
    return chain.index(scene.arm.number(sensor.link), 0, 0)


def slopes_of(sensor: Sensor, scene: Scene, chain: Chain, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
    """Derivatives of `signal_of` at a state by q, q̇, q̈ and drive torques, "q", "qd", "qdd", "tau", if not 0."""
    if sensor.kind == "strain":
        return {"q": gauge_slope(sensor, scene, chain, q)[None]}
    if sensor.kind in OF_THE_DRIVE:
        selected = np.zeros((1, chain.n))
        selected[0, joint_of(sensor, chain, scene)] = 1.0 / (sensor.torque_constant or 1.0)
        return {"q" if sensor.kind == "joint" else "tau": selected}
    body, point, axes = placement_of(sensor, scene)
    parts = point_slopes(chain, q, qd, qdd, body, point)[sensor.kind]
    return {name: axes @ part for name, part in zip(("q", "qd", "qdd"), parts, strict=False)}


# A strain gauge: strain from a cubic through the nearest hinges, and its derivative with respect to the angles.
#
# If EI is given by a table, EI and the curvature may have kinks and jumps, but the moment M = EI κ does not. The cubic
# then interpolates the moment at the hinges, and κ = M/EI with EI at the gauge, or strains K⁻¹ M.


def gauge_strain(sensor: Sensor, scene: Scene, q: Array) -> Array:
    """Strain ε at the gauge [1], shape (samples,), at angles q (samples, n)."""
    (y, z), position = sensor.fibre or (0.0, 0.0), sensor.x or 0.0
    found, strains = strains_in(scene, q, sensor.link, (y, z))
    nearest, weights = interpolation(found.x, position)
    number = scene.arm.number(sensor.link)
    beam = table_of(scene.arm, scene.arm.links[number - 1])
    if beam is None:
        strain: Array = found.strain[..., nearest] @ weights
        return strain
    places = known_at(scene, number)[nearest], np.array([position / beam.length])
    if beam.table.coupled:
        there, here = map(beam.compliance, places)
        known = strains[..., nearest, :][..., beam.directions, None]
        forces = weights @ np.linalg.solve(there[:, beam.directions], known)[..., 0]
        _, κ_y, κ_z, *others = (here @ forces[..., None])[..., 0].T
        return np.asarray(z * κ_y - y * κ_z + (others[0] if others else 0.0))
    there, here = (beam.rigidities(x)[1:] for x in places)
    κ_y, κ_z = (found.curvature[..., nearest, k + 1] @ (weights * there[k]) / here[k] for k in range(2))
    return np.asarray(z * κ_y - y * κ_z)


def interpolation(nodes: Array, x: float) -> tuple[NDArray[np.intp], Array]:
    """Indices of the nodes nearest to x, at most four, and the Lagrange weights of their values.

    >>> nearest, weights = interpolation(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 1.0)
    >>> print(nearest, weights)
    [0 1 2 3] [0. 1. 0. 0.]
    """
    most = 4  # with hinges at a spacing h the error of the strain ε is about h⁴ ε⁗/24
    nearest = np.sort(np.argsort(np.abs(nodes - x), kind="stable")[:most])
    known = nodes[nearest]
    apart = known[:, None] - known
    ratios = (x - known) / np.where(apart == 0, 1.0, apart)
    np.fill_diagonal(ratios, 1.0)
    return nearest, np.asarray(ratios.prod(axis=1))


def gauge_slope(sensor: Sensor, scene: Scene, chain: Chain, q: Array) -> Array:
    """∂ε/∂q (n,), exact up to rounding: ε is linear in q, unless springs act on rotation vectors."""
    nudge = 1e-3  # step [rad] of the fourth-order differences; their error is 1e-13, plus rounding
    steps = nudge * np.array([1.0, -1.0, 2.0, -2.0])
    states = q + steps[:, None, None] * np.eye(chain.n)
    near, nearer, far, farther = gauge_strain(sensor, scene, states.reshape(-1, chain.n)).reshape(4, chain.n)
    return np.asarray((8 * (near - nearer) - (far - farther)) / (12 * nudge))


def placement_of(sensor: Sensor, scene: Scene) -> tuple[int, Array, Array]:
    """Where a sensor of point motion is placed on the lumped arm, and the directions that it measures.

    The result is the index of a body in `chain.bodies`, the point in its axes [m], (3,), and the measured directions as
    unit vectors (columns, 3), in axes of the body; for a position sensor, in axes of frame 0. On a flexible link the
    body is the segment at the sensor's position; at a hinge, the outboard segment. On a link that is curved at rest, a
    point is on the nearest segment, and the directions turn along the beam with the section. Parts that are fixed in
    frame 0 are refused.
    """
    scene = open_chain(scene)
    chain, arm = lump(scene), scene.arm
    wanted = np.eye(3) if sensor.axis is None else unit("axis", sensor.axis)[None]
    if is_on_base(sensor, arm):
        return BODY, np.array(sensor.point or (0.0, 0.0, 0.0)), wanted
    number = arm.number(sensor.link)
    link, of_link = arm.links[number - 1], [piece for piece in pieces(scene) if piece.link == number]
    unbent = forward_kinematics(chain.arrays, chain.rest.copy())
    R, p = np.concatenate([np.eye(3)[None], unbent.rotations]), np.concatenate([np.zeros((1, 3)), unbent.points])
    (start, length, frame), root = link.beam, of_link[0]
    axes = R[root.body] @ root.place.R @ frame.T  # axes of the link in frame 0
    origin = p[root.body] + R[root.body] @ root.place.p - axes @ start
    piece, body, position = _beam_position(sensor, chain, link, of_link)
    if sensor.point is not None:
        along, point = float((np.array(sensor.point) - start) @ frame[:, 0]), origin + axes @ sensor.point
        piece = _piece_at(of_link, along / length if length else 1.0)
        if link.rest_shape is not None:
            piece = min(of_link, key=lambda each: _distance(point, R[each.body], p[each.body], each))
        body = piece.body
        position = R[body].T @ (point - p[body])
    if link.rest_shape is not None:
        axes = R[piece.body] @ piece.place.R @ frame.T  # they turn along the beam
    if not body:
        why = "is mounted on a part that is fixed in frame 0; choose a position beyond the first hinge"
        raise SceneError(f"sensor.{sensor.name}: {why}", id="sensor-on-fixed-part")
    return body - 1, position, wanted if sensor.kind == "position" else wanted @ axes.T @ R[body]


def check_placements(scene: Scene) -> None:
    """Check the placement of all sensors of point motion before a run; errors as in `placement_of`."""
    for sensor in scene.sensor:
        if sensor.sees_points:
            placement_of(sensor, scene)


def _beam_position(sensor: Sensor, chain: Chain, link: Link, of_link: list[Piece]) -> tuple[Piece, int, Array]:
    """Piece, body number, from 1, and position in it of a sensor along the beam; by default at the end of the link."""
    if sensor.x is None and link.name in chain.tips:
        return of_link[-1], chain.tips[link.name] + 1, np.zeros(3)
    part = 1.0 if sensor.x is None or not link.beam.length else sensor.x / link.beam.length
    piece = _piece_at(of_link, part)
    first, last = piece.part
    gone = (part - first) / (last - first) if last > first else 0.0
    return piece, piece.body, piece.place.p + piece.place.R @ (piece.end * gone)


def _distance(point: Array, R: Array, p: Array, piece: Piece) -> float:
    """Distance of a point in frame 0 from a piece of a body with this pose [m]."""
    from_start = piece.place.R.T @ (R.T @ (point - p) - piece.place.p)
    return float(np.linalg.norm(from_start - np.clip(from_start, 0.0, piece.end)))


def _piece_at(of_link: list[Piece], part: float) -> Piece:
    """Piece of the link at the fraction `part` of its length; where two pieces meet, the outboard one."""
    return next((piece for piece in reversed(of_link) if piece.part[0] <= part), of_link[0])
