"""Draw the README's first picture, docs/steel_strips.png: `python docs/steel_strips.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

import flexlink as fl

HERE = Path(__file__).parent
MOMENTS = 11


def draw(run: fl.Trajectory) -> Figure:
    """Left the arm at equal intervals of time, right how far each link's tip is off the straight line of its root."""
    chain, elbow = run.chain, bodies_of(run.chain, 2)[0]
    figure = Figure(figsize=(12.0, 4.6), layout="constrained")
    motion, bending = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    for k in np.linspace(0, len(run.t) - 1, MOMENTS).round().astype(int):
        points = fl.frames(chain, run.q[k]).points
        motion.plot(points[:, 0], points[:, 1], color=colormaps["viridis"](0.9 * k / len(run.t)), linewidth=1.6)
        motion.plot(*points[elbow, :2], marker="o", color="0.2", markersize=3)
    motion.plot(run.tip[:, 0], run.tip[:, 1], color="0.6", linewidth=0.8, zorder=0)
    motion.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=f"every {run.t[-1] / (MOMENTS - 1):.1f} s")
    for link, name in enumerate(chain.link_names, start=1):
        bending.plot(run.t, deflections(run, link), label=name)
    bending.set(xlabel="time [s]", ylabel="tip off the root's axis [m]")
    bending.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    for panel in (motion, bending):
        panel.grid(alpha=0.3)
    return figure


def deflections(run: fl.Trajectory, link: int) -> np.ndarray:
    """Distance of a link's tip from the axis of its first segment, at every sample [m]."""
    root, *_, last = bodies_of(run.chain, link)
    placed = [fl.frames(run.chain, q) for q in run.q]
    return np.array([(at.rotations[root].T @ (at.points[last + 1] - at.points[root]))[1] for at in placed])


def bodies_of(chain: fl.Chain, link: int) -> list[int]:
    """Numbers of a link's segments among `chain.bodies`."""
    return [k for k, body in enumerate(chain.bodies[:-1]) if chain.coordinate(int(body["first"])).link == link]


if __name__ == "__main__":
    draw(fl.simulate(fl.load_scene(HERE / "steel_strips.toml"))).savefig(HERE / "steel_strips.png", dpi=130)
