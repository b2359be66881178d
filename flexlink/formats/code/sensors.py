"""Signals of a scene's sensors on the tape of a model, without the effects of the instruments."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.sensor import OF_THE_DRIVE, Sensor, column_names
from flexlink.dynamics.free_motion import all_motions
from flexlink.dynamics.point_motion import motion_of_bodies, of_point
from flexlink.dynamics.sensors.signals import gauge_slope, gauge_strain, joint_of, placement_of
from flexlink.formats.code.model import Model, Objects, on_tape, state_of
from flexlink.formats.code.tape import Number, Real
from flexlink.kernels.geometry.kinematics import forward_kinematics


def signals_of(model: Model, scene: Scene | None) -> tuple[dict[str, Real], list[Number]]:
    """Signals by name with unit, and z̈, which is constant in their derivatives by all but itself."""
    chain, held, found = model.chain, [model.tape.hold(z) for z in model.rate[len(model.x) // 2 :]], dict[str, Real]()
    if scene is None or not scene.sensor:
        return found, held
    if not chain.same_layout(lump(open_chain(scene))):
        raise ArgumentError("scene: is not that of the chain; give the scene that was lumped", id="chains-differ")
    q, qd, tau, _ = state_of(chain, model.x, model.u)
    if any(sensor.sees_points for sensor in scene.sensor):  # other signals need no operations of bodies
        placed = on_tape(forward_kinematics)(model.arrays, q)
        R, p, axes, qdd = (part[:, None] for part in (*placed, all_motions(chain) @ np.array(held, object)))
        moving = motion_of_bodies(chain, R, p, axes, qd[:, None], qdd)  # of one state
    for sensor in scene.sensor:
        if sensor.sees_points:
            body, point, directions = placement_of(sensor, scene)
            position, _, _, accelerometer, gyroscope = of_point(moving, body, point, model.arrays.gravity)
            seen = {"position": position, "accelerometer": accelerometer, "gyroscope": gyroscope}[sensor.kind]
            values = [sum(direction * seen[0]) for direction in directions]
        elif sensor.kind == "strain":
            values = [_strain(sensor, scene, model, q)]
        else:
            values = [_of_drive(sensor, scene, model, q if sensor.kind == "joint" else tau)]
        plain = replace(sensor, gain=1.0, unit=None)
        found |= dict(zip(column_names([plain], scene.arm), values, strict=True))
    return found, held


def _of_drive(sensor: Sensor, scene: Scene, model: Model, values: Objects) -> Real:
    """Angle, torque or current of a joint."""
    if sensor.kind not in OF_THE_DRIVE:
        text = f"sensor.{sensor.name}: kind = {sensor.kind!r}: code and FMUs have no ties; leave the sensor out"
        raise SceneError(text, id="not-representable")
    k = joint_of(sensor, model.chain, scene)
    if sensor.kind != "joint" and model.chain.held[k]:
        text = f"sensor.{sensor.name}: the torque of a joint with a given motion is not in FMUs; leave the sensor out"
        raise SceneError(text, id="not-representable")
    signal: Real = values[k] / (sensor.torque_constant or 1.0)
    return signal


def _strain(sensor: Sensor, scene: Scene, model: Model, q: Objects) -> Real:
    """Strain of a gauge, which is linear in the angles."""
    link = scene.arm.links[scene.arm.number(sensor.link) - 1]
    if lumping_rule(link.lumping).springs == "rotation" and link.flex == "xyz":
        why = f"lumping = {link.lumping!r}: the strain of springs of rotation vectors is not in FMUs"
        raise SceneError(f"sensor.{sensor.name}: {why}; use 'gauss' or 'lobatto2'", id="not-representable")
    rest: Array = model.chain.rest
    slope = gauge_slope(sensor, scene, model.chain, rest)
    strain: Real = gauge_strain(sensor, scene, rest[None])[0] + sum(slope * (q - rest))
    return strain
