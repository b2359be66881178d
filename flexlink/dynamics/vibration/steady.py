"""Modes of an arm at rest or in steady motion, such as turning with a spinning shaft or moving along a rail.

A motion with constant rates is an equilibrium of the other joints, T_GC(q, q̇) + T_FL(q) = 0, if these torques, M and K
do not change along it. They are constant without gravity, with gravity along the shaft, and for loads that turn with
the tip.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import Kind
from flexlink.chain.layout import Joints
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.actions import Frame
from flexlink.dynamics import rounding
from flexlink.dynamics.equilibrium import Equilibrium, solve_static
from flexlink.dynamics.forces import turns_with_tip
from flexlink.dynamics.placement import unbent
from flexlink.dynamics.tangent import LoadedState, load_torque, stiffness_matrix, unlocked
from flexlink.dynamics.terms import mass_matrix
from flexlink.dynamics.vibration.modal import Modes, modes


def modes_in_motion(
    chain: Chain, rates: Mapping[str, float], q: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", locked: Joints = (), count: int | None = None,
) -> Modes:  # fmt: skip
    """Modes of an arm about a steady motion in which some joints move at constant rates.

    The configuration is `equilibrium_in_motion`, in which centrifugal forces, gravity, springs and loads balance. The
    modes include centrifugal stiffness and gyroscopic coupling: M δq̈ + (D + G) δq̇ + K δq = 0, as in `modes`.

    Parameters
    ----------
    chain, rates
        The chain, and constant rates [rad/s], or [m/s] of sliding joints, by link name; these joints are held at their
        rates.
    q
        Initial configuration [rad], shape (n,); default: springs slack, joints at zero.
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame.
    locked
        Further locked coordinates, as in `modes`; a driven joint that is not locked moves freely.
    count
        Number of modes, slowest first; None: all.

    Returns
    -------
    Modes
        Eigenvalues [1/s], mode shapes, paths [m], slowest first.

    Raises
    ------
    ArgumentError
        `rates` names a joint that is not driven, or is locked; the motion is not steady, for example under gravity or a
        load across a shaft; or as in `modes`.
    ConvergenceError, SingularMassError
        As in `solve_static` and `modes`.

    Examples
    --------
    >>> level = fl.lump(scene.varied({"gravity": (0.0, 0.0, 0.0)}))  # no gravity across the shaft
    >>> for rate in (0.0, 30.0):  # rad/s
    ...     print(fl.small_motion.modes_in_motion(level, {"upper": rate}, locked=["fore"], count=2).hertz.round(2))
    [ 4.98 65.28]
    [ 5.45 70.4 ]
    """
    turning, held = _moving(chain, rates, locked)
    rest = _steady_posture(chain, turning, held, q, tip_wrench, frame)
    return modes(chain, rest.q, turning, tip_wrench=tip_wrench, frame=frame, locked=held, count=count)


def equilibrium_in_motion(
    chain: Chain, rates: Mapping[str, float], q: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", locked: Joints = (),
) -> Equilibrium:  # fmt: skip
    """Configuration of an arm with some joints at constant rates; all others satisfy T_GC(q, q̇) + T_FL(q) = 0.

    It is the result of `solve_static(chain, q, qd)`, starting from slack springs, with a check for steady motion.

    Parameters
    ----------
    chain, rates, q, tip_wrench, frame, locked
        As in `modes_in_motion`; only the driven joints of `q` [rad, m], shape (n,), have an effect.

    Returns
    -------
    Equilibrium
        As in `solve_static`.

    Raises
    ------
    ArgumentError, ConvergenceError, SingularMassError
        As in `modes_in_motion`.

    Examples
    --------
    >>> level = fl.lump(scene.varied({"gravity": (0.0, 0.0, 0.0)}))
    >>> start = [0, 0, 0, 1.0, 0, 0]  # rad
    >>> bent = fl.small_motion.equilibrium_in_motion(level, {"upper": 3.0}, start, locked=["fore"])  # rad/s
    >>> print(np.degrees(bent.q[level.bending]).round(2))  # the elbow is bent, and swings outward
    [-0.02 -0.07 -0.06 -0.01]
    """
    turning, held = _moving(chain, rates, locked)
    return _steady_posture(chain, turning, held, q, tip_wrench, frame)


def _steady_posture(
    chain: Chain, turning: Array, held: NDArray[np.intp], q: ArrayLike | None, tip_wrench: ArrayLike | None,
    frame: Frame,
) -> Equilibrium:  # fmt: skip
    """Equilibrium of the other joints while the joints in `held` move at their rates (n,)."""
    start = unbent(chain, chain.rest.copy() if q is None else vector("q", q, chain.n))
    rest = solve_static(chain, start, turning, tip_wrench=tip_wrench, frame=frame, locked=held)
    if turning.any():
        acting = turning, wrench_vector(tip_wrench), turns_with_tip(frame)
        _check_steady(chain, LoadedState(rest.q, *acting, unlocked(chain, held)))
    return rest


def _moving(chain: Chain, rates: Mapping[str, float], locked: Joints) -> tuple[Array, NDArray[np.intp]]:
    """Rates of all joints (n,), 0 for joints that are not named, and the indices of the held joints."""
    turning = np.zeros(require_type("chain", chain, Chain).n)
    if not isinstance(rates, Mapping) or not rates:
        why = f"rates = {truncated(rates)}: expected a dict such as {{'hub': 50.0}}, in rad/s"
        raise ArgumentError(why, id="wrong-type")
    named = [steady_joint(chain, name) for name in rates]
    for k, (name, rate) in zip(named, rates.items(), strict=True):
        turning[k] = vector(f"rates[{name!r}]", [rate], 1)[0]
    held = chain.joint_indices("locked", locked)
    for k in named:
        if k in held and turning[k]:
            why = f"locked: {chain.joint_name(k)!r} moves with a rate of {turning[k]:g}; leave it out"
            raise ArgumentError(why, id="locked-and-moving")
    return turning, np.union1d(named, held).astype(np.intp)


def steady_joint(chain: Chain, name: str) -> int:
    """Index of the joint called `name`; refuses locked joints and hinges with springs."""
    k = chain.joint_index("rates", name, perhaps_locked=True)
    if k < 0:
        why = f"rates: {name!r} is locked in the scene; set its joint.locked to false, so that it moves at its rate"
        raise ArgumentError(why, id="locked-and-moving")
    if chain.coordinates[k].kind not in (Kind.JOINT, Kind.BASE):
        driven = ", ".join(chain.joint_name(int(each)) for each in chain.active)
        why = f"rates: {name!r} is a hinge with a spring; name a driven joint: {driven}"
        raise ArgumentError(why, id="rate-of-hinge")
    return k


def _check_steady(chain: Chain, steady: LoadedState) -> None:
    """Refuse a motion along which torques, M or K of the free coordinates change."""
    step = steady.qd / np.abs(steady.qd / rounding.scales(chain)).max()
    now = _scaled_terms(chain, steady.q, steady)
    terms = "the torques on", "the inertia of", "the stiffness of"
    for far in (1.0, 2.5):  # along the motion [rad]; of sliding joints as multiples of the arm's length
        for what, before, after in zip(terms, now, _scaled_terms(chain, steady.q + far * step, steady), strict=True):
            if np.abs(after - before).max() > 1e-9:  # more than rounding errors
                moving = ", ".join(chain.joint_name(int(k)) for k in np.flatnonzero(steady.qd))
                why = f"it changes {what} the free joints, for example under gravity or a load across a shaft"
                remedy = "; turn about the axis of gravity, or set gravity = [0, 0, 0]" * ("torques" in what)
                text = f"rates: the motion of {moving} is not steady: {why}; modes exist only about a steady motion"
                raise ArgumentError(text + remedy, id="no-steady-motion")


def _scaled_terms(chain: Chain, q: Array, steady: LoadedState) -> tuple[Array, Array, Array]:
    """T_GC, M and K of the free coordinates in a configuration, each relative to the magnitude of its terms."""
    _, qd, wrench, _, free = steady
    loads = rounding.largest_load_stiffness(chain, qd, wrench)
    stiff = np.sqrt(np.where(chain.stiffness + loads > 0, chain.stiffness + loads, 1.0))[free]
    M, block = mass_matrix(chain, q), np.ix_(free, free)
    inertia = np.sqrt(M.diagonal())[free]
    torque = load_torque(chain, q, *steady[1:4]) / np.where(loads > 0, loads, 1.0)
    K = stiffness_matrix(chain, q, *steady[1:4])
    return torque[free], M[block] / np.outer(inertia, inertia), K[block] / np.outer(stiff, stiff)


def rest_of(chain: Chain, q: Array, *, tip_wrench: ArrayLike | None = None, frame: Frame = "world") -> Equilibrium:
    """Static equilibrium with the driven joints held at their angles in q (n,) [rad]; errors as in `solve_static`."""
    return solve_static(chain, unbent(chain, q), tip_wrench=tip_wrench, frame=frame, locked=chain.active.tolist())


def modes_at_rest(
    chain: Chain, rest: Equilibrium, *, tip_wrench: ArrayLike | None = None, frame: Frame = "world",
    count: int | None = None,
) -> Modes:  # fmt: skip
    """The `count` slowest modes, or all, about the equilibrium `rest` with the driven joints held."""
    return modes(chain, rest.q, tip_wrench=tip_wrench, frame=frame, locked=chain.active.tolist(), count=count)


def first_elastic_frequency(
    chain: Chain, q: Array, *, tip_wrench: ArrayLike | None = None, frame: Frame = "world"
) -> float:
    """Lowest elastic frequency at rest [Hz] with driven joints held; nan if none. Errors as in `solve_static`."""
    if not (chain.stiffness[~chain.held] > 0).any():
        return np.nan
    rest = rest_of(chain, q, tip_wrench=tip_wrench, frame=frame)
    few = modes_at_rest(chain, rest, tip_wrench=tip_wrench, frame=frame, count=8).first_elastic_hertz
    if np.isfinite(few):  # for a long chain, all modes cost much more
        return few
    return modes_at_rest(chain, rest, tip_wrench=tip_wrench, frame=frame).first_elastic_hertz
