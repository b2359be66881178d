"""A move of 1 s with 8 kg at the tip, and what input shaping (ZV, ZVD) leaves of its vibration."""

from pathlib import Path

import numpy as np

import flexlink as fl

scene = fl.load_scene(Path(__file__).with_name("three_links.toml"))
there = scene.varied({"initial.joint_deg": (60.0, 30.0, -60.0)})
chain, kp, kd = fl.lump(scene), 4e4, 4e2  # PD gains [N m/rad, N m s/rad], as stiff as a robot's
own = chain.active  # the driven joints
start, goal = (fl.initial_state(s, chain)[0] for s in (scene, there))  # bent by gravity, joints held
loads = [np.where(np.isin(range(chain.n), own), fl.gravity_torque(chain, q), 0.0) for q in (start, goal)]  # hold them
model = fl.linearize(chain, goal, np.zeros(chain.n), loads[1])
gains = np.hstack([kp * np.eye(chain.n)[own], kd * np.eye(chain.n)[own]])
poles = np.linalg.eigvals(model.A - model.B @ gains)  # λ = −σ ± iω of the arm on its motors
slow = sorted((pole for pole in poles if pole.imag > 0), key=abs)[:2]  # both are first bending, sideways and upright


def move(order: int) -> fl.Trajectory:
    """Quintic through an input shaper that has `order` zeros on each slow pole: 0 none, 1 ZV, 2 ZVD."""
    impulses = [(0.0, 1.0)]  # time [s], weight
    for pole in slow * order:
        half, k = np.pi / pole.imag, np.exp(np.pi * pole.real / pole.imag)
        impulses = [(t + later, a * part / (1 + k)) for t, a in impulses for later, part in ((0.0, 1.0), (half, k))]

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        done = sum(a * x**3 * (10 - 15 * x + 6 * x * x) for s, a in impulses for x in [min(max(t - s, 0.0), 1.0)])
        target, load = (a + done * (b - a) for a, b in ((start, goal), loads))
        return (kp * (target - q) - kd * qd + load)[own]

    return fl.simulate(scene, control=law, rate=1000)


runs = {"unshaped": move(0), "ZV": move(1), "ZVD": move(2)}
left = {name: fl.residual_vibration(run, after=2.0) for name, run in runs.items()}  # [m]; all references have ended
for name, run in runs.items():
    settled = fl.settling_time(run, target=fl.tip_position(chain, goal), tolerance=1e-3)
    print(f"{name:8}: vibrates by {1e3 * left[name]:.3f} mm after 2 s, within 1 mm from {settled:.2f} s on")
