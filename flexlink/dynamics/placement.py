"""Frames of an arm's bodies and of its tip, for one state or several (see `terms`)."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import beyond_float64, integer, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.batches import each, is_batch, rows
from flexlink.dynamics.bound import Bound, bound
from flexlink.dynamics.result import Result
from flexlink.kernels.geometry.kinematics import body_point, forward_kinematics, kinematics_workspace, tip_points
from flexlink.kernels.geometry.kinematics import jacobian as jacobian_kernel
from flexlink.kernels.tools.address import bind


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Frames(Result):
    """Frames of the `chain.bodies` in frame 0; the last one is the tip frame."""

    rotations: Array  # (…, bodies, 3, 3), R: v_0 = R v_body
    points: Array  # (…, bodies, 3), origins [m]

    def __repr__(self) -> str:
        *states, bodies, _ = self.points.shape
        return f"<Frames: {bodies} bodies{f' in {states[0]} states' if states else ''}>"


def frames(chain: Chain, q: ArrayLike) -> Frames:
    """Rotation and origin of every body frame in frame 0.

    The axes of a body are those of its hinges: at a joint about another axis than Z they are not those of its link,
    which are `rotations @ chain.described["link"]`; axes of the sections are `rotations @ chain.described["section"]`.
    Forward kinematics: Pinocchio's `forwardKinematics` and `oMi`, MuJoCo's `xmat` and `xpos`.

    Parameters
    ----------
    chain, q
        The chain; angles [rad], shape (n,), or (b, n) for b states.

    Returns
    -------
    Frames
        Rotations (bodies, 3, 3) and origins (bodies, 3) [m], or with a leading axis b; the last is the tip frame.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.

    Examples
    --------
    >>> placed = fl.frames(chain, q)
    >>> print(placed.points[-1, :2].round(4))  # the tip [m]
    [1.5578 0.092 ]
    """
    if is_batch(q):
        return each(frames, chain, {"q": q})
    arrays = require_type("chain", chain, Chain).arrays
    placed = forward_kinematics(arrays, vector("q", q, chain.n, many=True))
    return Frames(placed.rotations, placed.points)


def tip_position(chain: Chain, q: ArrayLike, *, tip: str | int | None = None) -> Array:
    """Origin of a tip frame in frame 0.

    Parameters
    ----------
    chain, q
        The chain; angles [rad], shape (n,), or (b, n) for b states.
    tip
        Name or number of a link without child links; default: the last link, whose end is the arm's tip.

    Returns
    -------
    Array
        The point, shape (3,), or (b, 3) [m].

    Raises
    ------
    ArgumentError
        As in `frames`; or the link has child links.

    Examples
    --------
    >>> print(fl.tip_position(chain, q)[:2].round(4))  # m, frame 0
    [1.5578 0.092 ]
    >>> print(fl.tip_position(chain, [q, 0 * q]).shape)  # several states
    (2, 3)
    """
    number = body_number(chain, -1, tip)
    if not is_batch(q):
        found, place = np.empty(3), points(chain)
        if not place(number, q, found) and not place(number, vector("q", q, chain.n, many=True), found):
            raise beyond_float64("a position", q=q)
        return found
    if number != len(chain.bodies) - 1:
        return np.asarray(frames(chain, q).points[..., number, :])
    (states,) = rows(require_type("chain", chain, Chain).n, {"q": q})
    tips = np.empty((len(states), 3))
    tip_points(chain.arrays, states, tips)
    return tips


@bound
def points(chain: Chain) -> Bound:
    """Origins of a chain's frames, a function of (body, q, point)."""
    given = chain.arrays, kinematics_workspace(chain.arrays)
    return bind(body_point, given, 0, np.zeros(chain.n), np.zeros(3))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Jacobian(Result):
    """Velocity of a point and angular velocity of its body, in frame 0, per unit rate of each joint."""

    linear: Array  # (…, 3, n), v = linear @ qd [m/rad]
    angular: Array  # (…, 3, n), ω = angular @ qd [1]

    def __repr__(self) -> str:
        *states, _, n = self.linear.shape
        return f"<Jacobian: {n} joints{f' in {states[0]} states' if states else ''}>"


def jacobian(
    chain: Chain, q: ArrayLike, *, body: int = -1, tip: str | int | None = None, point: ArrayLike | None = None
) -> Jacobian:
    """Geometric Jacobian of a point on a body: its velocity v = J_v q̇ and ω = J_ω q̇, in axes of frame 0.

    Pinocchio computes it in `LOCAL_WORLD_ALIGNED`, MuJoCo by `mj_jac`. For a hinge with axis e_k through p_k, column k
    is e_k × (p − p_k) in J_v and e_k in J_ω. For a sliding joint it is e_k in J_v and 0 in J_ω. For joints that are not
    between base and body it is 0. By virtual work a force f at the point and a moment m on the body are equivalent to
    joint torques J_vᵀ f + J_ωᵀ m.

    Parameters
    ----------
    chain, q
        The chain; angles [rad], shape (n,), or (b, n) for b states.
    body
        Number of the body in `chain.bodies`, as in `frames`: from 0, or backwards from −1, the tip frame.
    tip
        Instead of the body: name or number of a link without child links, whose tip frame is used.
    point
        The point relative to the origin of the body's frame, in axes of its link, shape (3,) [m]; None: the origin.

    Returns
    -------
    Jacobian
        `linear` and `angular`, shape (3, n), or (b, 3, n).

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or the body does not exist.

    Examples
    --------
    >>> J = fl.jacobian(chain, q)  # of the tip
    >>> print((J.linear @ np.ones(chain.n))[:2].round(3))  # m/s, all joints at 1 rad/s
    [1.032 5.186]
    """
    number, offset = body_number(chain, body, tip), ORIGIN
    if point is not None:
        offset = chain.described["link"][number] @ vector("point", point, 3)
    found = np.empty((2, 3, chain.n))
    columns = jacobian_columns(chain)
    if not columns(number, offset, q, found):
        if is_batch(q):
            return each(jacobian, chain, {"q": q}, body=body, tip=tip, point=point)
        q = vector("q", q, chain.n, many=True)
        if not columns(number, offset, q, found):
            raise beyond_float64("a position", q=q)
    found.setflags(write=False)  # also makes its parts read-only
    return Jacobian.of_read_only(linear=found[0], angular=found[1])


ORIGIN = np.zeros(3)  # the origin of a body's frame; it stays writable, as the compiled function expects


@bound
def jacobian_columns(chain: Chain) -> Bound:
    """J_v and J_ω of a chain's points, a function of (body, offset, q, found)."""
    given = chain.arrays, kinematics_workspace(chain.arrays)
    return bind(jacobian_kernel, given, 0, np.zeros(3), np.zeros(chain.n), np.zeros((2, 3, chain.n)))


def body_number(chain: Chain, body: int, tip: str | int | None) -> int:
    """Index of a body, given by its number or as the tip frame of a link; refuses others."""
    m = len(require_type("chain", chain, Chain).bodies)
    if tip is None and type(body) is int and body == -1:  # the most frequent case, without further checks
        return m - 1
    return integer("body", body, -m, m - 1) % m if tip is None else chain.tip_body(tip)


def hinges_before(chain: Chain, body: int) -> NDArray[np.bool_]:
    """Mask of the hinges between the base and a body, including the body's own hinges, shape (n,)."""
    first, stop = chain.bodies["first"], chain.bodies["stop"]
    if chain.is_serial:
        return np.asarray(np.arange(chain.n) < stop[body])
    before, number = np.zeros(chain.n, dtype=bool), body + 1
    while number:
        before[first[number - 1] : stop[number - 1]] = True
        number = int(chain.bodies["parent"][number - 1])
    return before


def hinge_bodies(chain: Chain) -> NDArray[np.intp]:
    """Index of the body that each hinge moves, shape (n,); the body's origin is the hinge point."""
    return np.repeat(np.arange(len(chain.bodies)), chain.bodies["stop"] - chain.bodies["first"])


def unbent(chain: Chain, q: Array) -> Array:
    """Return q with every spring at its rest angle and the angles of joints without springs unchanged."""
    return np.where(chain.stiffness > 0, chain.rest, q)


def slid_apart(chain: Chain, rates: NDArray[Any]) -> NDArray[Any]:
    """Set the rows of sliding joints in `rates` (n, …, 3) to zero; return the sum of those rows for each body."""
    slid = np.zeros((len(chain.bodies), *rates.shape[1:]), dtype=rates.dtype)
    if chain.slides.any():
        np.add.at(slid, hinge_bodies(chain)[chain.slides], rates[chain.slides])
        rates[chain.slides] = 0.0
    return slid
