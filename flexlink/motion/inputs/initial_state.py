"""Initial state of a scene, with joints in the order of its chain."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.chain.shapes import on_shapes
from flexlink.common.errors import Diagnostic, SceneError
from flexlink.common.types import Array, Indices
from flexlink.common.wording import truncated
from flexlink.describe.joint_units import IN_METRES
from flexlink.describe.scene import Scene
from flexlink.dynamics.ties import Ties, closed, gaps, rows_by_tie, tie_rows
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.inputs.record import Inputs, MotionTable
from flexlink.motion.inputs.actuation import input_arrays, inputs_with, wrench_at
from flexlink.motion.inputs.drives import no_drive

Rows = tuple[tuple[float, ...], ...]  # rows of one number per link


def initial_state(scene: Scene, chain: Chain) -> tuple[Array, Array]:
    """Initial joint angles q0 [rad] and rates q̇0 [rad/s] in sequential order; [m] and [m/s] for sliding joints.

    Parameters
    ----------
    scene
        The scene. If initial.passive = "static", the hinges start bent by gravity and by the initial tip wrench, in
        equilibrium with the joints fixed. Ties are closed; joints that no drive holds then move to the equilibrium.
    chain
        Its chain, from `lump`.

    Returns
    -------
    tuple of ndarray
        q0 and q̇0, shape (n,) each.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene, or `chain` is not a Chain.
    SceneError
        `initial.q` or `initial.qd` does not have n numbers, or differs from a prescribed motion at `initial.time`.
    ConvergenceError
        passive = "static", and the arm has no equilibrium.

    Examples
    --------
    >>> q, qd = fl.initial_state(scene, chain)
    >>> print(np.degrees(q[chain.active]).round(1))  # °
    [ 30. -60.]
    >>> print(np.degrees(q[chain.index("upper", 1, 3)]).round(3))  # a hinge, bent by gravity
    -0.223
    """
    require_type("scene", scene, Scene)
    require_type("chain", chain, Chain)
    ties = tie_rows(scene, chain)
    inputs = inputs_with(no_drive(), scene, chain) if ties is None else input_arrays(scene, chain)
    return state_under(inputs, scene, chain, ties)


def state_under(inputs: Inputs, scene: Scene, chain: Chain, ties: Ties | None = None) -> tuple[Array, Array]:
    """Return the `initial_state` of a scene whose inputs are known, with its ties closed."""
    initial = scene.initial
    q = qd = np.zeros(chain.n)
    if initial.q is None or initial.qd is None:
        q, qd = stated(scene, chain)
    q, qd = _given("q", initial.q, q), _given("qd", initial.qd, qd)
    if chain.shapes is not None:
        on_shapes(chain, "initial.q", q - chain.rest)
        on_shapes(chain, "initial.qd", qd, "/s")
    if ties is not None:
        q, qd = closed(ties, chain, q, qd, initial.time)
    if initial.passive == "static" and ties is not None:
        from flexlink.dynamics.tied_tangent import tied_equilibrium  # noqa: PLC0415  statics

        held, g = held_joints(inputs, scene), gaps(ties, chain, q, initial.time)[0]
        for tie, own in rows_by_tie(scene.ties):
            if tie.lengths and not tie.only and abs(g[own][0]) > 0.15 * tie.lengths[0]:
                apart = f"{tie.lengths[0] + g[own][0]:.4g}"
                text = f"tie.{tie.name}.lengths[0] = {tie.lengths[0]:g} m: its points are {apart} m apart at the start"
                text = f"{text}, so the arm moves; give {apart}, or check its points"
                warnings.warn(Diagnostic(text, "ties-closed"), RuntimeWarning, stacklevel=4)
        q = tied_equilibrium(ties, chain, q, held, *wrench_at(inputs, initial.time), initial.time)
    elif initial.passive == "static" and len(chain.active) < chain.n:
        from flexlink.dynamics.equilibrium import static_posture  # noqa: PLC0415  statics

        q = static_posture(chain, q, *wrench_at(inputs, initial.time))
    if scene.motion:
        _check_followed(inputs.motion, scene, chain, q, qd)
    return q, qd


def held_joints(inputs: Inputs, scene: Scene) -> Indices:
    """Joints that a drive holds at rest: those with gains; all driven ones if none has, or if a model gives torques."""
    drive = inputs.drive
    by_model = scene.drive.kind == "computed_torque" or scene.drive.gravity != "none"
    return np.asarray(drive.joints[(drive.kp > 0.0) | by_model | (not drive.kp.any())])


def stated(scene: Scene, chain: Chain) -> tuple[Array, Array]:
    """q0 and q̇0 (n,) [rad, rad/s, m, m/s] as specified for joints and for a free base, with springs unloaded."""
    initial, base = scene.initial, scene.initial.base
    q, qd = chain.rest + spread(chain, scene.joint_positions), np.zeros(chain.n)
    if initial.rate_deg or initial.rate_m:
        qd = spread(chain, scene.joint_rates)
    if chain.has_free_base:
        q[:3], qd[:3], qd[3:6] = base.xyz, base.velocity, base.rates
    return q, qd


def spread(chain: Chain, per_link: Sequence[float] | Array) -> Array:
    """Put one number per link on that link's active joint, 0 on passive hinges; shape (n,)."""
    out = np.zeros(chain.n)
    for k in chain.active.tolist():
        out[k] = per_link[chain.coordinates[k].link - 1]
    return out


def by_unit(scene: Scene, chain: Chain, key: str, values: Array) -> dict[str, Rows]:
    """Values (m, d) of the driven joints in SI units, as lists under `key` [deg] and its twin [m] where needed."""
    slides, found = chain.slides[chain.active], dict[str, Rows]()
    for kind in {bool(each) for each in slides}:
        own = np.where(slides == kind, values if kind else np.degrees(values), 0.0)
        found[IN_METRES[key] if kind else key] = per_link(scene, chain, own)
    return found


def per_link(scene: Scene, chain: Chain, values: Array) -> Rows:
    """Rows of one number per link from values (m, d) of the driven joints."""
    rows = np.zeros((len(values), len(scene.arm.links)))
    rows[:, [chain.coordinate(int(k)).link - 1 for k in chain.active]] = values
    return tuple(map(tuple, rows.tolist()))


def _given(name: str, numbers: tuple[float, ...] | None, otherwise: Array) -> Array:
    if numbers is None:
        return otherwise
    if len(numbers) != len(otherwise):
        wanted = f"one number per joint and hinge, {len(otherwise)} (chain.joint_names)"
        text = f"expected {wanted}; joint angles alone are given as initial.joint_deg"
        raise SceneError(f"initial.{name} = {truncated(numbers)}: {text}", id="one-per-joint")
    return np.array(numbers)


def _check_followed(motion: MotionTable, scene: Scene, chain: Chain, q: Array, qd: Array) -> None:
    """Check that prescribed joints start with the position and rate of their motions."""
    there = q.copy(), qd.copy()
    follow(motion, scene.initial.time, *there, np.zeros(chain.n))
    for name, per, state, wanted in (("q", "", q, there[0]), ("qd", "/s", qd, there[1])):
        for k in motion.joints:
            # allowed difference of a state from a prescribed motion [rad, rad/s], relative where the motion exceeds 1:
            # the rounding error of numbers written with ten digits
            if abs(state[k] - wanted[k]) > 1e-9 * max(1.0, abs(wanted[k])):
                joint = chain.joint_name(int(k))
                place = f"{wanted[k]!r} {chain.joint_units[k]}{per} at t = {scene.initial.time:g} s"
                text = f"joint {joint!r} has a prescribed motion, which is at {place}"
                raise SceneError(f"initial.{name}[{k}] = {state[k]!r}: {text}", id="start-differs-from-motion")
