"""What follows from the states of a run: tip, energies, and the drive torques that the run took."""

import numpy as np

from flexlink.kernels.compiler import kernel
from flexlink.kernels.energy import energies
from flexlink.kernels.forward import forward_dynamics
from flexlink.kernels.inputs import drive_torque, follow
from flexlink.kernels.kinematics import kinematics


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
def drive_torques(chain, work, inputs, ts, qs, qds, taus):
    """T_EX (samples, n): what the drive gives, and at prescribed joints what the motion takes."""
    qdd = np.zeros(len(chain.hinges))
    taus[:] = 0.0
    for row in range(len(ts)):
        q, qd, tau = qs[row].copy(), qds[row].copy(), taus[row]
        drive_torque(inputs.drive, ts[row], q, qd, tau)
        if len(inputs.motion.joints) > 0:
            follow(inputs.motion, ts[row], q, qd, qdd)
            forward_dynamics(chain, inputs.wrench, q, qd, tau, qdd, work)
