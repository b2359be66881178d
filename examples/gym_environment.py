"""An environment for reinforcement learning
=========================================

An agent sets torques at 100 Hz to bring the tip of a flexible arm to rest at a target. The environment is a subclass of
Gymnasium's ``Env``, which learning libraries use, and passes its checker.
"""

from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np

import flexlink as fl

models = Path("models") if Path("models").is_dir() else Path("../models")  # of the checkout
SCENE = fl.load_scene(models / "three_links.toml").varied({"run.step": 1e-3})
EFFORT = np.array([200.0, 400.0, 200.0])  # N m, twice the largest gravity torque
PERIOD, EPISODE = 0.01, 3.0  # s


class ArmEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Action: torques / `EFFORT`; observation: q [rad], q̇ [rad/s], tip and target [m]; reward: −distance [m]."""

    def __init__(self) -> None:
        self.arm = fl.Simulator(SCENE)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)
        self.observation_space = gymnasium.spaces.Box(
            -np.inf, np.inf, (2 * self.arm.chain.n + 6,), np.float64
        )

    def reset(
        self, *, seed: int | None = None, options: dict | None = None
    ) -> tuple[np.ndarray, dict]:
        """Start at rest as in the scene, with a new target."""
        super().reset(seed=seed)
        self.goal = np.zeros(self.arm.reset().q.size)
        self.goal[self.arm.chain.active] = self.np_random.uniform(
            [-1.0, -0.5, -1.5], [1.0, 1.0, 0.0]
        )
        self.target = fl.tip_position(self.arm.chain, self.goal)
        return self.observe(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Apply torques for a period; the episode ends if the motion cannot be computed."""
        try:
            self.arm.step(EFFORT * np.clip(action, -1.0, 1.0), duration=PERIOD)
            lost = False
        except fl.errors.DivergenceError:
            lost = True  # the arm keeps its state
        seen = self.observe()
        return (
            seen,
            -float(np.linalg.norm(seen[-6:-3] - seen[-3:])),
            lost,
            self.arm.time > EPISODE - PERIOD / 2,
            {},
        )

    def observe(self) -> np.ndarray:
        """q, q̇, tip, target."""
        _, q, qd = self.arm.state
        return np.concatenate([q, qd, fl.tip_position(self.arm.chain, q), self.target])


# %%
# An episode with a model-based agent: joint PD towards the target's angles, with gravity compensation.
env = ArmEnv()
seen, _ = env.reset(seed=7)
own, rewards, ended = env.arm.chain.active, [], False
while not ended:
    _, q, qd = env.arm.state
    pd = 400.0 * (env.goal - q) - 150.0 * qd + fl.gravity_torque(env.arm.chain, q)
    seen, reward, _, ended, _ = env.step(pd[own] / EFFORT)
    rewards.append(reward)
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
panel.semilogy(PERIOD * np.arange(1, len(rewards) + 1), -1e3 * np.array(rewards))
panel.set(xlabel="time [s]", ylabel="distance of tip from target [mm]")
panel.grid(alpha=0.3)
