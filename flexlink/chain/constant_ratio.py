"""Damping of one ratio in every mode: dampers between all hinges of the links that ask for it, root and gear, too.

With M and K of all hinges with springs where `initial.joint_deg` and `joint_m` put the joints, the springs slack, all
else held, and K φ = ω² M φ, φᵀ M φ = 1,

    D = Σ 2 ω (S M φ) (S M φ)ᵀ        S = diag(√ζ)        so that φᵀ D φ / (2 ω) = ζ in every mode, of one ζ

ζ is 0 for hinges of links that do not ask for it; then the ratios of modes are no more than near that of those that do.
What `root_damping` and `gear_damping` say comes on top.

A whole state, `initial.q`, changes no dampers: a run that is continued from it goes on with the same arm.

M has in it what the links carry. In other postures modes are others, and so are their ratios: of two equal links of one
ζ, once the elbow has turned by 90°, 0.4 to 1.3 ζ in the first two modes and 0.8 to 1.02 ζ in all others.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.arm import BETWEEN, Arm
from flexlink.describe.scene import Scene
from flexlink.kernels.bodies.mass import mass_upper
from flexlink.kernels.layout import COUPLING


def with_constant_ratios(chain: Chain, scene: Scene) -> Chain:
    """The chain with the dampers of all links whose damping is of `law = "constant"`.

    Raises
    ------
    SceneError
        There are so many hinges that dampers between all of them would be more than `MOST`; a branch begins or a joint
        slides between them; or they move no inertia of their own.
    """
    arm = scene.arm
    ratios = {k: link.damping.ratio for k, link in enumerate(arm.links, 1) if link.damping and link.damping.is_constant}
    if not ratios:
        return chain
    sprung = np.flatnonzero(chain.stiffness > 0)
    wanted = np.array([ratios.get(chain.coordinates[k].link, 0.0) for k in sprung])
    of_these = np.array([chain.coordinates[k].link in ratios for k in sprung], dtype=bool)
    hinges = sprung[of_these]
    if not len(hinges):
        return chain
    _check(chain, arm, hinges, len(sprung))
    M, K = np.zeros((chain.n, chain.n)), chain.matrix("stiffness")
    mass_upper(chain.arrays, _posture(chain, scene), M)
    block = np.ix_(sprung, sprung)
    D = _damping(M[block], K[block], wanted, chain.name)[np.ix_(of_these, of_these)]
    damped = chain.hinges.copy()
    damped["damping"][hinges] += D.diagonal()
    return dataclasses.replace(chain, hinges=damped, couplings=_joined(chain.couplings, hinges, D))


def _posture(chain: Chain, scene: Scene) -> Array:
    """Where the scene puts the joints, springs at rest, shape (n,)."""
    q, places = np.array(chain.rest), scene.joint_positions
    for k in chain.active.tolist():
        q[k] = places[chain.coordinates[k].link - 1]
    return q


def posture_of(scene: Scene) -> tuple[float, ...]:
    """What of the start the dampers of such links depend on; nothing without them."""
    if not any(link.damping is not None and link.damping.is_constant for link in scene.arm.links):
        return ()
    return tuple(scene.joint_positions.tolist())


MOST = 400
"""Hinges between all of which there may be dampers: 79 800 of them."""


def _check(chain: Chain, arm: Arm, hinges: NDArray[np.intp], count: int) -> None:
    number = chain.coordinates[hinges[0]].link
    path = f"{arm.path(number)}.damping.law = 'constant'"
    if count > MOST:
        raise SceneError(
            f"{path}: {count} hinges in all; at most {MOST}; take fewer, or law = 'proportional'", id="too-many-joints"
        )
    between = slice(chain.body(int(hinges[0])) + 1, chain.body(int(hinges[-1])) + 1)
    if chain.bodies["begins"][between].any() or chain.slides[hinges[0] : hinges[-1]].any():
        raise SceneError(f"{path}: {BETWEEN}", id="inertia-between-hinges")


def _damping(M: Array, K: Array, ratios: Array, name: str) -> Array:
    try:
        squares, shapes = scipy.linalg.eigh(K, M)
    except scipy.linalg.LinAlgError:
        raise SceneError(
            f"{name}: damping.law = 'constant': some hinges move no inertia of their own", id="massless-hinge"
        ) from None
    momenta = np.sqrt(ratios)[:, None] * (M @ shapes)
    D = (momenta * (2 * np.sqrt(np.maximum(squares, 0.0)))) @ momenta.T
    return np.asarray((D + D.T) / 2)


def _joined(couplings: NDArray[np.void], hinges: NDArray[np.intp], D: Array) -> NDArray[np.void]:
    """Springs between hinges as they are, with dampers between these and others."""
    inner, outer = np.triu_indices(len(hinges), 1)
    pairs = zip(hinges[inner].tolist(), hinges[outer].tolist(), strict=True)
    found = {pair: (0.0, damping) for pair, damping in zip(pairs, D[inner, outer].tolist(), strict=True)}
    for i, j, stiffness, damping in couplings.tolist():
        found[i, j] = stiffness, found.get((i, j), (0.0, damping))[1]
    return np.array([(*pair, *constants) for pair, constants in sorted(found.items())], dtype=COUPLING)
