"""Random runs reach their end or report why not, however often they are read; a `Simulator` gives the same results.

    python -m tests.campaigns.random_ends free 0 400      # satellites, by every method and four steps or tolerances
    python -m tests.campaigns.random_ends looks 0 1000    # satellites, arms, motors: read in three ways

Exit code 1 if a run ends early without an error, a simulator deviates, a comparison uses a row that was never written
(an infinite or undefined length), or two ways of reading differ.
"""

import collections
import functools
import math
import re
import sys
from collections.abc import Iterator

import numpy as np

import flexlink as fl
from tests.campaigns.random_motors import random_motor
from tests.campaigns.random_scenes import random_scene
from tests.support.looking import in_every_way
from validation.random_arms import Dice, random_tree

EXPLICIT, IMPLICIT = ("RK2", "RK3", "RK4", "DOPRI5", "DOP853", "RK10"), ("Gauss4", "Gauss6", "Radau5", "Radau9")
ADAPTIVE = ("auto", "DOP853", "Radau5", "Radau9")
STEPS = (2e-4, 1e-3, 5e-3, 2e-2)
TOLERANCES = (1e-2, 1e-3, 1e-5, 1e-7)
DURATION, SAMPLES = 0.2, 10
UNWRITTEN = re.compile(r"\b(inf|nan)\b")
SAME = 1e-12  # allowed difference [m]; a run and a simulator may continue in different coordinates


def random_satellite(dice: Dice) -> fl.Scene:
    """Return a random tree on a free base that spins at up to 20 rad/s, without gravity."""
    scene = random_tree(int(dice.linear(0, 1e6)))
    if not scene.arm.base.free:
        return random_satellite(dice)
    way = np.array(dice.three(1.0))
    spin = np.degrees(dice.linear(0.0, 20.0)) * way / np.linalg.norm(way)
    run = fl.RunSettings(duration=DURATION, sample=DURATION / SAMPLES)
    return scene.varied({"initial.base.spin_deg": tuple(spin.tolist()), "gravity": (0.0, 0.0, 0.0), "run": run})


def settings() -> Iterator[dict[str, object]]:
    """Every method with four steps, and with four tolerances if it has an error estimate."""
    for method in (*EXPLICIT, *IMPLICIT):
        yield from ({"method": method, "step": step, "tolerance": None} for step in STEPS)
    for method in ADAPTIVE:
        yield from ({"method": method, "tolerance": tolerance, "step": None} for tolerance in TOLERANCES)


def ended(scene: fl.Scene, simulator: bool) -> str:
    """Outcome of a run: "right", "doubted", the name of an error, or a fault in capitals."""
    try:
        run = fl.simulate(scene)
    except fl.FlexlinkError as error:
        return "UNWRITTEN" if UNWRITTEN.search(str(error)) else type(error).__name__
    if not math.isclose(run.t[-1], scene.run.duration, rel_tol=1e-12):
        return "EARLY"
    if UNWRITTEN.search(" ".join(run.warnings)):
        return "UNWRITTEN"
    if simulator and not run.warnings and _astray(scene, run) > SAME:
        return "STALE"
    return "doubted" if run.warnings else "right"


def _astray(scene: fl.Scene, run: fl.Trajectory) -> float:
    """Deviation from the run [m] of a simulator that stops at each sample."""
    arm, farthest = fl.Simulator(scene), 0.0
    for tip, t, before in zip(run.tip[1:], run.t[1:], run.t[:-1], strict=True):
        state = arm.step(duration=float(t - before))
        farthest = max(farthest, float(np.abs(fl.tip_position(arm.chain, state.q) - tip).max()))
    return farthest


def free(first: int, last: int) -> int:
    """Run satellites with all methods; return the number of wrong runs."""
    found, every = collections.Counter[str](), list(settings())
    for seed in range(first, last):
        scene = random_satellite(Dice(seed))
        for number, run in enumerate(every):
            fixed = run["step"] is not None
            how = ended(
                scene.varied({f"run.{key}": value for key, value in run.items()}), fixed and number % 7 == seed % 7
            )
            found[how] += 1
            if how.isupper():
                print(f"seed {seed}, {run}: {how}", flush=True)
    print(*(f"{number:6d}  {how}" for how, number in found.most_common()), sep="\n")
    return sum(number for how, number in found.items() if how.isupper())


def drawn(seed: int) -> fl.Scene:
    """Return a satellite, an arm, or an arm with motors that saturate, with a random method."""
    dice = Dice(seed)
    scene = (random_satellite, random_scene, random_motor)[seed % 3](dice)
    run = dice.one_of(*settings())
    own = {"run.duration": DURATION, "run.sample": DURATION / SAMPLES, "run.max_evaluations": 100_000}
    return scene.varied({**own, **{f"run.{key}": value for key, value in run.items()}})


def looks(first: int, last: int) -> int:
    """Read random runs in three ways; return the number of runs that differ."""
    different, ran = 0, 0
    for seed in range(first, last):
        one, *others = in_every_way(functools.partial(fl.simulate, drawn(seed)), seed)
        ran += isinstance(one[-1], tuple)
        if others != [one, one]:
            different += 1
            print(f"seed {seed}: {one} {others}", flush=True)
    print(f"{last - first} runs read in three ways, {different} differ; {ran} ran to samples")
    return different


if __name__ == "__main__":
    campaign = {"free": free, "looks": looks}[sys.argv[1]]
    sys.exit(bool(campaign(*map(int, sys.argv[2:4]))))
