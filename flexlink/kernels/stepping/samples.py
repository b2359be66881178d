"""Results computed from the states of a run: tip positions, energies, and drive torques."""

import numpy as np

from flexlink.kernels.bodies.energy import energies_of
from flexlink.kernels.forces.elements import forces_of
from flexlink.kernels.geometry.kinematics import kinematics, kinematics_workspace
from flexlink.kernels.inputs.drive_torque import sample_at_step, stage_torque
from flexlink.kernels.stepping.runge_kutta import stage
from flexlink.kernels.tools.compiler import kernel, subroutine
from flexlink.kernels.tools.vec3 import put, vector


@kernel
def tips_and_energies(chain, qs, qds, tips, parts):
    """Write tip positions `tips` (samples, 3), and kinetic, gravity and elastic energy `parts` (3, samples)."""
    tips_and_energies_of(chain, 0, len(qs), qs, qds, tips, parts, kinematics_workspace(chain), forces_of(chain))


@subroutine
def tips_and_energies_of(chain, first, stop, qs, qds, tips, parts, placed, forces):
    """Write tips and energies of the samples first … stop − 1; `placed` is scratch, `forces` are force elements."""
    for row in range(first, stop):
        kinematics(chain, qs[row], placed)
        put(tips[row], vector(placed.points[-1]))
        parts[0, row], parts[1, row], parts[2, row] = energies_of(chain, qs[row], qds[row], placed, forces)


@kernel
def derive(chain, inputs, first, stop, ts, qs, qds, taus, tips, parts):
    """Write tip positions, energies and drive torques T_EX of the samples first … stop − 1, each in its row."""
    tips_and_energies_of(chain, first, stop, qs, qds, tips, parts, kinematics_workspace(chain), forces_of(chain))
    for row in range(first, stop):
        taus[row] = 0.0
        sample_at_step(inputs.drive, ts[row], ts[row], qs[row], qds[row], taus[row])  # for runs by other engines
        stage_torque(inputs.drive, ts[row], ts[row], qs[row], qds[row], taus[row])


@kernel
def prescribed_torques(work, inputs, ts, qs, qds, taus):
    """Write the torques of prescribed motions to `taus` (samples, n), which already contains the drive torques."""
    qdd = np.zeros(qs.shape[1])
    for row in range(len(ts)):
        q, qd = qs[row].copy(), qds[row].copy()
        stage(work, inputs, ts[row], ts[row], q, qd, taus[row], qdd)
