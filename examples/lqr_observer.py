"""LQR with an observer, from encoders and a strain gauge
======================================================

The hinge angles of a link cannot be measured. A Kalman filter estimates them from the joint encoders and one strain
gauge, and the regulator uses the estimate at 1 kHz. The arm is nonlinear, and the measurements are noisy.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete

import flexlink as fl

aluminium = {"aluminium": fl.Material(young=70e9, density=2700.0)}
tube = {"tube": fl.Section(shape="tube", outer=0.04, inner=0.034)}
bends = {
    "length": 1.0,
    "material": "aluminium",
    "section": "tube",
    "flex": "z",
    "segments": 3,
}
damping, motor = fl.Damping(ratio=0.005, at_hz=3.0), fl.Joint(armature=1.0)  # kg m²
links = tuple(
    fl.Link(name=name, damping=damping, joint=motor, **bends) for name in ("upper", "fore")
)
arm = fl.Arm(links=links, materials=aluminium, sections=tube, tip=fl.RigidBody(mass=4.0))
start = fl.InitialState(joint_deg=(40.0, -70.0), passive="static")
run = fl.RunSettings(method="RK4", step=1e-4, duration=2.0, sample=0.01)
scene = fl.Scene(name="observed", arm=arm, gravity=(0.0, -9.81, 0.0), initial=start, run=run)
chain = fl.lump(scene)
own, n = chain.active, chain.n
rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=own)

# %%
# The plant at 1 kHz. Outputs are the two encoders [rad] and the strain at the root of the upper arm, which is linear in
# the hinges' angles: its row of C is the gauge's signal for a unit of each angle.
SAMPLE, FIBRE = 1e-3, (0.02, 0.0)  # s; m, at the surface
plant = fl.linearize(chain, rest.q, tau=rest.tau)
gauge = fl.strength.beam_strain(scene, np.eye(n), link="upper", fibre=FIBRE).strain[:, 0]
C = np.zeros((3, 2 * n))
C[:2, own], C[2, :n] = np.eye(2), gauge
A, B, *_ = cont2discrete((plant.A, plant.B, C, np.zeros((3, 2))), SAMPLE)
NOISE = np.array([1e-4, 1e-4, 2e-6])  # rad, rad, strain
Q, R = np.diag([1e4] * n + [1e2] * n), 0.01 * np.eye(2)
P = solve_discrete_are(A, B, Q, R)
K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
W, V = 25.0 * B @ B.T + 1e-12 * np.eye(2 * n), np.diag(NOISE**2)  # torque errors of 5 N m
S = solve_discrete_are(A.T, C.T, W, V)
L = np.linalg.solve(C @ S @ C.T + V, C @ S).T


# %%
# The loop: measure, correct the estimate, compute the torque, predict. The arm starts with an error of 0.15 rad in each
# joint; the estimate starts at the goal.
def closed_loop(observed: bool) -> fl.Trajectory:
    """Run the arm with the regulator, with the estimated or the true state."""
    random, x = np.random.default_rng(0), np.zeros(2 * n)

    def law(_: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        nonlocal x
        true = np.concatenate([q - rest.q, qd])
        seen = x + L @ (C @ true + NOISE * random.standard_normal(3) - C @ x)
        u = -K @ (seen if observed else true)
        x = A @ seen + B @ u
        return rest.tau[own] + u

    off = np.where(np.isin(range(n), own), 0.15, 0.0)
    return fl.simulate(scene, q0=rest.q + off, control=law, rate=1 / SAMPLE)


goal = fl.tip_position(chain, rest.q)
runs = {"true state": closed_loop(False), "Kalman filter": closed_loop(True)}
fig, panel = plt.subplots(figsize=(5, 3.2), layout="constrained")
for name, found in runs.items():
    panel.semilogy(found.t, 1e3 * np.linalg.norm(found.tip - goal, axis=1), label=name)
panel.set(xlabel="time [s]", ylabel="tip error [mm]")
panel.legend()
panel.grid(alpha=0.3)
