"""The stiffness of a beam from a frequency that was measured.

Springs are proportional to E, and without gravity nothing else is stiff: f ∝ √E. One evaluation gives E = E₀ (f/f₀)².
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
    """First frequency [Hz] of a link clamped at its joint, everything beyond it rigid, where it starts, no gravity."""
    chain = lump(scene.varied({"gravity": (0.0, 0.0, 0.0)}))
    number = scene.arm.number(link)
    q = np.zeros(chain.n)
    joints = [chain.coordinate(k).link - 1 for k in chain.active]
    q[chain.active] = scene.joint_positions[joints]
    others = [k for k in range(chain.n) if chain.coordinate(k).link != number or chain.coordinate(k).axis == 0]
    return float(natural_frequencies(chain, q, locked=others)[0] / (2 * np.pi))


def tuned(scene: Scene, link: str, hertz: float) -> Scene:
    """The scene with the Young's modulus of a link's own material such that `clamped_frequency` is `hertz`.

    Raises
    ------
    ArgumentError
        Frequencies of this size are not proportional to √E in float64, or take an E beyond it.
    """
    name = scene.arm.links[scene.arm.number(link) - 1].material or link
    material, ratio = scene.arm.materials[name], hertz / clamped_frequency(scene, link)
    young = material.young * (ratio * ratio)
    asked = f"flexible: link {truncated(link)}: frequency_hz = {hertz!r}"
    if not 0 < young < math.inf:
        raise ArgumentError(
            f"{asked}: needs young = {young:g} Pa, which is outside the range of float64", id="frequency-out-of-reach"
        )
    stiff = msgspec.structs.replace(material, young=young)
    # not by a path: the name may hold any character
    stiffened = scene.varied({"material": scene.arm.materials | {name: stiff}})
    reached = clamped_frequency(stiffened, link)
    if not abs(reached / hertz - 1) <= 1e-6:
        raise ArgumentError(f"{asked}: young = {young:.4g} Pa gives {reached:.9g} Hz", id="frequency-out-of-reach")
    return stiffened
