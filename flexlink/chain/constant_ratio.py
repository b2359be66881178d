"""Constant damping ratio in every mode, by dampers between all hinges of links with this law, including root and gear.

M and K include all hinges with springs. They are computed with unloaded springs and all other joints locked in the
configuration `initial.joint_deg` and `joint_m`. With K φ = ω² M φ and φᵀ M φ = 1,

    D = Σ 2 ω (S M φ) (S M φ)ᵀ        S = diag(√ζ)        so φᵀ D φ / (2 ω) = ζ in every mode, if ζ is uniform

ζ is 0 for hinges of other links; then modal damping ratios are only approximately those of the damped links.
`root_damping` and `gear_damping` are added.

A full initial state, `initial.q`, does not change the dampers, so a run continued from this state uses the same arm.

M includes all bodies beyond the hinges. Modes and their damping ratios change with the configuration: for two equal
links with the same ζ and the elbow turned by 90°, the ratios are 0.4 to 1.3 ζ in the first two modes and 0.8 to 1.02 ζ
in all others.
"""

import dataclasses

import numpy as np
import scipy

from flexlink.chain.chain import Chain, merged
from flexlink.common.errors import SceneError
from flexlink.describe.arm import BETWEEN
from flexlink.describe.scene import Scene
from flexlink.kernels.bodies.mass import mass_upper
from flexlink.kernels.layout import COUPLING


def with_constant_ratios(chain: Chain, scene: Scene) -> Chain:
    """Return the chain with the dampers of all links whose damping has `law = "constant"`; errors as in `lump`."""
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
    path = f"{arm.path(chain.coordinates[hinges[0]].link)}.damping.law = 'constant'"
    if len(sprung) > MOST:
        text = f"{len(sprung)} hinges in all; at most {MOST}; use fewer, or law = 'proportional'"
        raise SceneError(f"{path}: {text}", id="too-many-joints")
    between = slice(chain.body(int(hinges[0])) + 1, chain.body(int(hinges[-1])) + 1)
    if chain.bodies["begins"][between].any() or chain.slides[hinges[0] : hinges[-1]].any():
        raise SceneError(f"{path}: {BETWEEN}", id="inertia-between-hinges")
    M, K = np.zeros((chain.n, chain.n)), chain.matrix("stiffness")
    posture = np.array(chain.rest)  # the initial configuration with unloaded springs
    posture[chain.active] = scene.joint_positions[[chain.coordinates[k].link - 1 for k in chain.active]]
    mass_upper(chain.arrays, posture, M)
    block = np.ix_(sprung, sprung)
    try:
        squares, shapes = scipy.linalg.eigh(K[block], M[block])
    except scipy.linalg.LinAlgError:
        text = f"{chain.name}: damping.law = 'constant': some hinges have no inertia attached"
        raise SceneError(text, id="massless-hinge") from None
    momenta = np.sqrt(wanted)[:, None] * (M[block] @ shapes)
    D = (momenta * (2 * np.sqrt(np.maximum(squares, 0.0)))) @ momenta.T
    D = ((D + D.T) / 2)[np.ix_(of_these, of_these)]
    damped, (inner, outer) = chain.hinges.copy(), np.triu_indices(len(hinges), 1)
    damped["damping"][hinges] += D.diagonal()
    dampers = np.zeros(len(inner), COUPLING)
    dampers["inner"], dampers["outer"], dampers["damping"] = hinges[inner], hinges[outer], D[inner, outer]
    return dataclasses.replace(chain, hinges=damped, couplings=merged(np.concatenate([chain.couplings, dampers])))


def posture_of(scene: Scene) -> tuple[float, ...]:
    """Initial joint coordinates on which the dampers depend; empty if no link has a constant damping ratio."""
    if not any(link.damping is not None and link.damping.is_constant for link in scene.arm.links):
        return ()
    return tuple(scene.joint_positions.tolist())


MOST = 400
"""Largest number of hinges that dampers may connect; a damper for each pair makes 79 800 dampers."""
