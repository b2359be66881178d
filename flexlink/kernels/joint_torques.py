"""Torques of the joints themselves: springs and friction."""

import math

from flexlink.kernels.compiler import kernel


@kernel
def elastic(hinge, angle):
    """T_FL = k (θ − θ₀) of one hinge."""
    return hinge.stiffness * (angle - hinge.rest)


@kernel
def friction(hinge, rate):
    """T_FR = d q̇ + c tanh(q̇ / w) of one hinge."""
    torque = hinge.damping * rate
    if hinge.coulomb > 0.0:
        torque += hinge.coulomb * math.tanh(rate / hinge.coulomb_width)
    return torque
