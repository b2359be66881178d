"""A linear-quadratic regulator from the linear model, on the nonlinear arm: do its poles come out as designed?"""

from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_are

import flexlink as fl

scene = fl.load_scene(Path(__file__).parents[1] / "models" / "three_links.toml").varied({"run.step": 2.5e-4})
chain = fl.lump(scene)
own, n = chain.active, chain.n
still = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=own)  # bent by gravity, joints held
model, rest = fl.linearize(chain, still.q, tau=still.tau), np.append(still.q, np.zeros(n))  # rest: (q, q̇)
price = 0.01  # of a torque [1/(N m)²], against 1e4 of an angle and 1e2 of a rate
riccati = solve_continuous_are(model.A, model.B, np.diag([1e4] * n + [1e2] * n), price * np.eye(len(own)))
gain = model.B.T @ riccati / price
designed = np.linalg.eigvals(model.A - model.B @ gain)


def run(x: np.ndarray, duration: float, sample: float) -> fl.Trajectory:
    """The nonlinear arm from the state x, δu = −K δx at every stage of every step."""

    def law(_: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return still.tau[own] - gain @ (np.concatenate([q, qd]) - rest)

    return fl.simulate(scene, q0=x[:n], qd0=x[n:], control=law, duration=duration, sample=sample)


small, brief = 1e-5, 1e-3  # rad and rad/s; s: less than half a period of the fastest pole
ends = [[np.concatenate(run(rest + d, brief, brief).state(-1)[1:]) for d in (e, -e)] for e in small * np.eye(2 * n)]
flow = np.array([(one - other) / (2 * small) for one, other in ends]).T  # ∂x(t + brief)/∂x(t), of the nonlinear arm
poles = np.log(np.linalg.eigvals(flow).astype(complex)) / brief
error = (np.abs(designed[:, None] - poles).min(axis=1) / np.abs(designed)).max()

far = run(rest + 0.2 * np.isin(range(2 * n), own), 2.0, 0.01)  # 0.2 rad in each joint
away = np.linalg.norm(far.tip - fl.tip_position(chain, rest[:n]), axis=1)  # [m]
print(f"{2 * n} poles, slowest {designed.real.max():.3f} 1/s: at most {100 * error:.1g} % off the linear prediction")
print(f"the tip is {away[0]:.3f} m off, after 1 s {away[100]:.4f} m, after 2 s {away[-1]:.5f} m")
