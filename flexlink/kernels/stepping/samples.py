"""What follows from the states of a run: tip, energies, and the drive torques that the run took."""

import math

import numpy as np

from flexlink.kernels.bodies.energy import energies_of
from flexlink.kernels.bodies.kinematics import kinematics, kinematics_workspace
from flexlink.kernels.forward.solvers import forward_under
from flexlink.kernels.inputs.drive_torque import ask, drive_torque, follow
from flexlink.kernels.stepping.runge_kutta import step, step_workspace
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.vec3 import dot, sub, vector


@kernel
def tips_and_energies(chain, qs, qds, tips, parts):
    """Tip positions (samples, 3) and kinetic, gravity and elastic energy (3, samples)."""
    placed = kinematics_workspace(chain)
    for row in range(len(qs)):
        kinematics(chain, qs[row], placed)
        tips[row] = placed.points[-1]
        parts[0, row], parts[1, row], parts[2, row] = energies_of(chain, qs[row], qds[row], placed)


@kernel
def drive_torques(work, inputs, ts, qs, qds, taus):
    """T_EX (samples, n): what the drive gives, and at prescribed joints what the motion takes."""
    qdd = np.zeros(qs.shape[1])
    taus[:] = 0.0
    for row in range(len(ts)):
        q, qd, tau = qs[row].copy(), qds[row].copy(), taus[row]
        ask(inputs.drive, ts[row], ts[row], q, qd, tau)  # of a run by another engine
        drive_torque(inputs.drive, ts[row], ts[row], q, qd, tau)
        if len(inputs.motion.joints) > 0:
            follow(inputs.motion, ts[row], q, qd, qdd)
            forward_under(inputs, ts[row], ts[row], q, qd, tau, qdd, work)


@kernel
def tip_errors(chain, work, tableau, inputs, h, numbers, qs, qds, errors):
    """How far apart [m] one step of h and two of h/2 put the tip, from each state (rows, n) at step number (rows,)."""
    placed, stages = kinematics_workspace(chain), step_workspace(tableau, np.empty(len(chain.hinges)))
    ends, done = np.empty((2, 3)), np.zeros(1)
    for row in range(len(numbers)):
        for parts in range(1, 3):
            state = qs[row].copy(), qds[row].copy(), done
            for part in range(parts):
                number = parts * numbers[row] + part
                step(work, tableau, inputs, h / parts, number, state, stages)
            kinematics(chain, state[0], placed)
            ends[parts - 1] = placed.points[-1]
        apart = sub(vector(ends[0]), vector(ends[1]))
        errors[row] = math.sqrt(dot(apart, apart))
