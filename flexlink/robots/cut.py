"""A rigid link becomes a beam with a rigid body at each end: mass, centre and inertia together stay exactly its own.

    link = beam + root + end

The rest, link − beam, of mass m, centre c and covariance Σ, is shared by the lever rule: its end gets the part
s = (c − a)·x̂ / L of the mass, where the beam runs from a along x̂ by L. Along the line both stand where they keep the
second moment, at c − v √(s / (1 − s) m) and c + v √((1 − s) / s m), v = Σ x̂ / √(x̂ᵀ Σ x̂); what varies across it, the
Schur complement Σ − v vᵀ ⪰ 0, they have in the same shares. So both are bodies that can be whenever the rest is one.

Largest mass of a beam: the moments of link and beam are positive semidefinite, and so must be those of the rest,

    J − m J₁ ⪰ 0,   J₁ of the beam per kilogram   ⇔   m ≤ 1 / λ_max(J₁ x = λ J x)
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.rigid import NOTHING, Pose, SpatialInertia, body_with


def largest_mass(link: SpatialInertia, beam: SpatialInertia) -> float:
    """The most mass [kg] that a beam of this shape, of any mass itself, can take from a link.

    Parameters
    ----------
    link, beam
        The bodies, in one frame; the beam has some mass.
    """
    J, J1 = link.moments, beam.moments / beam.mass
    size = np.sqrt(np.where(np.diag(J) > 0, np.diag(J), 1.0))
    squares, axes = np.linalg.eigh(J / np.outer(size, size))
    J1 = axes.T @ (J1 / np.outer(size, size)) @ axes
    flat = 1e-12  # relative squared extent of a plate or a rod, after the rounding of files
    there = squares > flat
    if (np.diag(J1)[~there] > flat * np.trace(J1)).any():  # the beam is thick where the link is not
        return 0.0
    scale = np.sqrt(squares[there])
    λ = np.linalg.eigvalsh(J1[np.ix_(there, there)] / np.outer(scale, scale))[-1]
    return float(1 / λ)


def cut(link: SpatialInertia, beam: SpatialInertia, line: Pose, length: float) -> tuple[SpatialInertia, SpatialInertia]:
    """What remains of a link, at the root and at the end of the beam, in the link's frame.

    Parameters
    ----------
    link, beam
        The bodies, in the link's frame; the beam has less mass than `largest_mass`.
    line
        Where the beam begins, x along it.
    length
        Of the beam [m].
    """
    about = Pose(line.R, link.center)  # near to what is subtracted, and along the line: no digits are lost
    whole, part = link.moved(about.inverse), beam.moved(about.inverse)
    rest = whole.moments - part.moments
    mass, first = rest[0, 0], rest[0, 1:]
    c = first / mass
    Σ = rest[1:, 1:] - np.outer(first, first) / mass
    s = float((c + line.R.T @ (link.center - line.p))[0] / length)
    if not 0 < s < 1 or Σ[0, 0] <= 0:
        one = body_with(mass, c, Σ).moved(about)
        return (one, NOTHING) if s < 0.5 else (NOTHING, one)
    v = Σ[:, 0] / np.sqrt(Σ[0, 0])
    across = np.zeros((3, 3))
    across[1:, 1:] = Σ[1:, 1:] - np.outer(v[1:], v[1:])
    root = body_with((1 - s) * mass, c - v * np.sqrt(s / ((1 - s) * mass)), (1 - s) * across)
    end = body_with(s * mass, c + v * np.sqrt((1 - s) / (s * mass)), s * across)
    return root.moved(about), end.moved(about)
