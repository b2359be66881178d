"""Random closed loops: runs are as near to another engine's as their tolerance, or warn that they are not.

    OPENBLAS_NUM_THREADS=1 python -m tests.campaigns.random_ties 0 300   # seeds; exit code 1: a run is silently wrong
    OPENBLAS_NUM_THREADS=1 python -m tests.campaigns.random_ties 0 300 moved   # the first joint has a prescribed motion

Planar and spatial loops, rods, links tied to links, two loops, trees, slides, strain modes, springs between hinges;
rigid to soft links, dampers, dry friction, gears, drives with limits or sampled, wrenches, initial rates, any gravity.
The truth is `tests.support.loops`, or for arms too stiff for it, a run with Radau9.
"""

import collections
import contextlib
import sys
import warnings
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

import flexlink as fl
from flexlink.describe.scene import scene_from
from flexlink.dynamics.free_motion import all_motions
from flexlink.dynamics.ties import gaps, tie_rows
from tests.support.loops import Loop, TooHardError, Torque, placed, places, turned, unaccelerated
from validation.random_arms import Dice

MAKES = ("planar", "tilted", "spatial", "rods", "links", "two", "tree", "slide", "modes", "cells")
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
WRONG, OPEN = 10.0, 1e-12  # wrong: error over tolerance; open: gap over size of the arm
DURATION, SAMPLE = 0.3, 0.05
MOST, FAST = 12_000, 1e4  # evaluations of the truth; rate [1/s] from which it is implicit
EVALUATIONS = 2e4  # of a run


class Found(NamedTuple):
    """A run of a loop."""

    make: str
    tolerance: float
    outcome: str  # "right", "warned", "unknown", "WRONG", "OPEN", or the id of an error
    error: float = np.nan  # over the tolerance
    gap: float = np.nan  # over the size of the arm
    note: str = ""


class Maker:
    """Makes the scene of a seed."""

    def __init__(self, seed: int) -> None:
        self.name, self.dice, self.make = f"ties {seed}", Dice(seed), MAKES[seed % len(MAKES)]
        self.flat = self.make in {"planar", "tilted"} or self.dice.chance(0.3)

    def scene(self) -> fl.Scene:
        """The first scene of this seed that can move; some are not quite closed at the start."""
        while True:
            arm = self.arm()
            chain = fl.lump(arm)
            q, slides = fl.initial_state(arm, chain)[0], arm.arm.slides
            scene = arm.varied({"tie": self.ties(arm, chain, q)})
            J = gaps(tie_rows(scene, chain), chain, q)[1] @ all_motions(chain)
            if np.linalg.matrix_rank(J, tol=1e-9) < J.shape[1]:
                off = self.dice.chance(0.15) * np.array([self.dice.linear(-2, 2) * (not slide) for slide in slides])
                return scene.varied({"initial.joint_deg": np.add(scene.initial.joint_deg, off).tolist()})

    def arm(self) -> fl.Scene:
        """An open arm in a random posture."""
        dice, number = self.dice, self.dice.one_of(*((2, 3, 4, 5) if self.flat else (3, 4, 5, 6, 7)))
        flexes = dice.one_of(("rigid",), ("z", "rigid"), ("z",) if self.flat else ("xyz",), ("z", "yz", "xyz", "rigid"))
        if self.make in {"modes", "cells"}:
            flexes = ("z",) if self.flat else ("yz", "xyz")
        links = [self.link(k, dice.one_of(*flexes)) for k in range(number)]
        if self.make == "tree":
            links[max(1, number // 2)]["on"] = dice.one_of("base", "l0") if number > 2 else "base"
        if self.make == "tilted":
            links[0]["mount"] = {"rpy": dice.three(2.0)}
        slides = [link["joint"].get("kind") == "prismatic" for link in links]
        deg = [0.0 if slide else dice.linear(-70, 70) for slide in slides]
        rates = [dice.linear(-60, 60) * (1.0 - slide) for slide in slides] if dice.chance(0.6) else [0.0] * number
        in_m = {"joint_m": [dice.linear(-0.1, 0.1) * slide for slide in slides]} if any(slides) else {}
        thick = dice.decades(-2.3, -1.5)
        return scene_from({
            "name": self.name, "link": links, "initial": {"joint_deg": deg, "rate_deg": rates, **in_m},
            "gravity": dice.one_of([0, 0, -9.81], [0, 0, -9.81], [0, 0, 0], list(dice.three(9.81))),
            "material": {"m": {"young": dice.decades(7, 11.3), "density": dice.decades(3, 3.9), "poisson": 0.3,
                               "loss_time": dice.one_of(1e-4 * (self.make == "cells"), dice.decades(-5, -2))}},
            "section": {"s": {"shape": "rectangle", "height": thick, "width": thick * dice.decades(-0.3, 0.5)}},
            "drive": self.drive(deg, slides), "wrench": {"force": list(dice.three(5.0))} if dice.chance(0.15) else {},
            "run": {"duration": DURATION, "sample": SAMPLE, "tolerance": 1e-3, "max_evaluations": EVALUATIONS},
        })  # fmt: skip

    def link(self, k: int, flex: str) -> dict[str, Any]:
        dice = self.dice
        joint: dict[str, Any] = {"axis": [0, dice.one_of(-1, -1, 1), 0] if self.flat else list(dice.direction())}
        if self.make == "slide" and (k == 1 or dice.chance(0.2)):
            joint |= {"kind": "prismatic", "axis": [1, 0, dice.one_of(0, 1)] if self.flat else list(dice.direction())}
        joint["viscous"] = dice.one_of(0.0, 0.0, dice.decades(-3, 0.5))
        joint["armature"] = dice.one_of(0.0, 0.0, dice.decades(-3, -1)) or 1e-3 * (not self.flat)  # slow twists
        if dice.chance(0.15):
            joint |= {"coulomb": dice.decades(-2, 0.3), "coulomb_width": dice.decades(-2, -0.5)}
        if dice.chance(0.08) and "kind" not in joint:
            joint |= {"armature": 0.02, "gear_stiffness": dice.decades(1.5, 4), "gear_damping": dice.one_of(0.0, 0.1)}
        joint |= {"quadratic": dice.decades(-2, 0)} if dice.chance(0.05) else {}
        link = {"name": f"l{k}", "length": round(dice.linear(0.2, 0.8), 3), "material": "m", "section": "s"}
        link |= {"joint": joint, "flex": flex}
        if flex != "rigid":
            link["segments"] = dice.one_of(3, 3, 5)
            link |= {"segments": 7, "modes": dice.one_of(1, 2)} if self.make == "modes" else {}
            if self.make == "cells":
                link |= {"shear": True} if dice.chance(0.5) else {"stretch": True}
            if dice.chance(0.1):
                link["friction"] = {"coulomb": dice.decades(-3, -1), "coulomb_width": 0.05}
            if dice.chance(0.15) and joint["armature"]:
                link["root_stiffness"] = {"z": dice.decades(1.5, 3.5)}
        return link | ({"end": {"mass": dice.linear(0.1, 1.0)}} if dice.chance(0.2) else {})

    def drive(self, deg: list[float], slides: list[bool]) -> dict[str, Any]:
        dice, kind = self.dice, self.dice.one_of("none", "none", "constant", "pd", "effort", "sampled")
        if kind in {"none", "constant"}:
            return {"kind": kind} | ({"torque": [dice.linear(-2, 2) for _ in deg]} if kind == "constant" else {})
        pd = {"kind": "pd", "kp": [dice.decades(0, 2) for _ in deg], "kd": [dice.decades(-1, 1) for _ in deg],
              "target_deg": [(at + dice.linear(-20, 20)) * (1 - slide) for at, slide in zip(deg, slides, strict=True)],
              "target_m": [dice.linear(-0.1, 0.1) * slide for slide in slides]}  # fmt: skip
        pd = pd if any(slides) else {key: value for key, value in pd.items() if key != "target_m"}
        return pd | {"effort": {"effort": [dice.decades(-0.5, 1)] * len(deg)}, "sampled": {"rate": 200.0}}.get(kind, {})

    def ties(self, *at: Any) -> list[dict[str, Any]]:
        """One tie or two that the posture closes, for a scene, its chain and its angles."""
        dice, ends = self.dice, [each.name for each in at[0].arm.links]
        kinds = {"rods": ("distance",), "links": ("distance", "point", "point", "hinge")}
        kind = dice.one_of(*kinds.get(self.make, ("point", "point", "hinge", "distance")))
        others = {"links": ends[:-2] or ends[:1], "rods": ["", *ends[:-1]], "tree": [next(iter(at[1].tips))]}
        other = dice.one_of(*others.get(self.make, [""]))
        found = [self.tie("t0", kind, ends[-1], other if other != ends[-1] else "", at)]
        if self.make == "two":
            other = self.tie("t1", dice.one_of("point", "distance", "distance"), ends[len(ends) // 2 - 1], "", at)
            found.append({**found[0], "name": "t1"} if dice.chance(0.15) else other)
        return found

    def tie(self, name: str, kind: str, link: str, other: str, at: tuple[Any, ...]) -> dict[str, Any]:
        dice, far = self.dice, 0.0 if self.dice.chance(0.7) else round(self.dice.linear(0.05, 0.2), 3)
        found: dict[str, Any] = {"name": name, "kind": kind, "link": link} | ({"x": far} if far else {})
        p, R = placed(*at, link, **({"x": far} if far else {})), turned(*at, link)
        o, B = (placed(*at, other, point=[0, 0, 0]), turned(*at, other)) if other else (np.zeros(3), np.eye(3))
        way, end = np.array(dice.three(1.0)) * (1, not self.flat or self.make == "tilted", 1), p
        if kind == "distance":
            end = placed(*at, other) if other and dice.chance(0.5) else p + dice.linear(0.2, 0.7) * way
            found["length"] = float(np.linalg.norm(p - end))
        found["to"] = {"point": (B.T @ (end - o)).tolist()} | ({"link": other} if other else {})
        if kind == "hinge":
            e = turned(*at, "l0")[:, 1] if self.flat else way
            found["axis"], found["to"]["axis"] = (R.T @ e).tolist(), (B.T @ e).tolist()
        return found


def torque_of(scene: fl.Scene, chain: fl.Chain) -> Torque:
    """The law of the drive, written again."""
    drive, active, zero = scene.drive, chain.active, np.zeros(len(chain.active))
    kp, kd, constant = (zero if each is None else np.array(each) for each in (drive.kp, drive.kd, drive.torque))
    to = np.where(chain.slides[active], drive.target_m or zero, np.radians(drive.target_deg or zero))
    most = np.array(drive.effort or zero + np.inf)

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        τ = np.zeros(chain.n)
        τ[active] = np.clip(constant + kp * (to - q[active]) - kd * qd[active], -most, most)
        return τ

    return law


def truth_of(problem: fl.Problem, rows: np.ndarray) -> tuple[np.ndarray, str]:
    """Places of all bodies at all samples, and where they are from; nan if they are unknown."""
    scene, chain, t = problem.scene, problem.chain, SAMPLE * np.arange(round(DURATION / SAMPLE) + 1)
    rows = np.concatenate([rows, unaccelerated(chain)])
    start, loop = problem.simulate(duration=0.0), Loop(chain, rows, force=scene.wrench.force, most=MOST)
    held = None if scene.drive.rate is None else np.arange(round(DURATION * scene.drive.rate)) / scene.drive.rate
    method = "DOP853" if loop.fastest(start.q[0]) < FAST else "Radau"
    try:
        q = loop.run(start.q[0], start.qd[0], t, torque_of(scene, chain), held=held, method=method)
        return places(chain, q), f"pinocchio {method}"
    except TooHardError:
        long = scene.varied({"run.max_evaluations": 10 * EVALUATIONS})
        with contextlib.suppress(fl.FlexlinkError):
            return places(chain, fl.simulate(long, method="Radau9", tolerance=1e-7).q), "Radau9"
    return np.array(np.nan), "unknown"


def moved(scene: fl.Scene, dice: Dice) -> fl.Scene:
    """The scene with a constant rate of its first joint."""
    start, rate, link = scene.initial.joint_deg[0], dice.linear(-90, 90), scene.arm.links[0].name
    motion = {
        "times": [0.0, 1.0],
        "angle_deg": [start, start + rate],
        "rate_deg": [rate] * 2,
        "acceleration_deg": [0.0] * 2,
    }
    rates = [rate, *(scene.initial.rate_deg or [0.0] * len(scene.arm.links))[1:]]
    return scene.varied({"motion": [{"link": link, **motion}], "initial.rate_deg": rates, "drive": {}})


def judged(seed: int, *, moves: bool = False) -> Iterator[Found]:
    """The runs of the scene of a seed."""
    maker = Maker(seed)
    scene = moved(maker.scene(), maker.dice) if moves else maker.scene()
    try:
        problem = fl.Problem(scene)
    except fl.FlexlinkError as error:
        yield Found(maker.make, np.nan, str(error.id), note=str(error))
        return
    ties = tie_rows(scene, problem.chain)
    truth, source = truth_of(problem, ties[0])
    for each, run in runs(scene, maker.make, truth, source):
        if run is None:
            yield each
            continue
        gap = max(np.abs(gaps(ties, run.chain, q)[0]).max() for q in run.q) / run.chain.size
        yield each._replace(gap=float(gap), outcome="OPEN" if gap > OPEN else each.outcome)


def runs(scene: fl.Scene, make: str, truth: np.ndarray, source: str) -> Iterator[tuple[Found, fl.Trajectory | None]]:
    """The runs of a scene with each tolerance, against the true places of all bodies at all samples, or nan."""
    for tolerance in TOLERANCES:
        try:
            run = fl.simulate(scene, tolerance=tolerance)
        except fl.FlexlinkError as error:
            yield Found(make, tolerance, str(error.id), note=str(error)), None
            continue
        off = np.linalg.norm(places(run.chain, run.q) - truth, axis=2).max() / tolerance
        known = "unknown" if np.isnan(off) else "WRONG" if off > WRONG else "right"
        outcome = "warned" if run.warnings or not run.kept else known
        yield Found(make, tolerance, outcome, float(off), note=f"{source}; {run.steps}"), run


def summary(found: Iterable[Found]) -> bool:
    """Print the errors of all makes and tolerances; return whether any run is silently wrong."""
    found = list(found)
    for key in dict.fromkeys(key for each in found for key in each[:2]):
        of_key = [each for each in found if key in each[:2]]
        error = np.array([each.error for each in of_key if not np.isnan(each.error)] or [np.nan])
        print(f"{key}: error / tolerance {np.median(error):.2g}, up to {error.max():.2g}",
              dict(collections.Counter(each.outcome for each in of_key)))  # fmt: skip
    return any(each.outcome.isupper() for each in found)


if __name__ == "__main__":
    warnings.simplefilter("ignore", RuntimeWarning)
    found = [
        (seed, each) for seed in range(*map(int, sys.argv[1:3])) for each in judged(seed, moves="moved" in sys.argv)
    ]
    for seed, each in found:
        if each.outcome.isupper():
            print(f"seed {seed}:", *each)
    sys.exit(summary(each for _, each in found))
