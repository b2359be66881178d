"""Ties of a scene as rows of the chain, and initial states in which they are closed."""

import warnings
from collections.abc import Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import open_chain
from flexlink.chain.rigid import matrix_from_rpy_deg
from flexlink.common.errors import ArgumentError, Diagnostic, SceneError
from flexlink.common.types import Array, Indices
from flexlink.common.wording import short_list, truncated
from flexlink.describe.directions import unit
from flexlink.describe.profiles import quintics
from flexlink.describe.run_settings import AUTO
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.describe.sensor import Sensor
from flexlink.describe.tie import Tie, TieEnd, refuse_ties
from flexlink.dynamics.free_motion import all_motions, basis
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.inputs.record import MotionTable, no_motion
from flexlink.kernels.stepping.tie_rows import KIND, TIE, find_rows, places_of, spring_forces

Rows = NDArray[np.void]
Ties = tuple[Rows, MotionTable]  # rows, and the lengths that move
CLOSED = 1e-9
"""Largest gap of a tie at the start, relative to the size of the arm, that rounding of its numbers explains."""
PASSES = 50  # Newton steps to close the ties at the start


def tie_rows(scene: Scene | None, chain: Chain) -> Ties | None:
    """The rows of a scene's ties on its open chain, None without ties; refuses what ties do not allow."""
    if scene is None or not require_type("ties", scene, Scene).ties:
        return None
    if (links := tuple(link.name for link in scene.arm.links)) != chain.link_names:
        why = f"its links are {short_list(links)}; those of the chain are {short_list(chain.link_names)}"
        raise ArgumentError(f"ties = {truncated(scene)}: {why}; give the scene of the chain", id="chains-differ")
    sampled, reference = scene.drive.rate is not None, scene.drive.reference
    for there, what in (
        (reference is not None and reference.follows == "tip", "drive.reference.follows = 'tip'"),
        # without a rate, Newton's matrix lacks the law's slopes, which stiff loops need
        (scene.drive.kind == "computed_torque" and not sampled, "drive.kind = 'computed_torque' without drive.rate"),
    ):
        if there:
            refuse_ties(scene.ties, f"{what} and ties together are not supported")
    name, opened = scene.run.method, open_chain(scene)
    rule = None if name == AUTO else method(name)
    if rule is not None and not (rule.explicit or len(rule.modes.real)):
        text = f"run.method = {name!r}: cannot hold tie {scene.ties[0].name!r}; use 'auto', 'Radau5' or 'Radau9'"
        raise SceneError(text, id="method-with-ties")
    rows = [_rows_of(tie, opened, chain) for tie in scene.ties]
    driven = {own.start: tie for tie, own in rows_by_tie(scene.ties) if tie.times}
    return np.concatenate(rows).view(np.recarray), _lengths([*driven.values()], np.array([*driven], dtype=np.int64))


def _lengths(ties: list[Tie], rows: Indices) -> MotionTable:
    """The lengths that move, as motions of these rows."""
    if not ties:
        return no_motion()
    pieces = [quintics(tie.times or (), np.array(tie.lengths or ())[:, None] * [1.0, 0.0, 0.0]) for tie in ties]
    first = np.cumsum([0, *map(len, pieces)], dtype=np.int64)
    return MotionTable(rows, first, np.concatenate([tie.times or () for tie in ties]), np.concatenate(pieces))


def number_of_rows(tie: Tie) -> int:
    """Number of rows of a tie: a hinge is two points on its axis, a weld three points; some rows are redundant."""
    if tie.kind == "point":
        return 3 if tie.to.axis is None else 1
    return {"slider": 2, "hinge": 6, "weld": 9}.get(tie.kind, 1)


def rows_by_tie(ties: Sequence[Tie]) -> Iterator[tuple[Tie, slice]]:
    """Each tie, and its rows among those of all ties."""
    first = 0
    for tie in ties:
        yield tie, slice(first, first := first + number_of_rows(tie))


def _rows_of(tie: Tie, scene: Scene, chain: Chain) -> Rows:
    """The rows of one tie."""
    rows = np.zeros(number_of_rows(tie), TIE)
    rows["stiffness"], rows["damping"] = np.inf if tie.stiffness is None else tie.stiffness, tie.damping
    rows["low"], rows["high"] = tie.range
    rows["dissipation"], rows["length"] = tie.dissipation, tie.length or 0.0
    if tie.kind == "cylinder":  # its stiffness is that of the oil at the first length
        shortest, longest = tie.stroke or (0.0, 0.0)
        bore, rod = (np.pi / 4 * (d or 0.0) ** 2 for d in (tie.bore, tie.rod))
        A = np.array([bore, rod - bore])
        rows["bulk"], rows["areas"], rows["pressures"] = tie.bulk_modulus, A, tie.pressures
        rows["volumes"] = tie.dead_volume - A * [shortest, longest]
        V = rows["volumes"] + A * (tie.lengths or (tie.length,))[0]
        rows["stiffness"] = (A**2 * tie.bulk_modulus / V).sum()
    if tie.on_joint:
        rows["kind"], rows["a"], rows["b"] = KIND.joint, chain.index(scene.arm.number(tie.link or 0), 0, 0), -1
        if tie.to.link is not None:
            rows["b"] = chain.index(scene.arm.number(tie.to.link), 0, 0)
            rows["ratio"] = 1.0 if tie.ratio is None else tie.ratio
        if chain.held[[j for j in (rows["a"][0], rows["b"][0]) if j >= 0]].all():
            text = f"tie.{tie.name}: the motion of its joint is prescribed; leave the tie out"
            raise SceneError(text, id="tie-of-locked-joint")
        if tie.kind == "stop":
            hinge = chain.hinges[rows["a"][0]]
            rows["low"], rows["high"] = hinge["lower"], hinge["upper"]
        return rows
    (a, point_a, axes_a), (b, point_b, axes_b) = (_place(end, tie.name, scene) for end in (tie, tie.to))
    x = (1.0, 0.0, 0.0)
    axis_b = unit("axis", tie.to.axis or tie.axis or x) @ axes_b
    rows["a"], rows["b"], rows["point_a"], rows["point_b"] = a, b, point_a, point_b
    rows["kind"] = KIND.distance if tie.has_length else KIND.point
    if tie.kind == "hinge":
        _add_points(rows, chain, unit("axis", tie.axis or x)[None] @ axes_a, axis_b[None])
    elif tie.kind == "weld":
        turned = matrix_from_rpy_deg(tie.to.rpy_deg or (0.0, 0.0, 0.0))
        _add_points(rows, chain, axes_a[:2], turned.T[:2] @ axes_b)
    elif tie.kind == "slider":
        rows["along"] = np.linalg.svd(axis_b[None])[2][1:]  # two directions across the line
    elif tie.kind == "point":
        rows["along"] = np.eye(3) if tie.to.axis is None else axis_b
    return rows


def _add_points(rows: Rows, chain: Chain, on_a: Array, on_b: Array) -> None:
    """Make rows of a point rows of more points, off the first along unit vectors (points, 3) in axes of both bodies."""
    rows["along"] = np.tile(np.eye(3), (1 + len(on_a), 1))
    for name, along in (("point_a", on_a), ("point_b", on_b)):
        rows[name][3:] += 0.1 * chain.size * np.repeat(along, 3, axis=0)


def _place(end: TieEnd, name: str, scene: Scene) -> tuple[int, Array, Array]:
    """Index of the body at one end of a tie, −1 for frame 0, the point [m], and the link's axes (3, 3), in its axes."""
    from flexlink.dynamics.sensors.signals import placement_of  # noqa: PLC0415  few scenes have ties

    if end.link is None:
        return -1, np.array(end.point), np.eye(3)
    there = Sensor(name="end", kind="accelerometer", link=end.link, x=end.x, point=end.point)
    try:
        return placement_of(there, scene)
    except SceneError as error:
        raise SceneError(str(error).replace("sensor.end", f"tie.{name}", 1), id=error.id) from None


def poses(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Rotations (bodies + 1, 3, 3) and origins (bodies + 1, 3) [m] of all bodies; the last, index −1, is frame 0."""
    placed = forward_kinematics(chain.arrays, q)
    return np.concatenate([placed.rotations, np.eye(3)[None]]), np.concatenate([placed.points, np.zeros((1, 3))])


def gaps(ties: Ties, chain: Chain, q: Array, t: float = 0.0) -> tuple[Array, Array, Array]:
    """g (r,) [m, rad] of all rows, J = ∂g/∂q (r, n) and ∂g/∂t (r,) at angles q (n,) and time t [s]."""
    rows, lengths = ties
    g, J, moved = np.zeros(len(rows)), np.zeros((len(rows), chain.n)), np.zeros((3, len(rows)))
    follow(lengths, t, *moved)
    find_rows(chain.arrays, rows, moved[0], q, places_of(chain.arrays), g, J)
    return g, J, -moved[1]


def acting(ties: Ties, chain: Chain) -> Ties:
    """The ties without exact rows that cannot open: no motion changes them, or others of constant length imply them.

    In a planar arm these are all rows across its plane, and a hinge's second point. The others imply a row if its J is
    the same sum of theirs at two postures of no special kind.
    """
    rows, lengths = ties
    constant = np.setdiff1d(np.flatnonzero(np.isinf(rows["stiffness"])), lengths.joints)
    J = np.hstack([gaps(ties, chain, f(np.arange(1.0, chain.n + 1)))[1] @ all_motions(chain) for f in (np.sin, np.cos)])
    parts = J[constant] / np.maximum(np.linalg.norm(J[constant], axis=1, keepdims=True), 1e-300)
    R, order = scipy.linalg.qr(parts.T, mode="r", pivoting=True) if len(constant) else (np.zeros((0, 0)), constant)
    implied = constant[order[np.count_nonzero(np.abs(np.diag(R)) > 1e-9) :]]
    left = np.setdiff1d(np.arange(len(rows)), implied[: len(rows) - 1])
    return rows[left], lengths._replace(joints=np.searchsorted(left, lengths.joints))


def springs(ties: Ties, t: float, g: Array, gd: Array) -> tuple[Array, Array]:
    """λ and ∂λ/∂g (r,) of all springs at time t [s] with g and ġ (r,); 0 for rows that are held."""
    (rows, lengths), moved, (λ, slopes) = ties, np.zeros((3, len(g))), np.zeros((2, len(g)))
    follow(lengths, t, *moved)
    spring_forces(rows, moved[0], g, gd, λ, slopes)
    return λ, slopes


def independent_rows(scene: Scene, chain: Chain, q: Array) -> list[int]:
    """Number of rows of each tie at angles q (n,) that do not depend on those of the ties before; 0 for springs."""
    ties = tie_rows(scene, chain)
    if ties is None:
        return []
    J, ranks = gaps(ties, chain, q, scene.initial.time)[1] @ basis(chain, chain.free), [0]
    exact = np.isinf(ties[0]["stiffness"])
    for _, own in rows_by_tie(scene.ties):
        held = np.flatnonzero(exact[: own.stop])
        ranks.append(int(np.linalg.matrix_rank(J[held], tol=1e-9)) if len(held) else 0)
    return np.diff(ranks).tolist()


def closed(ties: Ties, chain: Chain, q: Array, qd: Array, t: float) -> tuple[Array, Array]:
    """The state near q, q̇ (n,) in which all exact ties are closed; a warning names the joint that moved most.

    The driven joints and free joints move; springs only if these are not enough; prescribed joints never. Hinges with
    shapes keep to them. If no state near this one closes the ties, it raises a SceneError.
    """
    held = np.flatnonzero(np.isinf(ties[0]["stiffness"]))
    if not len(held):
        return q, qd
    start, near = q.copy(), CLOSED * chain.size
    found = [part[held] for part in gaps(ties, chain, q, t)]
    far = np.abs(found[0]).max()
    ways = [basis(chain, np.intersect1d(moving, chain.free)) for moving in (chain.active, chain.free)]
    for B in ways:
        q = start.copy()
        for _ in range(PASSES):
            found = [part[held] for part in gaps(ties, chain, q, t)]
            if np.abs(found[0]).max() <= 1e-14 * chain.size:
                break
            q -= B @ np.linalg.lstsq(found[1] @ B, found[0], rcond=1e-9)[0]
        found = [part[held] for part in gaps(ties, chain, q, t)]
        if np.abs(found[0]).max() <= near:
            break
    g, J, moves = found
    if not np.abs(g).max() <= near:
        why = f"tie: the ends are {far:.3g} m apart at the start, and meet in no posture near it"
        remedy = "give initial.joint_deg near a posture in which they meet, or move an end"
        raise SceneError(f"{why}; {remedy}", id="ties-open")
    for B, least in zip(ways, (1e-3, 1e-9), strict=True):  # joints far from a singular posture need no springs
        if np.abs(J @ qd + moves).max() > near:
            qd = qd - B @ np.linalg.lstsq(J @ B, J @ qd + moves, rcond=least)[0]
    moved = np.abs(q - start)
    if moved.max() > 1e-3:  # [rad, m]; a start with few digits explains less
        k = int(moved.argmax())
        text = f"joint {chain.joint_name(k)!r} moved by {moved[k]:.3g} {chain.joint_units[k]}"
        text = f"ties closed at the start, up to {far:.3g} apart before [m, rad]: {text}"
        warnings.warn(Diagnostic(f"{chain.name}: {text}", "ties-closed"), RuntimeWarning, stacklevel=5)
    return q, qd
