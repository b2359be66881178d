"""Gradient of w·τ in a plane, O(n): `planar_rne` in reverse (see `load_gradient`).

Ω and U are the rate of a link and the velocity of its hinge point if the joints had the rates w. A change of φ of one
link changes r by d, d by −r, m c by h and h by −m c. With f and P = Σ (m U + Ω h) of all bodies outboard of the link,

    outward     Ω ← Ω + σ w     U ← U + Ω d
    ∂/∂φ = −U·(α m c + ω² h) − Ω (m c·a + r·f) − P·(α r + ω² d)          ∂/∂φ̇ = −2 ω (U·m c + P·r)

A change of q_j turns link j and all later ones: ∂/∂q_j = σ_j Σ ∂/∂φ_k, k ≥ j, and the same for q̇_j.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import LINK, PlanarWork, in_plane
from flexlink.kernels.tools.compiler import kernel, recursion
from flexlink.kernels.tools.lanes import vec
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.vec3 import scale, vector

ROW = numbered("ω α Ω", "fx fy Px Py", "by_φ by_ω")
"""Columns of a link: its motion, its own f and P, and its derivatives without those due to outboard bodies."""


class PlanarLoadGradientWork(NamedTuple):
    """Scratch of `gradient_in_plane`."""

    planar: PlanarWork  # of forward dynamics, which must have run at the angles q
    rows: Any  # (n, ROW)


@kernel
def planar_load_gradient_workspace(planar):
    """Scratch of `gradient_in_plane` on the scratch of forward dynamics."""
    return PlanarLoadGradientWork(planar, np.empty((len(planar.links), ROW.size)))


@recursion
def gradient_in_plane(chain, wrench, q, qd, qdd, w, by_angle, by_rate, work):
    """Write ∂(w·τ)/∂q and ∂(w·τ)/∂q̇ (n,), under the tip wrench (6,) in frame 0."""
    move(chain.gravity, qd, qdd, w, work)
    add_up(wrench, by_angle, by_rate, work)


@recursion
def move(gravity, qd, qdd, w, work):
    """Write the row of every link."""
    links, trig, rows = work.planar.links, work.planar.trig, work.rows
    ax, ay = in_plane(work.planar.base, scale(-1.0, vector(gravity)))
    ω = α = Ω = Ux = Uy = 0.0
    for k in range(len(rows)):
        c, s, σ, m = trig[1, k], trig[2, k], links[k, LINK.sign], links[k, LINK.mass]
        sx, sy, dx, dy = links[k, LINK.sx], links[k, LINK.sy], links[k, LINK.dx], links[k, LINK.dy]
        hx, hy = -s * sx - c * sy, c * sx - s * sy
        ω, α, Ω = ω + σ * qd[k], α + σ * qdd[k], Ω + σ * w[k]
        ωω = ω * ω
        along_h, along_mc = Ux * hx + Uy * hy, Ux * hy - Uy * hx
        rows[k, ROW.ω], rows[k, ROW.α], rows[k, ROW.Ω] = ω, α, Ω
        rows[k, ROW.fx], rows[k, ROW.fy] = m * ax + α * hx - ωω * hy, m * ay + α * hy + ωω * hx
        rows[k, ROW.Px], rows[k, ROW.Py] = m * Ux + Ω * hx, m * Uy + Ω * hy
        rows[k, ROW.by_φ] = -α * along_mc - ωω * along_h - Ω * (hy * ax - hx * ay)
        rows[k, ROW.by_ω] = -2.0 * ω * along_mc
        ax, ay = ax + α * dx - ωω * dy, ay + α * dy + ωω * dx
        Ux, Uy = Ux + Ω * dx, Uy + Ω * dy


@recursion
def add_up(wrench, by_angle, by_rate, work):
    """Add what is due to outboard bodies, and the derivatives of all later links, from the tip to the base."""
    links, rows = work.planar.links, work.rows
    fx, fy = in_plane(work.planar.base, scale(-1.0, vec(wrench, 0)))
    Px = Py = by_φ = by_ω = 0.0
    for k in range(len(rows) - 1, -1, -1):
        ω, α, σ = rows[k, ROW.ω], rows[k, ROW.α], links[k, LINK.sign]
        dx, dy = links[k, LINK.dx], links[k, LINK.dy]
        along_r, along_d = Px * dy - Py * dx, Px * dx + Py * dy
        by_φ += rows[k, ROW.by_φ] - rows[k, ROW.Ω] * (dy * fx - dx * fy) - α * along_r - ω * ω * along_d
        by_ω += rows[k, ROW.by_ω] - 2.0 * ω * along_r
        by_angle[k], by_rate[k] = σ * by_φ, σ * by_ω
        fx, fy = fx + rows[k, ROW.fx], fy + rows[k, ROW.fy]
        Px, Py = Px + rows[k, ROW.Px], Py + rows[k, ROW.Py]
