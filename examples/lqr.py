"""A linear-quadratic regulator (LQR)
==================================

``fl.linearize`` computes A, B, C, D about any posture; SciPy solves the Riccati equation. The gain is then applied to
the nonlinear arm, and the measured poles are compared with the designed ones.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import solve_continuous_are

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
scene = fl.load_scene(models / "three_links.toml").varied({"run.step": 2.5e-4})
chain = fl.lump(scene)
own, n = chain.active, chain.n
still = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=own)  # bent by gravity
rest = np.append(still.q, np.zeros(n))  # (q, q̇)
model = fl.linearize(chain, still.q, tau=still.tau)
price = 0.01  # weight of a torque [1/(N m)²]; an angle has 1e4, a rate 1e2
Q, R = np.diag([1e4] * n + [1e2] * n), price * np.eye(len(own))
riccati = solve_continuous_are(model.A, model.B, Q, R)
gain = model.B.T @ riccati / price
designed = np.linalg.eigvals(model.A - model.B @ gain)


def run(x: np.ndarray, duration: float, sample: float) -> fl.Trajectory:
    """Run the nonlinear arm from state x with δu = −K δx at every stage of every step."""

    def law(_: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return still.tau[own] - gain @ (np.concatenate([q, qd]) - rest)

    return fl.simulate(scene, q0=x[:n], qd0=x[n:], control=law, duration=duration, sample=sample)


# %%
# Poles of the nonlinear arm, from the change of small perturbations of the state in one millisecond.
small = 1e-5  # rad and rad/s
brief = 1e-3  # s: less than half a period of the fastest pole
ends = [
    [np.concatenate(run(rest + d, brief, brief).state(-1)[1:]) for d in (e, -e)]
    for e in small * np.eye(2 * n)
]
flow = np.array(
    [(one - other) / (2 * small) for one, other in ends]
).T  # ∂x(t + brief)/∂x(t), of the nonlinear arm
poles = np.log(np.linalg.eigvals(flow).astype(complex)) / brief
error = (np.abs(designed[:, None] - poles).min(axis=1) / np.abs(designed)).max()
print(
    f"{2 * n} poles, slowest {designed.real.max():.3f} 1/s: "
    f"at most {100 * error:.1g} % off the linear prediction"
)

# %%
# With an initial error of 0.2 rad in each joint, the regulator still brings the tip to rest.
far = run(rest + 0.2 * np.isin(range(2 * n), own), 2.0, 0.01)
away = np.linalg.norm(far.tip - fl.tip_position(chain, rest[:n]), axis=1)  # [m]
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
panel.semilogy(far.t, 1e3 * away)
panel.set(xlabel="time [s]", ylabel="tip error [mm]")
panel.grid(alpha=0.3)
