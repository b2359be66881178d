"""Scenes driven by a computed tip motion, and by the same move of their joints."""

from __future__ import annotations

import math

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.drive import Drive
from flexlink.describe.initial import InitialState
from flexlink.describe.reference import OF_MOTION, Reference
from flexlink.describe.scene import Scene
from flexlink.dynamics.tip_inversion.feedforward import Feedforward
from flexlink.dynamics.tip_inversion.moves import unshaped
from flexlink.motion.inputs.initial_state import Rows, by_unit, per_link
from flexlink.motion.inputs.tip_reference import acting_torques, from_rest_to_rest


def driven_scene(scene: Scene, chain: Chain, found: Feedforward) -> tuple[Scene, float]:
    """The scene driven by the inverse, later by a shift [s] so that its torques begin at t >= 0; and this shift."""
    drive, run, q = scene.drive, scene.run, found.path.postures
    shift = max(0.0, -float(found.times[0]))
    times = found.times + shift
    rows: dict[str, Rows] = {}
    for key, part in zip(OF_MOTION, from_rest_to_rest(found), strict=True):
        rows |= by_unit(scene, chain, key, part[:, chain.active])
    torques = acting_torques(scene, found)
    table = tuple(times.tolist())
    driven = Drive(
        kind="pd", kp=drive.kp, kd=drive.kd, reference=Reference(profile="smooth", times=table, **rows),  # type: ignore[arg-type]
        times=table, torques=per_link(scene, chain, torques), smooth=True, effort=drive.effort, rate=drive.rate,
        delay=drive.delay,
    )  # fmt: skip
    spacing = _spacing(scene, found.move.duration)
    samples = math.ceil(max(run.duration + shift, times[-1]) / spacing - 1e-9)
    changes = {"run.sample": spacing, "run.duration": float(f"{samples * spacing:.12g}")}
    return scene.varied({"drive": driven, "initial": _at_rest(scene, chain, q[0]), **changes}), shift


def _spacing(scene: Scene, duration: float) -> float:
    """Time between samples: as in the scene, or a fraction that gives 50 samples per move, which show its error."""
    run, rate = scene.run, scene.drive.rate
    parts = math.ceil(50 * run.spacing / duration - 1e-9)
    if rate is not None or not run.controlled:  # samples are at sampling instants, or at ends of steps
        units = round(run.spacing * (rate or 1.0 / run.fixed_step))
        parts = next((k for k in range(parts, units) if units % k == 0), max(1, units))
    return float(f"{run.spacing / parts:.12g}")


def joint_scene(scene: Scene, chain: Chain, found: Feedforward, *, straight: bool) -> Scene:
    """The scene with the same move of its joints by PD, without input shaper; gravity is compensated if it acts."""
    q, changes = found.path.postures, dict[str, object]()
    if straight:
        ends = by_unit(scene, chain, "to_deg", q[-1:, chain.active])
        changes["drive.reference"] = Reference(
            profile="quintic", duration=found.move.duration, **{key: rows[0] for key, rows in ends.items()}  # type: ignore[arg-type]
        )  # fmt: skip
        changes |= {"drive.target_deg": None, "drive.target_m": None}
    if any(scene.gravity) and scene.drive.gravity == "none":
        changes |= {"drive.times": None, "drive.torques": None, "drive.gravity": "static"}
    if scene.drive.reference is not None and not straight:
        changes["drive.reference.follows"] = "joints"
    return unshaped(scene).varied({**changes, "initial": _at_rest(scene, chain, q[0])})


def _at_rest(scene: Scene, chain: Chain, posture: Array) -> InitialState:
    """Initial state at rest in a posture (n,); locked joints keep their angles."""
    starts = by_unit(scene, chain, "joint_deg", posture[None, chain.active])
    rows = []
    for key, before in (("joint_deg", scene.initial.joint_deg), ("joint_m", scene.initial.joint_m)):
        row = starts.get(key, ((0.0,) * len(scene.arm.links),))[0]
        own = zip(before or (0.0,) * len(row), row, scene.arm.links, strict=True)
        rows.append(tuple(old if link.joint.locked else new for old, new, link in own))
    return InitialState(joint_deg=rows[0], joint_m=rows[1] if any(rows[1]) else None, passive="static")
