"""Find a beam's Young's modulus from a measured frequency.

Spring stiffness is proportional to E, and without gravity there is no other stiffness, so f ∝ √E. The frequency f₀ for
E₀ therefore gives E = E₀ (f/f₀)².
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.common.wording import truncated
from flexlink.describe.scene import Scene
from flexlink.dynamics.vibration.modal import natural_frequencies


def clamped_frequency(scene: Scene, link: str) -> float:
    """Return the first frequency [Hz] of a link clamped at its joint, in the initial configuration, without gravity.

    Everything beyond the link is rigid.
    """
    chain = lump(scene.varied({"gravity": (0.0, 0.0, 0.0)}))
    number = scene.arm.number(link)
    q = np.zeros(chain.n)
    joints = [chain.coordinate(k).link - 1 for k in chain.active]
    q[chain.active] = scene.joint_positions[joints]
    others = [k for k in range(chain.n) if chain.coordinate(k).link != number or chain.coordinate(k).axis == 0]
    return float(natural_frequencies(chain, q, locked=others)[0] / (2 * np.pi))


def tuned(scene: Scene, link: str, hertz: float) -> Scene:
    """Return the scene with the link's Young's modulus set so that `clamped_frequency` is `hertz`.

    Raises
    ------
    ArgumentError
        A frequency of this size is not proportional to √E in float64, or E would overflow.
    """
    name = scene.arm.links[scene.arm.number(link) - 1].material or link
    material, ratio = scene.arm.materials[name], hertz / clamped_frequency(scene, link)
    young = material.young * (ratio * ratio)
    specified = f"flexible: link {truncated(link)}: frequency_hz = {hertz!r}"
    if not 0 < young < math.inf:
        raise ArgumentError(
            f"{specified}: needs young = {young:g} Pa, outside the range of float64", id="frequency-out-of-reach"
        )
    stiff = msgspec.structs.replace(material, young=young)
    # do not use a path, because the name may contain any character
    stiffened = scene.varied({"material": scene.arm.materials | {name: stiff}})
    reached = clamped_frequency(stiffened, link)
    if not abs(reached / hertz - 1) <= 1e-6:
        raise ArgumentError(f"{specified}: young = {young:.4g} Pa gives {reached:.9g} Hz", id="frequency-out-of-reach")
    return stiffened
