"""Compare `auto` with all methods it chooses from, on random scenes: `auto` costs little more than the cheapest method.

    python -m tests.campaigns.random_methods 0 90  # seeds 0 … 89, each with four tolerances, and a summary at the end

Rigid and flexible arms in a plane and in space, trees, free bases, motors that saturate, torque jumps, sampled laws,
robots, scenes that use every key of a file; 10 to 400 samples. All methods take turns in one process, and the smallest
processor time of each counts, so other load does not matter. Exit code 1 if `auto` costs more than allowed.
"""

import collections
import itertools
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import flexlink as fl
from tests.campaigns.fresh_scene_maker import make
from tests.campaigns.random_jumps import random_jump
from tests.campaigns.random_motors import random_motor
from tests.campaigns.random_scenes import random_scene
from validation.random_arms import Dice, random_arm, random_tree

METHODS = ("auto", "Radau5", "Radau9", "DOP853")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6)  # fractions of the reach
NEAR, NEARLY_ALL, FAR = 1.3, 0.95, 2.0  # cost relative to the cheapest; fraction of cells below NEAR; limit for all
FIRST_SEED = 20261124
TURNS, LEAST = 5, 0.02  # minimum number of runs per method, and their minimum total processor time [s]
AFFORDABLE = 2e5  # maximum evaluations per run; a method that needs more is not the cheapest
ROBOTS = Path(__file__).parents[2] / "models" / "robots"
SAMPLES = (10, 40, 100, 400)


class Cell(NamedTuple):
    """Times of all runs of a scene with one tolerance [s]; infinite if a run fails or is too expensive."""

    seed: int
    kind: str
    tolerance: float
    seconds: dict[str, float]
    method: str  # the final method of `auto`

    @property
    def ratio(self) -> float:
        """Time of `auto` relative to the cheapest method."""
        return self.seconds["auto"] / min(self.seconds[name] for name in METHODS[1:])


def of_kind(seed: int) -> tuple[str, fl.Scene]:
    """Kind of a seed's scene, and the scene."""
    kind = (*KINDS,)[seed % len(KINDS)]
    return kind, KINDS[kind](Dice(FIRST_SEED + seed), seed)


def rigid(dice: Dice, seed: int) -> fl.Scene:
    """Rigid arm that falls or follows a reference, with many samples."""
    return driven(dice, random_arm(seed).rigidified(), dice.one_of(0.5, 1.0, 2.0), dice.one_of(100, 400, 400))


def bending(dice: Dice, _seed: int) -> fl.Scene:
    """Arm of up to three links, soft to stiff, with friction, drives, wrenches."""
    duration = dice.one_of(0.3, 1.0, 2.0)
    return random_scene(dice).varied({"run.duration": duration, "run.sample": duration / dice.one_of(*SAMPLES)})


def arm(dice: Dice, seed: int) -> fl.Scene:
    """Spatial arm with all features of a link."""
    return driven(dice, random_arm(seed), dice.one_of(0.3, 1.0), dice.one_of(*SAMPLES))


def tree(dice: Dice, seed: int) -> fl.Scene:
    """Arm with branches, sliding joints or a free base."""
    scene = random_tree(seed)
    if scene.arm.base.kind == "free":
        duration = dice.one_of(0.3, 1.0)
        return scene.varied({"run.duration": duration, "run.sample": duration / dice.one_of(*SAMPLES)})
    return driven(dice, scene, dice.one_of(0.3, 1.0), dice.one_of(*SAMPLES))


def every_key(_dice: Dice, seed: int) -> fl.Scene:
    """Scene that may use any key of a scene file, without extreme values."""
    made = next(made for k in range(100) if not (made := make(10_000 + 100 * seed + k)).extreme)
    with tempfile.TemporaryDirectory() as folder:
        scene = fl.load_scene(made.write(Path(folder)))
        fl.lump(scene)
        return scene.varied({"sensor": (), "run": fl.RunSettings(duration=scene.run.duration, sample=0.01)})


def motor(dice: Dice, _seed: int) -> fl.Scene:
    """Arm with motors that saturate."""
    return random_motor(dice)


def jump(dice: Dice, _seed: int) -> fl.Scene:
    """Arm with jumps of torque, target or wrench."""
    return random_jump(dice)


def sampled(dice: Dice, _seed: int) -> fl.Scene:
    """Arm with a control law at a few hundred hertz."""
    flex, number = dice.one_of("rigid", "z", "z", "xyz"), dice.one_of(1, 2, 3)
    segments = 1 if flex == "rigid" else dice.one_of(3, 5)
    links = tuple(
        fl.Link(name=f"link{k}", length=dice.linear(0.3, 0.8), flex=flex, segments=segments, material="stuff",
                section="bar", joint=fl.Joint(armature=dice.decades(-1.5, 0), viscous=0.2))
        for k in range(number)
    )  # fmt: skip
    rotors = [link.joint.armature for link in links]
    ω, rate = dice.linear(4.0, 12.0), dice.one_of(100.0, 250.0, 500.0)
    drive = fl.Drive(
        kind="pd", kp=tuple(J * ω**2 for J in rotors), kd=tuple(1.4 * J * ω for J in rotors), rate=rate,
        target_deg=tuple(dice.linear(-60, 60) for _ in links), gravity="rigid",
    )  # fmt: skip
    return fl.Scene(
        name="sampled",
        arm=fl.Arm(
            links=links,
            materials={"stuff": fl.Material(young=dice.decades(9.7, 11.3), density=2700.0, loss_time=1e-4)},
            sections={"bar": fl.Section(shape="rectangle", height=dice.linear(0.01, 0.03), width=0.03)},
            tip=fl.RigidBody(mass=dice.one_of(0.0, 1.0)),
        ),
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=tuple(dice.linear(-60, 60) for _ in links)),
        drive=drive, run=fl.RunSettings(duration=1.0, sample=dice.one_of(0.002, 0.01, 0.05)),
    )  # fmt: skip


def robot(dice: Dice, _seed: int) -> fl.Scene:
    """Commercial robot, possibly with flexible links."""
    names = ["ur5_flexible", "ur5_flexible", "panda_flexible", "z1_flexible", "tiago_flexible", "ur5", "panda", "talos"]
    return driven(dice, fl.load_scene(ROBOTS / f"{dice.one_of(*names)}.toml"), dice.one_of(0.5, 1.0), 100)


def driven(dice: Dice, scene: fl.Scene, duration: float, samples: int) -> fl.Scene:
    """Let an arm fall, hold it, or give it a reference."""
    run = fl.RunSettings(duration=duration, sample=duration / samples)
    inertia = np.array([_moved(scene, k) for k in range(len(scene.arm.links))])
    free = np.array([not link.joint.locked for link in scene.arm.links])
    slides = any(link.joint.slides for link in scene.arm.links)
    kind, ω = dice.one_of("fall", "step", "move"), dice.linear(3.0, 12.0)
    if kind == "fall" or slides:
        return scene.varied({"run": run})
    gains: dict[str, Any] = {"kp": tuple(inertia * ω**2 * free), "kd": tuple(1.4 * inertia * ω * free)}
    start = scene.initial.joint_deg
    goal = tuple(a + dice.linear(-40, 40) * f for a, f in zip(start, free, strict=True))
    if kind == "step":
        return scene.varied({"run": run, "drive": fl.Drive(kind="pd", **gains, target_deg=goal)})
    move = fl.Reference(profile="quintic", to_deg=goal, duration=0.6 * duration)
    return scene.varied({"run": run, "drive": fl.Drive(kind="pd", **gains, reference=move, gravity="rigid")})


def _moved(scene: fl.Scene, k: int) -> float:
    """Approximate inertia moved by a joint."""
    chain = fl.lump(scene)
    q, _ = fl.initial_state(scene, chain)
    M, active = fl.mass_matrix(chain, q), [j for j, link in enumerate(scene.arm.links) if not link.joint.locked]
    return float(M[chain.active[active.index(k)], chain.active[active.index(k)]]) if k in active else 0.0


KINDS = {
    "rigid": rigid, "bending": bending, "every key": every_key, "robot": robot, "tree": tree, "motor": motor,
    "arm": arm, "jump": jump, "sampled": sampled,
}  # fmt: skip


def cells(seed: int) -> list[Cell]:
    """Times of a scene's runs with every tolerance; empty if the scene does not run."""
    kind, scene = of_kind(seed)
    return [cell for tolerance in TOLERANCES if (cell := timed(seed, kind, scene, tolerance))]


def timed(seed: int, kind: str, scene: fl.Scene, tolerance: float) -> Cell | None:
    """Times of a scene's runs with one tolerance; the methods take turns."""
    run = {
        "run.tolerance": None,
        "run.relative_tolerance": tolerance,
        "run.step": None,
        "run.max_evaluations": AFFORDABLE,
    }
    problems: dict[str, fl.Problem] = {}
    taken: dict[str, list[float]] = {}
    ended = ""
    for name in METHODS:
        try:
            problem = fl.Problem(scene.varied({**run, "run.accuracy": "tip", "run.method": name}))
            steps = problem.simulate().steps
        except fl.FlexlinkError:
            if name == "auto":
                return None
            continue
        problems[name], taken[name] = problem, []
        ended = steps.method if name == "auto" and steps else ended
    for turn in itertools.count():
        for name, problem in problems.items():
            if turn < TURNS or sum(taken[name]) < LEAST:
                started = time.process_time()
                problem.simulate()
                taken[name].append(time.process_time() - started)
        if turn >= TURNS and all(sum(times) >= LEAST for times in taken.values()):
            break
    if len(taken) < 2:
        return None
    least = {name: min(taken[name]) if name in taken else np.inf for name in METHODS}
    return Cell(seed, kind, tolerance, least, ended)


def main() -> int:
    """Run the command and return its exit code."""
    first, last = map(int, sys.argv[1:3])
    found = []
    for seed in range(first, last):
        try:
            found += (those := cells(seed))
        except fl.FlexlinkError as error:
            print(f"{seed:4} {type(error).__name__}: {str(error)[:120]}", flush=True)
            continue
        for cell in those:
            times = " ".join(f"{1e3 * cell.seconds[name]:9.3f}" for name in METHODS)
            print(f"{seed:4} {cell.kind:9} {cell.tolerance:7.0e} {times} {cell.ratio:6.2f} {cell.method}", flush=True)
    ratios = np.array([cell.ratio for cell in found])
    cheapest = collections.Counter(min(METHODS[1:], key=lambda name: cell.seconds[name]) for cell in found)
    print(f"{len(found)} cells; cheapest: {dict(cheapest)}")
    for part in (1.1, NEAR, FAR, 2.5):
        print(f"within {part} of the cheapest: {(ratios <= part).mean():.1%}")
    mean = np.exp(np.log(ratios).mean())
    print(f"median {np.median(ratios):.3f}, mean of logarithms {mean:.3f}, worst {ratios.max():.2f}")
    return int((ratios <= NEAR).mean() < NEARLY_ALL or ratios.max() > FAR)


if __name__ == "__main__":
    sys.exit(main())
