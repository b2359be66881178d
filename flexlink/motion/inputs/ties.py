"""Ties of a scene as rows of the chain, and initial states in which they are closed."""

from __future__ import annotations

import warnings

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import Diagnostic, SceneError
from flexlink.common.types import Array
from flexlink.describe.directions import unit
from flexlink.describe.run_settings import AUTO
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.describe.sensor import Sensor
from flexlink.describe.spec import build_unchecked
from flexlink.describe.tie import Tie, TieEnd, refuse_ties
from flexlink.dynamics.free_motion import basis
from flexlink.kernels.geometry.kinematics import kinematics_workspace
from flexlink.kernels.stepping.ties import KIND, TIE, find_rows

Rows = NDArray[np.void]
CLOSED = 1e-9
"""Largest gap of a tie at the start, relative to the size of the arm, that rounding of its numbers explains."""
PASSES = 50  # Newton steps to close the ties at the start
ROUNDED = 1e-3
"""Motion of a joint [rad, m] that explains a start with few digits; only larger ones are worth a warning."""


def open_chain(scene: Scene) -> Scene:
    """The scene without its ties."""
    opened: Scene = build_unchecked(replace, scene, tie=()) if scene.tie else scene
    return opened


def tie_rows(scene: Scene, chain: Chain) -> Rows | None:
    """The rows of all ties of a scene on its open chain; None if it has no ties.

    Raises
    ------
    SceneError
        The scene contains something that ties do not allow, or a tie is on a part that is fixed in frame 0.
    """
    if not scene.tie:
        return None
    for there, what in (
        (scene.motion, "[[motion]]"),
        (scene.sensor, "a sensor"),
        (scene.initial.passive == "static", "initial.passive = 'static'"),
        (scene.drive.kind == "computed_torque", "drive.kind = 'computed_torque'"),
        (scene.drive.gravity != "none", f"drive.gravity = {scene.drive.gravity!r}"),
    ):
        if there:
            refuse_ties(scene.tie, f"{what} and ties together are not supported")
    name, opened = scene.run.method, open_chain(scene)
    rule = None if name == AUTO else method(name)
    if rule is not None and (rule.explicit or not len(rule.modes.real)):
        text = f"run.method = {name!r}: cannot hold tie {scene.tie[0].name!r}; use 'auto', 'Radau5' or 'Radau9'"
        raise SceneError(text, id="method-with-ties")
    return np.concatenate([_rows_of(tie, opened, chain) for tie in scene.tie])


def _rows_of(tie: Tie, scene: Scene, chain: Chain) -> Rows:
    """The rows of one tie: a hinge is two points on its axis, whose sixth row is redundant."""
    a, point_a, axis_a = _place(tie, tie.axis, tie.name, scene)
    b, point_b, axis_b = _place(tie.to, tie.to.axis or tie.axis, tie.name, scene)
    if tie.kind == "distance":
        rows = np.zeros(1, TIE)
        rows["kind"], rows["length"] = KIND.distance, tie.length
    else:
        rows = np.zeros(3 if tie.kind == "point" else 6, TIE)
        rows["kind"], rows["along"] = KIND.point, np.tile(np.eye(3), (len(rows) // 3, 1))
    rows["a"], rows["b"], rows["point_a"], rows["point_b"] = a, b, point_a, point_b
    rows["point_a"][3:] += 0.1 * chain.size * axis_a
    rows["point_b"][3:] += 0.1 * chain.size * axis_b
    return rows


def _place(
    end: Tie | TieEnd, axis: tuple[float, float, float] | None, name: str, scene: Scene
) -> tuple[int, Array, Array]:
    """Index of the body at one end of a tie, −1 for frame 0, and the point [m] and the axis in its axes."""
    from flexlink.dynamics.sensors.signals import placement_of  # noqa: PLC0415  few scenes have ties

    direction = (1.0, 0.0, 0.0) if axis is None else axis
    if end.link is None:
        return -1, np.array(end.point), unit("axis", direction)
    there = Sensor(name="end", kind="accelerometer", link=end.link, x=end.x, point=end.point, axis=direction)
    try:
        body, point, (along,) = placement_of(there, scene)
    except SceneError as error:
        raise SceneError(str(error).replace("sensor.end", f"tie.{name}", 1), id=error.id) from None
    return body, point, along


def gaps(rows: Rows, chain: Chain, q: Array) -> tuple[Array, Array]:
    """g (r,) [m] of all rows and J = ∂g/∂q (r, n) at angles q (n,)."""
    g, J = np.zeros(len(rows)), np.zeros((len(rows), chain.n))
    find_rows(chain.arrays, rows, q, kinematics_workspace(chain.arrays), g, J)
    return g, J


def closed(rows: Rows | None, chain: Chain, q: Array, qd: Array) -> tuple[Array, Array]:
    """The state near q, q̇ (n,) in which all ties are closed; a warning names the joint that moved most.

    The driven joints and free joints move; springs only if these are not enough. Hinges with shapes keep to them.

    Raises
    ------
    SceneError
        No state near this one closes the ties.
    """
    if rows is None:
        return q, qd
    start, near = q.copy(), CLOSED * chain.size
    ways = [basis(chain, moving) for moving in (chain.active, np.arange(chain.n))]
    for B in ways:
        q = start.copy()
        for _ in range(PASSES):
            g, J = gaps(rows, chain, q)
            if np.abs(g).max() <= 1e-14 * chain.size:
                break
            q -= B @ np.linalg.lstsq(J @ B, g, rcond=1e-9)[0]
        g, J = gaps(rows, chain, q)
        if np.abs(g).max() <= near:
            break
    if not np.abs(g).max() <= near:
        far = np.abs(gaps(rows, chain, start)[0]).max()
        raise SceneError(
            f"tie: the ends are {far:.3g} m apart at the start, and meet in no posture near it; give "
            "initial.joint_deg near a posture in which they meet, or move an end",
            id="ties-open",
        )
    for B, least in zip(ways, (1e-3, 1e-9), strict=True):  # joints far from a singular posture need no springs
        if np.abs(J @ qd).max() > near:
            qd = qd - B @ np.linalg.lstsq(J @ B, J @ qd, rcond=least)[0]
    moved = np.abs(q - start)
    if moved.max() > ROUNDED:
        k = int(moved.argmax())
        text = f"ties closed at the start: joint {chain.joint_name(k)!r} moved by {moved[k]:.3g} {chain.joint_units[k]}"
        warnings.warn(Diagnostic(f"{chain.name}: {text}", "ties-closed"), RuntimeWarning, stacklevel=4)
    return q, qd
