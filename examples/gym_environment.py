"""The arm as a Gymnasium environment: torques at 100 Hz are to bring the tip of a bending arm to a target at rest."""

from pathlib import Path

import gymnasium
import numpy as np

import flexlink as fl

SCENE = fl.load_scene(Path(__file__).parents[1] / "models" / "three_links.toml").varied({"run.step": 1e-3})
EFFORT, PERIOD, EPISODE = np.array([200.0, 400.0, 200.0]), 0.01, 3.0  # N m, twice what gravity takes at most; s


class ArmEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Action: torques over `EFFORT`; observation: q [rad], q̇ [rad/s], tip and target [m]; reward: −distance."""

    def __init__(self) -> None:
        self.arm = fl.Simulator(SCENE)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2 * self.arm.chain.n + 6,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """At rest as the scene says, with another target."""
        super().reset(seed=seed)
        goal = np.zeros(self.arm.reset().q.size)
        goal[self.arm.chain.active] = self.np_random.uniform([-1.0, -0.5, -1.5], [1.0, 1.0, 0.0])
        self.target = fl.tip_position(self.arm.chain, goal)
        return self.observe(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Hold torques for a period; lost is an arm whose motion is beyond what can be computed."""
        try:
            self.arm.step(EFFORT * np.clip(action, -1.0, 1.0), duration=PERIOD)
            lost = False
        except fl.errors.DivergenceError:
            lost = True  # the arm stays where it was
        seen = self.observe()
        return seen, -float(np.linalg.norm(seen[-6:-3] - seen[-3:])), lost, self.arm.time > EPISODE - PERIOD / 2, {}

    def observe(self) -> np.ndarray:
        """q, q̇, tip, target."""
        _, q, qd = self.arm.state
        return np.concatenate([q, qd, fl.tip_position(self.arm.chain, q), self.target])
