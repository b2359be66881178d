"""A batch of environments for reinforcement learning
==================================================

Sixty-four arms with different payloads learn at once: a subclass of Gymnasium's ``VectorEnv`` that advances all of them
in one call of ``fl.SimulatorBatch``. Arms whose episode is over restart at the next step, with a new target.
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


class ArmsEnv(gymnasium.vector.VectorEnv):
    """Action: torques / `EFFORT`; observation: q [rad], q̇ [rad/s], tip and target [m]; reward: −distance [m]."""

    def __init__(self, payloads: np.ndarray) -> None:
        self.arms = fl.SimulatorBatch([SCENE.varied({"tip.mass": m}) for m in payloads.tolist()])
        self.metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}
        self.num_envs, n, box = len(payloads), self.arms.chains[0].n, gymnasium.spaces.Box
        self.single_action_space = box(-1.0, 1.0, (3,), np.float64)
        self.single_observation_space = box(-np.inf, np.inf, (2 * n + 6,), np.float64)
        self.action_space = box(-1.0, 1.0, (self.num_envs, 3), np.float64)
        self.observation_space = box(-np.inf, np.inf, (self.num_envs, 2 * n + 6), np.float64)
        self.goal, self.target = np.zeros((self.num_envs, n)), np.zeros((self.num_envs, 3))

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple:
        """Start all arms at rest as in their scenes, with new targets."""
        super().reset(seed=seed)
        self.over, self.began = np.zeros(self.num_envs, bool), np.zeros(self.num_envs)
        self.begin(np.arange(self.num_envs))
        return self.observe(), {}

    def begin(self, arms: np.ndarray) -> None:
        """Start some arms, with new targets."""
        self.arms.reset(arms)
        angles = self.np_random.uniform([-1.0, -0.5, -1.5], [1.0, 1.0, 0.0], (len(arms), 3))
        self.goal[np.ix_(arms, self.arms.chains[0].active)] = angles
        self.target[arms] = [fl.tip_position(self.arms.chains[k], self.goal[k]) for k in arms]
        self.began[arms] = self.arms.time

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, ...]:
        """Apply torques for a period; an episode ends if the motion cannot be computed, or after `EPISODE`."""
        fresh, lost = self.over, np.zeros(self.num_envs, bool)
        if fresh.any():
            self.begin(np.flatnonzero(fresh))
        torques = EFFORT * np.clip(actions, -1.0, 1.0) * ~fresh[:, None]
        try:
            self.arms.step(torques, duration=PERIOD)
        except fl.errors.DivergenceError as error:  # no arm has moved
            lost[list(error.arms)] = True
            self.arms.reset(lost)
            self.arms.step(torques * ~lost[:, None], duration=PERIOD)
        seen = self.observe()
        rewards = -np.linalg.norm(seen[:, -6:-3] - seen[:, -3:], axis=1) * ~fresh
        late = self.arms.time - self.began > EPISODE - PERIOD / 2
        self.over = lost | late
        return seen, rewards, lost, late, {}

    def observe(self) -> np.ndarray:
        """q, q̇, tip, target of every arm."""
        _, q, qd = self.arms.state
        tips = [fl.tip_position(chain, own) for chain, own in zip(self.arms.chains, q, strict=True)]
        return np.concatenate([q, qd, tips, self.target], axis=1)


# %%
# An episode with a model-based agent: joint PD towards the target's angles of every arm, with gravity compensation.
env = ArmsEnv(np.linspace(2.0, 8.0, 64))
env.reset(seed=7)
own, rewards = env.arms.chains[0].active, []
for _ in range(round(EPISODE / PERIOD)):
    q, qd = env.arms.state[1:]
    held = [fl.gravity_torque(*each) for each in zip(env.arms.chains, q, strict=True)]
    pd = 400.0 * (env.goal - q) - 150.0 * qd + held
    rewards.append(env.step(pd[:, own] / EFFORT)[1])
fig, panel = plt.subplots(figsize=(5, 3), layout="constrained")
t = PERIOD * np.arange(1, len(rewards) + 1)
for label, of in (("farthest arm", np.min), ("median of 64 arms", np.median)):
    panel.semilogy(t, -1e3 * of(rewards, axis=1), label=label)
panel.legend()
panel.set(xlabel="time [s]", ylabel="distance of tip from target [mm]")
panel.grid(alpha=0.3)
