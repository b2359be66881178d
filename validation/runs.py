"""Runs of a scene: their facts, their stable steps, and the panels of the paper's figure 5 for any arm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import flexlink as fl
from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.record import trajectory_from_states
from flexlink.results.trajectory import Trajectory
from validation.case import Measured
from validation.facts import Fact, Facts
from validation.store import Series


def run_facts(run: RunSettings) -> dict[str, Fact]:
    """Method, step and duration of a run."""
    return {"method": run.method, "step": run.fixed_step, "duration": run.duration}


def motion_in_mujoco(scene: Scene, name: str = "", facts: Facts | None = None) -> Measured:
    """Largest difference of flexlink's angles from MuJoCo's in the same motion, with the facts of the run."""
    ours = fl.simulate(scene)
    _, q, _ = engines.load("mujoco", ours.chain).integrate(scene)
    apart = float(np.abs(q - ours.q).max())
    return Measured("MuJoCo's motion", apart, name or scene.name, "mujoco", {**(facts or {}), **run_facts(scene.run)})


def peaks(run: Trajectory) -> tuple[Array, Array]:
    """Times and heights of the maxima of the tip's y, by parabolas through three samples."""
    y = run.tip[:, 1]
    i = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] >= y[2:])) + 1
    before, here, after = y[i - 1], y[i], y[i + 1]
    bend, slope = before - 2 * here + after, (after - before) / 2
    return run.t[i] - slope / bend * (run.t[1] - run.t[0]), here - slope**2 / (2 * bend)


def stable_step_at_start(scene: Scene, method: str) -> float:
    """The largest stable step of a method at the initial state [s]."""
    chain = fl.lump(scene)
    return fl.stable_step(chain, *fl.initial_state(scene, chain), method=method)


def stable_steps(scene: Scene, method: str, of_stable: float = 1.0) -> int:
    """Number of steps between samples that keeps the step within this fraction of the initial stable step."""
    return max(1, math.ceil(scene.run.spacing / (of_stable * stable_step_at_start(scene, method))))


def motion_series(scene: Scene, run: Trajectory, engine: str = "") -> Iterator[Series]:
    """Panels of the paper's figure 5 (active joints, passive joints by link, positions of joints and hand); energy."""
    chain, time = run.chain, {"time [s]": run.t}
    names = chain.joint_names
    degrees = {names[k]: np.degrees(run.q[:, k]) for k in range(chain.n)}
    links = [chain.coordinate(k).link for k in range(chain.n)]

    axis = {names[k]: f"about {'xyz'[c.axis - 1]}" for k, c in enumerate(chain.coordinates) if c.axis}

    def series(part: str, title: str, columns: dict[str, Any], y_label: str, what: str = "panel") -> Series:
        legend = {name: axis[name] for name in columns if name in axis}
        return Series(
            what, title, time | columns, "time [s]", "time [s]", y_label, scene=scene.name, part=part, engine=engine,
            legend=legend,
        )  # fmt: skip

    active = {names[k]: degrees[names[k]] for k in chain.active}
    yield series("active", "Active joints", active, "angle [deg]")
    for link in dict.fromkeys(links):
        passive = {names[k]: degrees[names[k]] for k in range(chain.n) if links[k] == link and k not in chain.active}
        if passive:
            title = f"Passive joints of link {link} ({chain.link_names[link - 1]})"
            yield series(f"passive-{link}", title, passive, "angle [deg]")
    places = _joint_places(run)
    for link, place in places.items():
        title = f"Coordinates of active joint {link} ({chain.link_names[link - 1]})"
        yield series(f"joint-{link}", title, dict(zip("xyz", place.T, strict=True)), "coordinate in frame 0 [m]")
    hand = dict(zip("xyz", run.tip.T, strict=True))
    yield series("hand", "Coordinates of the hand", hand, "coordinate in frame 0 [m]")
    energy = {name: np.asarray(getattr(run.energy, name)) for name in ("kinetic", "gravity", "elastic", "total")}
    yield series("", "Energy", energy, "energy [J]", what="energy")


def points_of(scene: Scene, chain: Chain, t: Array, q: Array, qd: Array) -> Trajectory:
    """An engine's samples, reduced to the number of points that a figure shows on flexlink's lines."""
    shown = 50  # points per engine in a figure
    every = slice(None, None, max(1, len(t) // shown))
    return trajectory_from_states(problem_of(scene, chain), t[every].copy(), q[every].copy(), qd[every].copy())


def _joint_places(run: Trajectory) -> dict[int, Any]:
    """Positions [m] of the moving active joints, by link number; shape (samples, 3)."""
    chain = run.chain
    bodies = {int(first): i for i, first in enumerate(chain.bodies["first"][:-1])}
    places = np.array([fl.frames(chain, q).points for q in run.q])
    found = {chain.coordinate(int(k)).link: places[:, bodies[int(k)]] for k in chain.active}
    return {link: place for link, place in found.items() if np.ptp(place, axis=0).any()}
