"""Add small masses to massless links, which some programs refuse, and bound the effect on the motion.

Between consecutive hinges at one point there are massless links. Each gets a mass m and an inertia m r², r = 0.1 m.
"""

import dataclasses

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, require_type
from flexlink.chain.builder import Body, described, recorded
from flexlink.chain.chain import Chain
from flexlink.chain.rigid import HERE, NOTHING, Pose, SpatialInertia
from flexlink.common.errors import ArgumentError
from flexlink.dynamics.terms import mass_matrix
from flexlink.formats.document import base_joints


def with_small_mass(chain: Chain, *, mass: float) -> Chain:
    """The chain with a body at every hinge; massless ones get mass m and inertia m r² (effect: `added_inertia`)."""
    if require_type("chain", chain, Chain).has_rotation_springs:
        text = "rotation-vector springs do not allow masses between their hinges; use a lumping rule with springs = "
        text += "'angles', for example gauss, or no small mass"
        raise ArgumentError(f"{chain.name!r}: {text}", id="rotation-springs-in-file")
    return _filled(chain, positive("mass", mass), keep=True)


def added_inertia(chain: Chain, q: ArrayLike, *, mass: float) -> float:
    """Return the largest relative change of M at q by small masses, δ = max vᵀ ΔM v / vᵀ M v over all vectors v.

    By Rayleigh's quotient, every natural frequency is multiplied by at least 1/√(1 + δ) > 1 − δ/2.

    δ is infinite if M is singular without the small masses, of which the chain has none yet.
    """
    added = _filled(require_type("chain", chain, Chain), positive("mass", mass), keep=False)
    try:
        return float(scipy.linalg.eigh(mass_matrix(added, q), mass_matrix(chain, q), eigvals_only=True)[-1])
    except np.linalg.LinAlgError:
        return float("inf")


def _filled(chain: Chain, mass: float, *, keep: bool) -> Chain:
    """The chain with a body at every hinge and small masses in massless bodies; a floating base remains one joint."""
    radius = 0.1  # radius of gyration [m]
    light = SpatialInertia(mass, np.zeros(3), mass * radius**2 * np.eye(3))
    bodies, numbers, own = list[Body](), [0], base_joints(chain)
    for body, said in zip(chain.bodies, chain.described, strict=True):
        axes = {"link": said["link"], "section": said["section"]}
        k, stop, on = int(body["first"]), int(body["stop"]), numbers[body["parent"]]
        place = Pose(body["rotation"], body["translation"])
        rigid = SpatialInertia(body["mass"], body["center"], body["inertia"])
        while own <= k < stop - 1:
            bodies.append(Body(place, k, k + 1, on, light, **axes))
            k, on, place = k + 1, len(bodies), HERE
        if own <= k < stop and not rigid.mass and not rigid.inertia.any():
            rigid = light
        elif not keep:
            rigid = NOTHING
        bodies.append(Body(place, k, stop, on, rigid, lent=said["lent"], **axes))
        numbers.append(len(bodies))
    records, hinges = recorded(bodies), chain.hinges.copy()
    records["loaded"][np.array(numbers[1:]) - 1] = chain.bodies["loaded"]
    if own:
        records["turned"][1] = chain.bodies["turned"][1]
    if not keep:
        hinges["armature"] = 0.0
    tips = {name: numbers[number + 1] - 1 for name, number in chain.tips.items()}
    return dataclasses.replace(chain, bodies=records, hinges=hinges, tips=tips, described=described(bodies))
