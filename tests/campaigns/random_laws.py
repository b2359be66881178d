"""Random arms with stops, walls, ropes, play, springs, motor limits and dry friction move as in another engine.

    OPENBLAS_NUM_THREADS=1 python -m tests.campaigns.random_laws 0 100   # seeds; exit code 1: a run is silently wrong
    OPENBLAS_NUM_THREADS=1 python -m tests.campaigns.random_laws 0 100 crane

One to four ties an arm: stops of joints, walls, ropes, bearings and gears with play, springs with dampers, cylinders,
sliders, exact rods. Arms and drives are those of `random_ties`. The truth is `tests.support.touching`.
"""

import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.describe.scene import Scene, scene_from
from flexlink.dynamics.ties import rows_by_tie, tie_rows
from tests.campaigns.random_ties import FAST, Found, Maker, runs, summary, torque_of
from tests.support.loops import TooHardError, placed, places
from tests.support.touching import Touching

MAKES = ("planar", "spatial", "tree", "slide", "tilted")
LAWS = ("stop", "wall", "rope", "play", "gear", "spring", "bushing", "cylinder", "slider", "rod", "bump")
DURATION, SAMPLE = 0.1, 0.05
MOST, EVALUATIONS = 400_000, 1e5  # evaluations of the truth; of a run


class LawMaker(Maker):
    """Makes the scene of a seed."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.make = MAKES[seed % len(MAKES)]
        self.flat = self.make in {"planar", "tilted"} or self.dice.chance(0.3)

    def scene(self) -> Scene:
        arm = self.arm()
        chain = fl.lump(arm)
        q = fl.initial_state(arm, chain)[0]
        number, limits = self.dice.one_of(1, 1, 2, 2, 3, 4), {}
        found = [self.law(f"t{k}", self.dice.one_of(*LAWS), (arm, chain, q), limits) for k in range(number)]
        return arm.varied(limits | {"tie": found, "run.max_evaluations": EVALUATIONS, "run.duration": DURATION})

    def law(self, name: str, law: str, at: tuple[Any, ...], limits: dict[str, Any]) -> dict[str, Any]:
        """A tie of a law that the posture may meet soon; limits of a joint that it needs are added to `limits`."""
        dice, (arm, chain, q) = self.dice, at
        link = dice.one_of(*[each.name for each in arm.arm.links][-3:])
        k = arm.arm.number(link) - 1
        soft, c = {"stiffness": dice.decades(2, 6)}, {"dissipation": dice.one_of(0.0, dice.decades(-2, 0.3))}
        angle, slide, tie = q[chain.index(k + 1, 0, 0)], arm.arm.slides[k], {"name": name, "link": link}
        if law == "stop":
            ends = [angle - dice.linear(0.02, 0.3), angle + dice.linear(0.02, 0.3)]
            limits[f"link.{link}.joint.limits_{'m' if slide else 'deg'}"] = ends if slide else np.degrees(ends).tolist()
        p, way = placed(*at, link), np.array(dice.three(1.0)) * (1, not self.flat or self.make == "tilted", 1)
        way /= np.linalg.norm(way)
        far, slack, d = dice.linear(0.2, 0.7), dice.linear(0.0, 0.05), {"damping": dice.one_of(0.0, dice.decades(0, 2))}
        to, here = {"point": (p + far * way).tolist()}, {"point": p.tolist()}
        wall = {"point": (p - slack * way).tolist(), "axis": way.tolist()}
        moves = {"times": [0.0, 0.1, dice.linear(0.15, 0.4)]}
        moves["lengths"] = [far, far * dice.linear(0.9, 1.1), far * dice.linear(0.9, 1.1)]
        by_law: dict[str, dict[str, Any]] = {
            "stop": {"kind": "stop", **soft, **c},
            "gear": {"kind": "joint", **soft, **c, "play": 2 * abs(angle) + 0.05},
            "wall": {"kind": "point", **soft, **c, "only": "push", "to": wall},
            "bump": {"kind": "distance", **soft, **c, "only": "push", "length": far - slack, "to": to},
            "rope": {"kind": "distance", **soft, **c, "only": "pull", "length": far + slack, "to": to},
            "play": {"kind": "distance", **soft, **c, "play": 0.01 + 2 * slack, "length": far, "to": to},
            "spring": {"kind": "distance", **soft, **d, "length": far * dice.linear(0.9, 1.1), "to": to},
            "bushing": {"kind": "point", **soft, **d, "to": here},
            "slider": {"kind": "slider", **soft, **d, "to": here | {"axis": way.tolist()}},
            "cylinder": {"kind": "distance", **soft, **d, **moves, "to": to},
            "rod": {"kind": "distance", "length": far, "to": to},
        }
        return tie | by_law[law]


class CraneMaker(Maker):
    """A bending boom and jib on two cylinders, a parallelogram that keeps the jib's seat level, play and a stop."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self.make = "crane"

    def scene(self) -> Scene:
        near, dice = self.dice.linear, self.dice
        long, far, tall = near(2.5, 3.5), near(1.5, 2.5), near(0.3, 0.5)
        raised, dropped = near(20.0, 50.0), near(-40.0, 10.0)
        joint = {"axis": [0, -1, 0]}
        bent = {"material": "steel", "section": "tube", "flex": "z", "segments": dice.one_of(3, 5)}
        bar = {"material": "steel", "section": "bar", "flex": "rigid"}
        limits = {"limits_deg": [dropped - near(0.2, 3.0), dropped + near(0.2, 3.0)]}
        links = [
            {"name": "boom", "length": long, "joint": joint, **bent},
            {"name": "seat", "length": 0.3, "joint": joint, **bar},
            {"name": "jib", "length": far, "joint": joint | limits, **bent},
            {"name": "hook", "length": 0.4, "joint": joint, **bar, "mount": {"rpy_deg": [0.0, 90.0, 0.0]}},
            {"name": "bar", "length": long, "on": "base", "mount": {"xyz": [0.0, 0.0, -tall]}, "joint": joint, **bar},
        ]
        arm = scene_from({
            "name": self.name, "gravity": [0, 0, -9.81], "link": links, "tip": {"mass": 0.0},
            "material": {"steel": {"young": 2.1e11, "density": 7850.0, "loss_time": dice.decades(-4, -3)}},
            "section": {"tube": {"shape": "tube", "outer": 0.06, "inner": 0.054},
                        "bar": {"shape": "tube", "outer": 0.05, "inner": 0.04}},
            "initial": {"joint_deg": [raised, -raised, dropped, -dropped + near(-1.0, 1.0), raised]},
            "run": {"duration": DURATION, "sample": SAMPLE, "tolerance": 1e-3, "max_evaluations": EVALUATIONS},
        }).varied({"link.hook.end.mass": dice.decades(0.5, 1.5)})  # fmt: skip
        at = arm, (chain := fl.lump(arm)), fl.initial_state(arm, chain)[0]
        foot, root = (near(0.6, 1.0), 0.0, near(-1.0, -0.6)), [0.2, 0.0, -tall]
        first = float(np.linalg.norm(placed(*at, "boom", x=1.5) - foot))
        second = float(np.linalg.norm(placed(*at, "jib", x=0.6) - placed(*at, "seat", point=root)))
        oil, moves = (
            {"kind": "distance", "stiffness": dice.decades(5, 6), "damping": dice.decades(3, 4)},
            [0.0, near(0.1, 0.25)],
        )
        ties = [
            {"name": "lift", "link": "boom", "x": 1.5, **oil, "to": {"point": list(foot)}, "times": moves,
             "lengths": [first, first + near(-0.02, 0.03)]},
            {"name": "luff", "link": "jib", "x": 0.6, **oil, "to": {"link": "seat", "point": root}, "times": moves,
             "lengths": [second, second + near(-0.03, 0.03)]},
            {"name": "pin", "kind": "point", "link": "bar", "to": {"link": "seat", "point": [0.0, 0.0, -tall]}},
            {"name": "stop", "kind": "stop", "link": "jib", "stiffness": dice.decades(5, 6), "dissipation": near(0, 1)},
            {"name": "play", "kind": "joint", "link": "hook", "stiffness": dice.decades(3, 4), "play": 0.02},
        ]  # fmt: skip
        return arm.varied({"tie": ties})


def judged(maker: Maker) -> Iterator[Found]:
    """The runs of a scene."""
    try:
        scene = maker.scene()
        problem = fl.Problem(scene)
    except fl.FlexlinkError as error:
        yield Found(maker.make, np.nan, str(error.id), note=str(error))
        return
    chain, t = problem.chain, SAMPLE * np.arange(round(DURATION / SAMPLE) + 1)
    ties = tie_rows(scene, chain)
    moves = {own.start: (tie.times, tie.lengths) for tie, own in rows_by_tie(scene.tie) if tie.times}
    start = problem.simulate(duration=0.0)
    truth = Touching(chain, ties, moves, force=scene.wrench.force, most=MOST)
    held = None if scene.drive.rate is None else np.arange(1, round(DURATION * scene.drive.rate)) / scene.drive.rate
    try:
        method = "DOP853" if truth.fastest(start.q[0]) < FAST else "Radau"
        q, pieces = truth.run(start.q[0], start.qd[0], t, torque_of(scene, chain), held, method)
        there = places(chain, q)
    except (TooHardError, AssertionError):
        there, pieces = np.array(np.nan), 0
    yield from (each for each, _ in runs(scene, maker.make, there, f"{pieces} pieces"))


if __name__ == "__main__":
    warnings.simplefilter("ignore", RuntimeWarning)
    found = []
    for seed in range(*map(int, sys.argv[1:3])):
        for each in judged(CraneMaker(seed) if "crane" in sys.argv else LawMaker(seed)):
            found.append(each)
            if each.outcome not in {"right", "warned", "unknown"} or each.error > 3:
                print(f"seed {seed}:", *each, flush=True)
    sys.exit(summary(found))
