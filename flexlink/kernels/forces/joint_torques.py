"""Torques of the springs and the friction of single joints."""

import math

import numpy as np

from flexlink.kernels.tools.compiler import allocating, inlined, recursion
from flexlink.kernels.tools.lanes import at, put_at, tanh, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep


@recursion
def elastic(hinge, angle):
    """Spring torque T_FL = k (θ − θ₀) of one hinge."""
    return hinge.stiffness * (angle - hinge.rest)


@recursion
def friction(hinge, rate):
    """Friction torque T_FR = d q̇ + c tanh(q̇ / w) of one hinge."""
    torque = hinge.damping * rate
    if hinge.coulomb > 0.0:
        torque += hinge.coulomb * math.tanh(rate / hinge.coulomb_width)
    return torque


# First columns of the row of a joint, which `smooth_torques` and `subtract_dry_friction` read: k, θ₀, d, c, w.
JOINT = numbered("stiffness rest damping coulomb width")


@allocating
def put_joint(rows, k, hinge):
    """Copy k, θ₀, d, c, w to the first columns of row `k`."""
    keep(rows, k, (hinge.stiffness, hinge.rest, hinge.damping, hinge.coulomb, hinge.coulomb_width))


@allocating
def dry_joints(coulomb):
    """Indices of the joints with dry friction; the other joints need no tanh."""
    return np.flatnonzero(coulomb > 0.0)


@inlined
def smooth_torques(rows, k, angle, rate, torque):
    """T_EX − d q̇ of joint `k`, whose power counts as work, and this minus k (θ − θ₀), for one chain or eight."""
    working = torque - at(rows, k, JOINT.damping) * rate
    return working, working - at(rows, k, JOINT.stiffness) * (angle - at(rows, k, JOINT.rest))


@recursion
def subtract_dry_friction(rows, dry, qd, net):
    """Subtract c tanh(q̇ / w) from column `net` of the rows of the joints in `dry`; returns the dissipated power [W].

    This is a separate loop because most chains have no dry friction.
    """
    power = zero_of(qd)
    for k in dry:
        torque = at(rows, k, JOINT.coulomb) * tanh(at(qd, k) / at(rows, k, JOINT.width))
        put_at(rows, at(rows, k, net) - torque, k, net)
        power += at(qd, k) * torque
    return power
