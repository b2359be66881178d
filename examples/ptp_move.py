"""A move of 1 s with 8 kg at the tip, and what input shaping (ZV, ZVD) leaves of its vibration."""

from pathlib import Path

import numpy as np

import flexlink as fl

scene = fl.load_scene(Path(__file__).parents[1] / "models" / "ptp_move.toml")  # PD, shaped by ZVD
drive, move, chain = scene.drive, scene.drive.reference, fl.lump(scene)
there = scene.varied({"initial.joint_deg": move.to_deg, "drive": fl.Drive()})
goal = fl.solve_static(chain, fl.initial_state(there, chain)[0], locked=chain.active).q  # bent by gravity
slow = fl.pd_poles(chain, goal, kp=drive.kp, kd=drive.kd)[:2]  # both are first bending, upright and sideways
shapers = {"unshaped": None, "ZV": fl.InputShaper.at(slow, "ZV"), "ZVD": fl.InputShaper.at(slow, "ZVD")}
runs = {name: fl.simulate(scene.varied({"drive.reference.shaper": shaper})) for name, shaper in shapers.items()}
left = {name: fl.residual_vibration(run, after=2.0) for name, run in runs.items()}  # [m]; all references have ended
rest = fl.tip_position(chain, goal)
settled = {name: fl.settling_time(run, target=rest, tolerance=1e-3) for name, run in runs.items()}  # [s]
for name in runs:
    print(f"{name:8}: vibrates by {1e3 * left[name]:.3f} mm after 2 s, within 1 mm from {settled[name]:.2f} s on")
print("shaped for", np.round(np.abs(slow) / (2 * np.pi), 4), "Hz; in the scene's file", move.shaper.frequency_hz)
