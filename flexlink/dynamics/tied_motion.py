"""What ties do in a run: accelerations, forces, internal loads, and their places in pictures."""

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Indices
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import accelerations_under
from flexlink.dynamics.free_motion import basis
from flexlink.dynamics.loads import InternalLoads, loads_of_bodies
from flexlink.dynamics.result import read_only
from flexlink.dynamics.terms import mass_matrix
from flexlink.dynamics.ties import Rows, Ties, gaps, number_of_rows, poses, rows_by_tie, springs, tie_rows
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.stepping.tie_rows import KIND, TIE, oil_pressures


def tied_motion(ties: Ties, chain: Chain, t: Array, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """q̈ (samples, n) with ties, and their multipliers (samples, r); `qdd` is q̈ without ties."""
    found = [tied_acceleration(ties, chain, *state) for state in zip(t.tolist(), q, qd, qdd, strict=True)]
    return read_only(np.array([a for a, _ in found])), read_only(np.array([λ for _, λ in found]))


def tied_acceleration(ties: Ties, chain: Chain, t: float, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
    """q̈ (n,) with ties, from q̈ without them, and the multipliers λ (r,) [N, N m]: M (q̈ − q̈⁰) = −Jᵀ λ.

    λ of springs follow from their law; those of exact rows from g̈ = 0, where J̇ q̇ is a central difference along q̇ with
    a relative error of 1e-10. Of redundant rows it is the least λ.
    """
    rows, lengths = ties
    g, J, moves = gaps(ties, chain, q, t)
    (λ, _), held = springs(ties, t, g, J @ qd + moves), np.isinf(rows["stiffness"])
    B = basis(chain, chain.free)
    Y = B @ np.linalg.solve(B.T @ mass_matrix(chain, q) @ B, B.T @ J.T)
    qdd = qdd - Y @ λ
    if held.any():
        moved, nudge = np.zeros((3, len(rows))), 1e-5 / max(np.abs(qd).max(), 1e-300)
        follow(lengths, t, *moved)
        ahead, back = (gaps(ties, chain, q + side * nudge * qd, t)[1] @ qd for side in (1.0, -1.0))
        bent = (ahead - back) / (2.0 * nudge) - moved[2]
        λ[held] = np.linalg.lstsq((J @ Y)[np.ix_(held, held)], (J @ qdd + bent)[held], rcond=1e-10)[0]
        qdd = qdd - Y[:, held] @ λ[held]
    return qdd, λ


def add_torques_of_ties(ties: Ties, chain: Chain, t: Array, q: Array, qd: Array, tau: Array, wrench: Array) -> None:
    """Add M (q̈ − q̈⁰) + Jᵀ λ at prescribed joints to `tau` (samples, n), the torques that their motions need for q̈⁰."""
    free = accelerations_under(tau, chain, q, qd, wrench)
    tied = tied_motion(ties, chain, t, q, qd, free)
    for now, angles, moves, torque, qdd, λ in zip(t.tolist(), q, free, tau, *tied, strict=True):
        more = mass_matrix(chain, angles) @ (qdd - moves) + gaps(ties, chain, angles, now)[1].T @ λ
        torque[chain.held] += more[chain.held]


def tied_loads(ties: Ties, chain: Chain, motion: tuple[Array, Array, Array], wrench: Array, λ: Array) -> InternalLoads:
    """Internal loads at samples of q, q̇, q̈ (samples, n) with tip wrenches (samples, 6) and multipliers (samples, r)."""
    found = [
        loads_of_bodies(chain, q, qd, qdd, of_tip, _on_bodies(ties[0], chain, q, own))
        for q, qd, qdd, of_tip, own in zip(*motion, wrench, λ, strict=True)
    ]
    parts = (np.array([vars(one)[name] for one in found]) for name in ("force", "moment", "hinge_moment"))
    return InternalLoads(*map(read_only, parts))


def _on_bodies(rows: Rows, chain: Chain, q: Array, λ: Array) -> tuple[Array, Array]:
    """Forces −λ u of ties on all bodies, and their moments about the origins (bodies, 3), in axes of frame 0."""
    (R, p), joints = poses(chain, q), rows["kind"] == KIND.joint
    force, moment = np.zeros((2, len(p), 3))
    for row, multiplier in zip(rows[~joints], λ[~joints], strict=True):
        a, b = row["a"], row["b"]
        end, u = p[a] + R[a] @ row["point_a"], R[b] @ row["along"]
        if row["kind"] == KIND.distance:
            apart = end - p[b] - R[b] @ row["point_b"]
            u = apart / (np.linalg.norm(apart) or np.inf)
        for body, pull in ((a, -multiplier * u), (b, multiplier * u)):  # both at the end on a, in line with the other
            force[body] += pull
            moment[body] += np.cross(end - p[body], pull)
    return force[:-1], moment[:-1]


class ByTie(dict[str, Array]):
    """Results by the name of a tie; another name raises an ArgumentError."""

    def __missing__(self, name: str) -> Array:
        return require_one_of("tie", name, self, "the scene has no such tie")


def tie_forces(scene: Scene, ties: Ties, λ: Array) -> ByTie:
    """Force of each tie by its name, from the multipliers (samples, r) of all rows, as in `Trajectory.tie_forces`."""
    return ByTie(
        (tie.name, -λ[:, own] @ ties[0]["along"][own] if number_of_rows(tie) > 1 else λ[:, own.start])
        for tie, own in rows_by_tie(scene.ties)
    )


def pressures(scene: Scene, ties: Ties, chain: Chain, t: Array, q: Array) -> ByTie:
    """Pressures (samples, 2) [Pa] of each cylinder by its name, at times t and angles q (samples, n)."""
    (rows, lengths), found = ties, {}
    g = np.array([gaps(ties, chain, *state)[0] for state in zip(q, t.tolist(), strict=True)])
    moved = np.zeros((len(t), 3, len(rows)))
    for now, parts in zip(t.tolist(), moved, strict=True):
        follow(lengths, now, *parts)
    for tie, own in rows_by_tie(scene.ties):
        if tie.kind == "cylinder":
            k, found[tie.name] = own.start, np.zeros((len(t), 2))
            oil_pressures(rows[k], moved[:, 0, k].copy(), g[:, k].copy(), found[tie.name])
    return ByTie((name, read_only(p)) for name, p in found.items())


def rods_of(scene: Scene, chain: Chain) -> tuple[Indices, Array]:
    """Bodies (2 t,), 0 for frame 0, and points in their axes (2 t, 3), of the ends of all ties that keep a distance."""
    ties = tie_rows(scene, chain)
    rows = np.zeros(0, TIE) if ties is None else ties[0][ties[0]["kind"] == KIND.distance]
    ends = np.stack([rows["a"], rows["b"]], axis=1).reshape(-1) + 1
    return ends, np.stack([rows["point_a"], rows["point_b"]], axis=1).reshape(-1, 3)
