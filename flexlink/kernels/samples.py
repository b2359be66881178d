"""What follows from the states of a run: tip, energies, and the drive torques that the run took."""

import numpy as np

from flexlink.kernels.compiler import kernel
from flexlink.kernels.energy import energies
from flexlink.kernels.forward import forward_dynamics
from flexlink.kernels.inputs import drive_torque, follow
from flexlink.kernels.joint_torques import elastic, friction
from flexlink.kernels.kinematics import kinematics
from flexlink.kernels.rne import inverse_dynamics


@kernel
def tips_and_energies(chain, qs, qds, tips, parts):
    """Tip positions (samples, 3) and kinetic, gravity and elastic energy (3, samples)."""
    bodies, n = len(chain.bodies), len(chain.hinges)
    rotations, points, axes = np.empty((bodies, 3, 3)), np.empty((bodies, 3)), np.empty((n, 3))
    for row in range(len(qs)):
        kinematics(chain, qs[row], rotations, points, axes)
        tips[row] = points[-1]
        parts[0, row], parts[1, row], parts[2, row] = energies(chain, qs[row], qds[row])


@kernel
def drive_torques(chain, work, drive, motion, wrench, ts, qs, qds, taus):
    """T_EX (samples, n): what the drive gives, and M q̈ + T_GC + T_FL + T_FR at prescribed joints."""
    qdd = np.zeros(len(chain.hinges))
    taus[:] = 0.0
    for row in range(len(ts)):
        q, qd, tau = qs[row].copy(), qds[row].copy(), taus[row]
        drive_torque(drive, ts[row], q, qd, tau)
        if len(motion.joints) > 0:
            follow(motion, ts[row], q, qd, qdd)
            forward_dynamics(chain, wrench, q, qd, tau, qdd, work)
            torque = inverse_dynamics(chain, wrench, q, qd, qdd)
            for k in motion.joints:
                tau[k] = torque[k] + elastic(chain.hinges[k], q[k]) + friction(chain.hinges[k], qd[k])
