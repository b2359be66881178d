"""Torques of joints with prescribed motion, and the power of all torques, once q̈ is known."""

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.forces.elements import add_torques
from flexlink.kernels.forces.joint_torques import elastic, friction
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import recursion
from flexlink.kernels.tools.vec3 import ZERO, add_scaled, dot, vector


@recursion
def power_of(chain, wrench, qd, tau, rates, axes):
    """q̇·(T_EX − T_FR) + m·ω [W] without force elements; `axes` are in frame 0, `rates` (n,) is scratch."""
    turning_of_tip(chain, qd, rates)
    ω, power = ZERO, 0.0
    for k in range(len(qd)):
        ω = add_scaled(ω, rates[k], vector(axes[k]))
        power += qd[k] * (tau[k] - friction(chain.hinges[k], qd[k]))
    return power + dot(ω, (wrench[3], wrench[4], wrench[5]))


@recursion
def turning_of_tip(chain, qd, rates):
    """Write q̇ of the revolute hinges on the path to the loaded body, zero for all others."""
    i = 0
    rates[:] = 0.0
    for j in range(len(chain.bodies)):
        if chain.bodies[j].loaded:
            i = j + 1
    while i > 0:
        b = chain.bodies[i - 1]
        for k in range(b.first, b.stop):
            if chain.rare is None or chain.hinges[k].axis < SLIDES:
                rates[k] = qd[k]
        i = b.parent if b.begins else i - 1


@recursion
def take_torques(chain, wrench, q, qd, qdd, tau, torque, inverse, forces):
    """Write the torques of prescribed motions, if there are any; `torque` (n,) and `inverse` are scratch."""
    for k in range(len(qdd)):
        if chain.hinges[k].prescribed:
            inverse_dynamics_into(chain, wrench, q, qd, qdd, torque, inverse)
            if forces is not None:
                add_torques(forces.elements, q, qd, torque)
            break
    for k in range(len(qdd)):
        if chain.hinges[k].prescribed:
            tau[k] = torque[k] + elastic(chain.hinges[k], q[k]) + friction(chain.hinges[k], qd[k])
