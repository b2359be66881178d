"""Split a rigid link into a beam with a rigid body at each end; total mass, centre and inertia are preserved exactly.

    link = beam + root + end

The remainder, link − beam, has mass m, centre c and covariance Σ. The lever rule divides it: the end body gets the
fraction s = (c − a)·x̂ / L of the mass, for a beam of length L from a along x̂. The second moment along the line is
preserved by centres at c − v √(s / (1 − s) m) and c + v √((1 − s) / s m), v = Σ x̂ / √(x̂ᵀ Σ x̂). The second moment
across the line, the Schur complement Σ − v vᵀ ⪰ 0, is divided in the same ratio. Both bodies are physically possible
if the remainder is.

Largest mass of a beam: the second moments of the remainder, J − m J₁, must be positive semidefinite, so

    J − m J₁ ⪰ 0,   J₁: moments of the beam per kilogram   ⇔   m ≤ 1 / λ_max(J₁ x = λ J x)
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.rigid import NOTHING, Pose, SpatialInertia, body_with


def largest_mass(link: SpatialInertia, beam: SpatialInertia) -> float:
    """Return the largest mass [kg] that a beam of this shape can take from a link.

    Parameters
    ----------
    link, beam
        The bodies in one frame; the beam's mass is any positive number.
    """
    J, J1 = link.moments, beam.moments / beam.mass
    flat = 1e-12  # relative squared extent below which a body counts as a plate or rod; files contain rounded numbers
    extent = max(J.diagonal()[1:].max(), 0.0) or 1.0
    size = np.sqrt(np.where(J.diagonal() > flat * extent, J.diagonal(), extent))
    squares, axes = np.linalg.eigh(J / np.outer(size, size))
    J1 = axes.T @ (J1 / np.outer(size, size)) @ axes
    there = squares > flat
    if (np.diag(J1)[~there] > flat * np.trace(J1)).any():  # the beam is thick in a direction in which the link is flat
        return 0.0
    scale = np.sqrt(squares[there])
    λ = np.linalg.eigvalsh(J1[np.ix_(there, there)] / np.outer(scale, scale))[-1]
    return float(1 / λ)


def cut(link: SpatialInertia, beam: SpatialInertia, line: Pose, length: float) -> tuple[SpatialInertia, SpatialInertia]:
    """Return the remaining bodies at the root and at the end of the beam, in the link's frame.

    Parameters
    ----------
    link, beam
        The bodies in the link's frame; the beam has less mass than `largest_mass`.
    line
        Start of the beam, with x along it.
    length
        Length of the beam [m].
    """
    about = Pose(line.R, link.center)  # along the line, at the link's centre, where subtraction loses no digits
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
