"""Internal loads: forces and moments between the parts of an arm at a cut, in motion or at rest.

The cut is just inboard of body i, at its hinge point. The subtree beyond the cut moves under gravity, drag, the tip
wrench, and the force f_i and moment n_i that the part inboard of the cut exerts on it (Newton and Euler):

    F = m (a + α × c + ω × (ω × c) − g)        f_i = F_i + Σ f_j − f_tip
    N = I α + ω × I ω + c × F                  n_i = N_i + Σ (n_j + r_j × f_j) − n_tip        r_j = p_j − p_i, j child

Section loads have the opposite sign: they act on the face whose normal points outward along the arm, as in beam theory.
They are in axes of the section at the cut, whatever the axes of the body (`DESCRIBED`).
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.chain.layout import of_parents, spans_of, sums_inward
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.batches import each, is_batch
from flexlink.dynamics.forces import world_wrench
from flexlink.dynamics.placement import hinge_bodies
from flexlink.dynamics.point_motion import body_motion
from flexlink.dynamics.result import Result
from flexlink.kernels.forces.drag import drag_loads
from flexlink.kernels.tools.finite import is_finite


def _along(load: str, axis: int, about: str) -> property:
    def component(loads: InternalLoads) -> Array:
        return np.asarray(getattr(loads, load)[..., axis])

    return property(component, doc=about)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class InternalLoads(Result):
    """Force and moment that the part outboard of a cut exerts on the inboard part, at the hinge point of every body.

    They are in axes of the section of the outboard link, at joints as well: x along the beam, z towards `up`. `force`
    contains N, V_y, V_z, and `moment` contains T, M_y, M_z. The last body is the tip frame, where the loads are the tip
    wrench, unless that acts on another tip.
    """

    force: Array  # (…, bodies, 3), N, V_y, V_z [N]
    moment: Array  # (…, bodies, 3), T, M_y, M_z [N m]
    hinge_moment: Array  # (…, n), moment about each hinge axis [N m]; for a sliding joint the force along it [N]

    N = _along("force", 0, "Axial force [N], positive in tension, shape (…, bodies).")
    V_y = _along("force", 1, "Shear force along the section's y [N], shape (…, bodies).")
    V_z = _along("force", 2, "Shear force along the section's z [N], shape (…, bodies).")
    T = _along("moment", 0, "Torque GJ φ' about the beam's axis [N m], shape (…, bodies).")
    M_y = _along("moment", 1, "Bending moment EI κ about the section's y [N m], shape (…, bodies).")
    M_z = _along("moment", 2, "Bending moment EI κ about the section's z [N m], shape (…, bodies).")

    def __repr__(self) -> str:
        *states, bodies, _ = self.force.shape
        return f"<InternalLoads: {bodies} cuts{f' in {states[0]} states' if states else ''}>"


def internal_loads(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
) -> InternalLoads:  # fmt: skip
    """Axial force, shear, torque and bending moment at every hinge and joint.

    They follow from the given motion alone, whatever the drive; for a simulation use `run.loads`. If q̈ is from
    `forward_dynamics`, the moment is k (θ − θ₀) + T_FR + I_a q̈ about a hinge axis, and T_FR + I_a q̈ − T_EX about the
    axis of a driven joint, where I_a is the armature. At a joint the axes are those of its link's section, x along the
    beam, whatever the joint's axis. A chain read from an exported file does not know them; there the axes at a joint
    are those of its body.

    Parameters
    ----------
    chain, q, qd, qdd
        The chain; angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,), or (b, n) for b states.
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame.

    Returns
    -------
    InternalLoads
        `N`, `V_y`, `V_z` and `T`, `M_y`, `M_z`, shape (bodies,), one entry per body of `chain.bodies`, so
        `M_z[chain.body("upper.2.z")]` is the bending moment at that hinge; together they are `force` and `moment`,
        shape (bodies, 3). `hinge_moment`, shape (n,). For b states all have a leading axis b.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a load is beyond float64.

    Examples
    --------
    >>> cuts = fl.strength.internal_loads(chain, q, qd, qdd)
    >>> print(cuts.M_z[chain.body("fore")].round(2))  # N m: bending moment at the elbow
    -30.31
    >>> print(run.loads.M_z.shape)  # simulation: samples, bodies
    (101, 7)
    """
    if is_batch(q, qd, qdd):
        return each(internal_loads, chain, {"q": q, "qd": qd, "qdd": qdd}, tip_wrench=tip_wrench, frame=frame)
    n = require_type("chain", chain, Chain).n
    q, qd, qdd = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("qdd", qdd, n, many=True)
    wrench = world_wrench(chain, q, tip_wrench, frame)
    found = loads_of_bodies(chain, q, qd, qdd, wrench)
    if not all(is_finite(part.reshape(-1)) for part in (found.force, found.moment, found.hinge_moment)):
        raise beyond_float64("an internal load", q=q, qd=qd, qdd=qdd, tip_wrench=wrench, gravity=chain.gravity)
    return found


def loads_of_bodies(
    chain: Chain, q: Array, qd: Array, qdd: Array, wrench: Array, more: tuple[Array, Array] | None = None
) -> InternalLoads:
    """As `internal_loads`; in frame 0, with `more` forces and moments (bodies, 3) about the origins of the bodies."""
    bodies = chain.bodies
    R, p, axes, _, ω, a, α, _ = body_motion(chain, q, qd, qdd)
    with np.errstate(over="ignore", invalid="ignore"):
        c = _each_by(R, bodies["center"])
        F = bodies["mass"][:, None] * (a + cross(α, c) + cross(ω, cross(ω, c)) - chain.gravity)
        inertia = R @ bodies["inertia"] @ R.transpose(0, 2, 1)
        N = _each_by(inertia, α) + cross(ω, _each_by(inertia, ω)) + cross(c, F)
        tip = chain.loaded
        F[tip], N[tip] = -wrench[:3], -wrench[3:]  # the tip frame has no inertia
        if len(chain.drag):
            drag = drag_loads(chain.arrays, q, qd)
            F, N = F - drag[:, 0], N - drag[:, 1]
        if more is not None:
            F, N = F - more[0], N - more[1]
        spans, parents = spans_of(chain.bodies), bodies["parent"]
        f = sums_inward(spans, F)
        moments = cross(p - of_parents(chain, p, np.zeros(3)), f)
        attached = parents > 0
        np.add.at(N, parents[attached] - 1, moments[attached])
        n = sums_inward(spans, N)
        inward = -(R @ chain.described["section"]).transpose(0, 2, 1)
        moved = hinge_bodies(chain)
        about_axes = -(axes * np.where(chain.slides[:, None], f[moved], n[moved])).sum(axis=1)
        return InternalLoads(_each_by(inward, f), _each_by(inward, n), about_axes)


def _each_by(matrices: Array, vectors: Array) -> Array:
    """Multiply each vector by its matrix."""
    return np.asarray(np.einsum("ijk,ik->ij", matrices, vectors))
