"""Static equilibrium under gravity, tip wrench and drive torque, and whether it is stable."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import positive, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.chain.layout import Joints
from flexlink.common.errors import ConvergenceError
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics import rounding
from flexlink.dynamics.load_path import Equations, LostError, follow
from flexlink.dynamics.result import SavedResult
from flexlink.dynamics.tangent import LoadedState, load_torque, unlocked
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.wrench import turns_with_tip


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(SavedResult):
    """A posture in which all torques balance.

    Attributes
    ----------
    q
        Angles [rad], shape (n,).
    tau
        T_EX with which it rests, shape (n,) [N m]: T_GC + T_FL where a coordinate is locked or its motion prescribed,
        what holds it there; elsewhere as given. About it, `linearize(chain, rest.q, tau=rest.tau)` has ẋ = 0.
    residual
        Largest torque left over on a coordinate that is not locked [N m].
    stable
        No coordinate can fall: no eigenvalue of the tangent stiffness has a negative real part, beyond rounding; a
        joint that nothing holds rests. (A follower wrench can also flutter: see `modes`.)
    path
        The (s, q) of all steps, shape (steps, 1 + n); s is the part of the load that is on.
    slides
        Which joints slide, shape (n,).
    """

    q: Array
    tau: Array
    residual: float
    stable: bool
    path: Array
    slides: NDArray[np.bool_]

    def __repr__(self) -> str:
        turned, slid = (np.abs(self.q[which]).max(initial=0.0) for which in (~self.slides, self.slides))
        out = [f"angles up to {np.degrees(turned):.4g}°"] if not self.slides.all() else []
        out += [f"places up to {slid:.4g} m"] if self.slides.any() else []
        return (
            f"<Equilibrium: {'' if self.stable else 'un'}stable; {len(self.q)} joints at {' and '.join(out)}, "
            f"{self.residual:.2g} N m left over>"
        )


def solve_static(
    chain: Chain,
    q: ArrayLike | None = None,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
    locked: Joints = (),
    tolerance: float = 1e-9,
) -> Equilibrium:
    """Posture in which gravity, springs, tip wrench and drive torque balance: T_GC(q, q̇) + T_FL(q) = T_EX.

    Newton's method along the arc length of the path on which the load grows (Riks 1979; Crisfield 1981).

    Parameters
    ----------
    chain
        The chain.
    q
        Posture to start from [rad], shape (n,); default: springs slack, joints at zero. Locked ones stay there.
    qd
        Constant rates [rad/s], shape (n,), for the relative equilibrium of a steadily turning arm.
    tau
        Drive torque T_EX [N m], shape (n,).
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame,
        with which they turn.
    locked
        Coordinates that do not move: names or sequential indices of joints, names of links, or a boolean mask,
        shape (n,).
    tolerance
        Newton's method stops after a correction of no angle by more than this [rad], of joints that slide by so much
        of the arm's length; the error that is left is of the order of its square, or rounding.

    Returns
    -------
    Equilibrium
        The posture [rad], whether it is stable, and the path to it.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names no coordinate.
    ConvergenceError
        The path from q does not reach the full load; the error holds the posture at the largest part reached.

    Examples
    --------
    >>> rest = fl.solve_static(chain, q, locked=["upper", "fore"])
    >>> print(rest.stable, rest.tau[chain.active].round(2))  # N m that hold the driven joints
    True [77.6  30.31]
    """
    n = require_type("chain", chain, Chain).n
    follower, tolerance = turns_with_tip(frame), positive("tolerance", tolerance)
    start = chain.rest.copy() if q is None else vector("q", q, n).copy()
    wrench = wrench_vector(tip_wrench)
    drive = np.zeros(n) if tau is None else vector("tau", tau, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    free = unlocked(chain, locked)
    equations = Equations(chain, LoadedState(start, rates, wrench, follower, free), drive)
    posture, path = at_rest(equations, tolerance)
    holding = load_torque(chain, posture, rates, wrench, follower) + elastic_torque(chain, posture)
    holding[free] = drive[free]
    return Equilibrium(
        posture,
        holding,
        float(np.abs(equations.value(np.concatenate([[1.0], posture]))).max()),
        not equations.falls(posture),
        np.array(path),
        chain.slides,
    )


def at_rest(equations: Equations, tolerance: float = 1e-9) -> tuple[Array, list[Array]]:
    """The posture of an equilibrium, and the path to it; errors as in `solve_static`, where the default stands, too."""
    chain, (_, rates, wrench, _, free) = equations.chain, equations.acting
    try:
        path = follow(equations, tolerance)
    except LostError as lost:
        loose = np.intersect1d(chain.active, free)
        hint = "; hold free joints with locked=chain.active, if they are meant to stay" if len(loose) else ""
        left = np.abs(equations.value(np.concatenate([[1.0], lost.q]))).max()
        raise ConvergenceError(
            f"solve_static: no equilibrium found; {lost.steps} steps from q reached {lost.part:.6g} of the load, "
            f"where the full load leaves {left:.3g} N m unbalanced{hint}",
            q=lost.q,
            load=lost.part,
            id="no-equilibrium",
        ) from None
    return _as_known(chain, path[-1][1:], free, rates, wrench), path


def _as_known(chain: Chain, q: Array, free: NDArray[np.intp], qd: Array, wrench: Array) -> Array:
    """q with the deflection of every spring to the decimals that its load is known to, that is to ΔL / Σ_j |K_ij|.

    No torque changes by more than rounding has left open, and what the solver's own roundings have put into digits
    that mean nothing, other ones on other CPUs, goes: an angle that is 0 by symmetry is 0.
    """
    q = q.copy()
    for i, decimals in known_decimals(chain, free, qd, wrench):
        q[i] = chain.rest[i] + round(float(q[i] - chain.rest[i]), decimals)
    return q


def known_decimals(chain: Chain, free: NDArray[np.intp], qd: Array, wrench: Array) -> list[tuple[int, int]]:
    """Of every spring the decimals of its deflection that its load leaves known."""
    open_ = rounding.of_loads(chain, qd, wrench)
    sprung = free[(chain.stiffness[free] > 0) & (open_[free] > 0)]
    k = chain.times("stiffness", np.ones(chain.n), absolute=True)
    return [(i, math.ceil(math.log10(k[i] / open_[i]))) for i in sprung.tolist()]
