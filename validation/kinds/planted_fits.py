"""Fits to simulated records of random arms with coloured noise: does the stated interval contain the true value?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, lfilter

import flexlink as fl
from flexlink.common.types import Array
from flexlink.identification.estimate import Estimate
from validation.case import Case, Measured

LONG = 400  # samples before the record, after which the initial state of the filters no longer matters
MOST = 4  # largest number of parameters that are fitted at once


class Held(NamedTuple):
    """Distance of each fitted parameter's true value from its estimate, in units of the interval's half width."""

    off: list[float]
    worst: int  # seed of the arm with the largest distance
    left: int  # number of arms whose fit was refused or flagged as not identifiable

    @property
    def inside(self) -> int:
        """Number of true values inside their intervals."""
        return sum(abs(each) <= 1 for each in self.off)


def run(case: Case, arms: int, sought: tuple[str, ...], seed: int = 0) -> Iterator[Measured]:
    """Yield the share of true values inside the stated interval, over `arms` arms with identifiable parameters."""
    found = held(seed, arms, sought)
    facts, count = {"arms": arms}, len(found.off)
    note = f"{found.inside} of {count}; {found.left} further arms were refused or flagged, and do not count."
    share = found.inside / count
    yield Measured("inside", share, "random arms", varied=facts, note=note)
    yield Measured("|inside − 0.95|", abs(share - 0.95), "random arms", varied=facts)
    largest = max(map(abs, found.off))
    yield Measured("largest error", largest, "random arms", varied=facts, note=f"Seed {found.worst}.")


def held(first: int, count: int, sought: Sequence[str]) -> Held:
    """Fit `count` arms with identifiable parameters."""
    off: list[float] = []
    seed = worst = first
    done = 0
    while done < count:
        problem, true = planted(seed, sought)
        seed += 1
        try:
            found = fl.fit(problem, grid="ignore")  # the truth has the same segments
        except fl.errors.IdentifiabilityError:
            continue
        if not found.identifiable:
            continue
        done += 1
        here = [(found[path].value - value) / _half(found[path], value) for path, value in true.items()]
        worst = seed - 1 if max(map(abs, here)) > max(map(abs, off), default=0.0) else worst
        off += here
    return Held(off, worst, seed - first - count)


def _half(found: Estimate, true: float) -> float:
    """Distance of the estimate from the end of its interval on the side of the true value."""
    return found.high - found.value if true > found.value else found.value - found.low


def planted(seed: int, sought: Sequence[str]) -> tuple[fl.fits.FitProblem, dict[str, float]]:
    """A fit problem with wrong initial guesses, and the true parameters."""
    rng = np.random.default_rng(seed)
    true = arm(rng)
    run = fl.simulate(true.varied({"run.relative_tolerance": 1e-9}))
    size = 10 ** rng.uniform(-3.3, -2.3)
    names = ["tip x [m]", "tip y [m]", "q l0 [rad]"][: rng.integers(1, 4)]
    seen = {"t [s]": run.t} | {name: run.columns[name] + size * noise(rng, len(run.t)) for name in names}
    data = {name: tuple(column.tolist()) for name, column in seen.items()}
    paths = [str(path) for path in rng.choice(sought, rng.integers(1, MOST + 1), replace=False)]
    values = {path: float(true.values_at(path)[0]) for path in paths}
    start = {
        path: v + rng.uniform(-3, 3) if "deg" in path else v * rng.uniform(0.85, 1.15) for path, v in values.items()
    }
    problem = fl.fits.FitProblem(
        scene=true.varied(start), parameter=tuple(fl.fits.FitParameter(path=path) for path in paths),
        run=(fl.fits.FitRun(name="planted", columns=data),),
    )  # fmt: skip
    return problem, values


def arm(rng: np.random.Generator) -> fl.Scene:
    """An arm of one to three flexible links, all cut from one strip, released at random angles under gravity."""
    links = rng.integers(1, 4)
    return fl.Scene(
        name="random",
        gravity=(0.0, -9.81, 0.0),
        arm=fl.Arm(
            materials={"steel": fl.Material(young=rng.uniform(1.5e11, 2.5e11), density=7850.0, loss_time=1e-3)},
            sections={"strip": fl.Section(shape="rectangle", height=rng.uniform(0.003, 0.006), width=0.03)},
            links=tuple(
                fl.Link(
                    name=f"l{k}", length=rng.uniform(0.3, 0.6), flex="z", segments=3, material="steel",
                    section="strip", joint=fl.Joint(armature=rng.uniform(0.02, 0.1), viscous=rng.uniform(0.05, 0.2)),
                )
                for k in range(links)
            ),
            tip=fl.RigidBody(mass=rng.uniform(0.1, 0.5)),
        ),
        initial=fl.InitialState(joint_deg=tuple(rng.uniform(-60, 20, links))),
        run=fl.RunSettings(duration=round(float(rng.uniform(1.0, 2.0)), 1), sample=0.005),
    )  # fmt: skip


def noise(rng: np.random.Generator, n: int) -> Array:
    """Noise of size 1, coloured by a first-order filter, a resonance, or a low-pass filter with a floor; or white."""
    w = rng.standard_normal(n + LONG)
    kind = rng.integers(4)
    if kind == 0:
        e = lfilter([1.0], [1.0, -rng.uniform(0.5, 0.95)], w)
    elif kind == 1:
        r, φ = rng.uniform(0.7, 0.95), rng.uniform(0.1, 2.0)
        e = lfilter([1.0], [1.0, -2 * r * np.cos(φ), r * r], w)
    elif kind == 2:
        e = lfilter(*butter(2, rng.uniform(0.1, 0.5)), w) + 0.1 * rng.standard_normal(n + LONG)
    else:
        e = w
    return np.asarray(e[LONG:] / e.std())
