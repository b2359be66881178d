"""Names of the motions that belong to poles: the link that bends, or the joint that turns.

A motion with shape φ is a vibration of a link if the springs between its segments hold most of its energy,
φ* K φ > ½ |s|² φ* M φ; it is named after the link whose springs hold most, and after their axes. Otherwise it is named
after the driven joint with the largest M_kk |φ_k|².
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Complex
from flexlink.dynamics.terms import mass_matrix

CONTROLLER = "controller"
"""Name of motions in which the arm rests: torques on their way, and states of the law."""


def motions(chain: Chain, q: Array, shapes: Sequence[Complex], s: Complex) -> list[str]:
    """Name of every motion with shape (n,) and eigenvalue s [1/s], such as "bending of 'boom'" or "joint 'boom'"."""
    M, k = mass_matrix(chain, q), np.where(chain.held, 0.0, chain.stiffness)
    return [_motion(chain, M, k, φ, abs(each)) for φ, each in zip(shapes, s, strict=True)]


def _motion(chain: Chain, M: Array, k: Array, φ: Complex, size: float) -> str:
    weight = np.sqrt(np.diag(M)) * np.abs(φ)
    if not np.isfinite(weight).all() or not weight.any():
        return CONTROLLER
    springs, kinetic = k * np.abs(φ) ** 2, size**2 * float(np.real(φ.conj() @ M @ φ))
    if springs.sum() > 0.5 * kinetic and springs.any():
        return _of_springs(chain, springs)
    driven = chain.active if len(chain.active) else np.arange(chain.n)
    return f"joint {chain.joint_name(int(driven[np.argmax(weight[driven])]))!r}"


def _of_springs(chain: Chain, springs: Array) -> str:
    energy: dict[tuple[int, str], float] = {}
    for k in np.flatnonzero(springs).tolist():
        at = chain.coordinates[k]
        energy[at.link, at.spring] = energy.get((at.link, at.spring), 0.0) + float(springs[k])
    (link, kind), _ = max(energy.items(), key=lambda each: each[1])
    return f"{kind} of {chain.link_names[link - 1]!r}"
