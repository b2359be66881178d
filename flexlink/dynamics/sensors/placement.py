"""Placement of a sensor: its body, its position there, and the directions that it measures."""

from __future__ import annotations

import numpy as np

from flexlink.chain.builder import Piece
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump, pieces
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.directions import unit
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor, is_on_base
from flexlink.dynamics.floating_base import BODY
from flexlink.kernels.geometry.kinematics import forward_kinematics


def placement_of(sensor: Sensor, scene: Scene) -> tuple[int, Array, Array]:
    """Return where a sensor of point motion is placed on the lumped arm, and the directions that it measures.

    The result is the index of a body in `chain.bodies`, the point in its axes [m], (3,), and the measured directions as
    unit vectors (columns, 3), in axes of the body; for a position sensor, in axes of frame 0.

    On a flexible link the body is the segment at the sensor's position; at a hinge, the outboard segment.

    Raises
    ------
    SceneError
        The sensor is mounted on a part that is fixed in frame 0; or as in `lump`.
    """
    chain, arm = lump(scene), scene.arm
    wanted = np.eye(3) if sensor.axis is None else unit("axis", sensor.axis)[None]
    if is_on_base(sensor, arm):
        return BODY, np.array(sensor.point or (0.0, 0.0, 0.0)), wanted
    number = arm.number(sensor.link)
    link, of_link = arm.links[number - 1], [piece for piece in pieces(scene) if piece.link == number]
    unbent = forward_kinematics(chain.arrays, np.zeros(chain.n))
    R, p = np.concatenate([np.eye(3)[None], unbent.rotations]), np.concatenate([np.zeros((1, 3)), unbent.points])
    (start, length, frame), root = link.beam, of_link[0]
    axes = R[root.body] @ root.place.R @ frame.T  # axes of the link in frame 0
    origin = p[root.body] + R[root.body] @ root.place.p - axes @ start
    body, position = _beam_position(sensor, chain, link, of_link)
    if sensor.point is not None:
        along = float((np.array(sensor.point) - start) @ frame[:, 0])
        body = _piece_at(of_link, along / length if length else 1.0).body
        position = R[body].T @ (origin + axes @ sensor.point - p[body])
    if not body:
        raise SceneError(
            f"sensor.{sensor.name}: is mounted on a part that is fixed in frame 0; choose a position beyond the first "
            "hinge",
            id="sensor-on-fixed-part",
        )
    directions = wanted if sensor.kind == "position" else wanted @ axes.T @ R[body]
    return body - 1, position, directions


def check_placements(scene: Scene) -> None:
    """Check the placement of all sensors of point motion before a run; errors as in `placement_of`."""
    for sensor in scene.sensor:
        if sensor.sees_points:
            placement_of(sensor, scene)


def _beam_position(sensor: Sensor, chain: Chain, link: Link, of_link: list[Piece]) -> tuple[int, Array]:
    """Body number, from 1, and position in it of a sensor along the beam; by default at the end of the link."""
    if sensor.x is None and link.name in chain.tips:
        return chain.tips[link.name] + 1, np.zeros(3)
    part = 1.0 if sensor.x is None or not link.beam.length else sensor.x / link.beam.length
    piece = _piece_at(of_link, part)
    first, last = piece.part
    gone = (part - first) / (last - first) if last > first else 0.0
    return piece.body, piece.place.p + piece.place.R @ (piece.end * gone)


def _piece_at(of_link: list[Piece], part: float) -> Piece:
    """Piece of the link at the fraction `part` of its length; where two pieces meet, the outboard one."""
    return next((piece for piece in reversed(of_link) if piece.part[0] <= part), of_link[0])
