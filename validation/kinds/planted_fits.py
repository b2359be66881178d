"""Fits to simulated records: does the stated interval contain the true value?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import BPoly, PPoly
from scipy.signal import butter, lfilter

import flexlink as fl
from flexlink.common.types import Array
from flexlink.identification.fitted import Estimate, Fitted
from validation.case import Case, Measured
from validation.kinds import kind
from validation.oracles.hub_beam import Beam, Drive, Motion, simulate

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


@kind
def planted_fits(case: Case, arms: int, sought: tuple[str, ...], seed: int = 0) -> Iterator[Measured]:
    """Fits to simulated records of random arms with coloured noise: does the stated interval contain the true value?

    Yield the share of true values inside the stated interval, over `arms` arms with identifiable parameters.
    """
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
        here = [distance(found[path], value) for path, value in true.items()]
        worst = seed - 1 if max(map(abs, here)) > max(map(abs, off), default=0.0) else worst
        off += here
    return Held(off, worst, seed - first - count)


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


DURATION, RATE = 2.0, 200.0  # s, Hz
GRAVITY = 9.81  # m/s²
OF_THE_HUB = ("link.boom.joint.armature", "link.boom.joint.viscous")
ROOT, TILT = "link.boom.root_stiffness.z", "gravity.y"
SOUGHT = ("material.strip.young", "material.strip.loss_time", "tip.mass", *OF_THE_HUB, ROOT, TILT)
MARGIN = 1.96
"""Half a 95 % interval in standard deviations."""


class Rig(NamedTuple):
    """A true beam and its drive, the sensors on it, and what a user seeks with how many segments."""

    beam: Beam
    drive: Drive
    E: float
    h: float  # thickness of the strip [m]
    width: float  # [m]
    ρ: float
    sensors: tuple[fl.Sensor, ...]
    heads: tuple[str, ...]  # columns that are recorded
    sought: tuple[str, ...]
    segments: int

    @property
    def values(self) -> dict[str, float]:
        """True values of all numbers that can be sought."""
        true = (self.E, self.beam.loss_time, self.beam.tip_mass, self.beam.hub, self.beam.viscous, self.beam.root)
        return dict(zip(SOUGHT, (*true, self.beam.gravity[1]), strict=True))

    def motion(self, t: Array, beam: Beam | None = None) -> Motion:
        """True motion at times t."""
        return simulate(beam or self.beam, self.drive, t)

    def read(self, moved: Motion) -> dict[str, Array]:
        """What the sensors show of a motion, without noise, by column."""
        ideal = {"tip y [m]": lambda: moved.tip()[:, 1], "q boom [rad]": lambda: moved.θ}
        for one in self.sensors:
            ideal[_head(one)] = lambda one=one: _reading(one, moved)  # type: ignore[misc]
        return {head: ideal[head]() for head in self.heads}


class Outcome(NamedTuple):
    """Result of one fit: for every number the distance of its true value in half intervals; warnings of the fit."""

    seed: int
    refused: bool
    passed: bool
    off: dict[str, float]
    words: tuple[str, ...]  # ids of warnings
    found: Fitted | None = None


@kind
def fits_continuous_beam(case: Case, fits: int, seed: int) -> Iterator[Measured]:
    """Fits to records of a continuous beam on a hub: whatever the chain, the interval contains the true value.

    The records are those of the exact beam of `hub_beam`, not of a chain. A user fits them with 3 to 9 segments.

    Yield the shares of true values inside their intervals, over `fits` fits that are not refused.
    """
    outcomes, facts = list(held_beams(seed, fits)), {"fits": fits}
    passed = [one for one in outcomes if one.passed]
    off = [abs(each) for one in passed for each in one.off.values()]
    flagged = sum(len(one.off) for one in outcomes if not one.passed and not one.refused)
    inside = sum(each <= 1 for each in off)
    note = f"{inside} of {len(off)} numbers of fits that pass; {flagged} numbers in fits that do not pass."
    share = (inside + flagged) / (len(off) + flagged)
    yield Measured("inside or named", share, "continuous beams", varied=facts, note=note)
    yield Measured("inside", inside / len(off) if off else math.nan, "continuous beams", varied=facts)
    far = [(one, path) for one in passed for path, each in one.off.items() if abs(each) > 3 / MARGIN]
    note = "; ".join(f"{path} of seed {one.seed}: {', '.join(one.words) or 'no warning'}" for one, path in far)
    yield Measured("beyond 3 deviations", len(far), "continuous beams", varied=facts, note=note)
    silent = sum(not one.words for one, _ in far)
    yield Measured("beyond 3 deviations, no warning", silent, "continuous beams", varied=facts)
    yield Measured("passed", len(passed) / fits, "continuous beams", varied=facts)


def held_beams(first: int, count: int) -> Iterator[Outcome]:
    """Outcomes of the next `count` fits that are not refused."""
    seed = first
    while count:
        outcome = judged(seed)
        seed, count = seed + 1, count - (not outcome.refused)
        yield outcome


def judged(seed: int, **options: Any) -> Outcome:
    """Fit the records of one random rig; `options` are those of `fl.fit`."""
    rng = np.random.default_rng(seed)
    made = rig(rng)
    problem = posed(rng, made, recorded(rng, made))
    try:
        found = fl.fit(problem, **options)
    except fl.errors.IdentifiabilityError:
        return Outcome(seed, True, False, {}, ())
    off = {path: distance(found[path], made.values[path]) for path in made.sought}
    return Outcome(seed, False, found.passed, off, tuple(one.id for one in found.warnings), found)


def distance(found: Estimate, true: float) -> float:
    """Estimate minus true value, in lengths of the interval on that side."""
    return (found.value - true) / (found.high - found.value if true > found.value else found.value - found.low)


def rig(rng: np.random.Generator, kinds: Sequence[str] = ("pd", "pd", "pd", "pulse", "motion")) -> Rig:
    """A random strip on a hub whose clamped beam vibrates at 2 to 8 Hz; it turns by 5 to 10°."""
    kind = str(rng.choice(kinds))
    mounted, heads = _sensors(rng, kind)
    sought = _sought(rng, kind, heads)
    while True:
        E, ρ = (rng.uniform(1.9e11, 2.15e11), 7850.0) if rng.random() < 0.5 else (rng.uniform(6.6e10, 7.2e10), 2700.0)
        L, h, width = rng.uniform(0.4, 0.8), rng.uniform(0.002, 0.006), rng.uniform(0.02, 0.04)
        EI, ρA = E * width * h**3 / 12, ρ * width * h
        payload = rng.uniform(0.1, 1.5) * ρA * L
        ω = math.sqrt(3 * EI / ((payload + 0.236 * ρA * L) * L**3))
        if 2 < ω / (2 * math.pi) < 8:
            break
    inertia = ρA * L**3 / 3 + payload * L**2
    tilt = math.radians(rng.uniform(1, 4)) * rng.choice([-1, 1]) if TILT in sought else 0.0
    beam = Beam(
        L, EI, ρA, ρA * h**2 / 12, loss_time=2 * rng.uniform(0.002, 0.02) / ω, tip_mass=payload,
        hub=rng.uniform(0.2, 1.5) * inertia, viscous=rng.uniform(0.02, 0.2) * inertia * ω,
        root=EI / L * 10 ** rng.uniform(0.5, 1.3) if ROOT in sought else math.inf,
        gravity=(0.0, GRAVITY * math.sin(tilt)),
    )  # fmt: skip
    drive = _drive(rng, kind, inertia + beam.hub)
    sensors = tuple(_placed(one, rng, beam, h) for one in mounted)
    return Rig(beam, drive, E, h, width, ρ, sensors, heads, sought, int(rng.choice((3, 5, 7, 9))))


def _sensors(rng: np.random.Generator, kind: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """One to three kinds of sensors, and their columns."""
    heads = {
        "tip": "tip y [m]", "encoder": "q boom [rad]", "gyroscope": "gyroscope [rad/s]",
        "accelerometer": "accelerometer [m/s²]", "strain": "strain [1]", "torque": "torque [N m]",
    }  # fmt: skip
    known = {"pd": "", "pulse": "torque", "motion": "encoder"}[kind]  # not a measurement
    names = [name for name in heads if name != known]
    chosen = [str(name) for name in rng.choice(names, rng.integers(1, 4), replace=False)]
    return tuple(name for name in chosen if name not in ("tip", "encoder")), tuple(heads[name] for name in chosen)


def _sought(rng: np.random.Generator, kind: str, heads: Sequence[str]) -> tuple[str, ...]:
    """Two to four numbers; those of the hub have an effect only if it is free, or its torque is measured."""
    paths = [path for path in SOUGHT if path not in OF_THE_HUB or kind != "motion" or "torque [N m]" in heads]
    return tuple(str(path) for path in rng.choice(paths, rng.integers(2, 5), replace=False))


def _drive(rng: np.random.Generator, kind: str, inertia: float) -> Drive:
    """A step of a PD controller's target, a torque forth and back, or a prescribed move; by 5 to 10°."""
    angle, ω = math.radians(rng.uniform(5, 10)), 2 * math.pi * rng.uniform(1, 4)
    if kind == "pd":
        return Drive(kp=inertia * ω**2, kd=2 * rng.uniform(0.4, 1.0) * inertia * ω, target=angle)
    T = 0.02 * round(rng.uniform(0.15, 0.4) / 0.02)
    if kind == "pulse":
        torque = inertia * angle / (T / 2) ** 2
        return Drive(jumps=(0.0, T / 2, T), torques=(torque, -torque, 0.0))
    ends = [[0.0, 0.0, 0.0], [angle, 0.0, 0.0], [angle, 0.0, 0.0]]
    return Drive(angle=PPoly.from_bernstein_basis(BPoly.from_derivatives([0.0, T, 2 * DURATION], ends)))


def _placed(kind: str, rng: np.random.Generator, beam: Beam, h: float) -> fl.Sensor:
    """A sensor at a random place: a gauge near the root, others on the outer half or at the end."""
    if kind == "torque":
        return fl.Sensor(name=kind, kind="torque", link="boom")
    if kind == "strain":
        at = round(rng.uniform(0.05, 0.25) * beam.length, 3)
        return fl.Sensor(name=kind, kind="strain", link="boom", x=at, fibre=(h / 2, 0.0))
    outer = round(rng.uniform(0.4, 1.0) * beam.length, 3)
    x, axis = (None, outer)[rng.integers(2)], {"gyroscope": (0.0, 0.0, 1.0), "accelerometer": (0.0, 1.0, 0.0)}[kind]
    return fl.Sensor(name=kind, kind=kind, link="boom", x=x, axis=axis)  # type: ignore[arg-type]


def _head(sensor: fl.Sensor) -> str:
    units = {"gyroscope": "rad/s", "accelerometer": "m/s²", "strain": "1", "torque": "N m"}
    return f"{sensor.name} [{units[sensor.kind]}]"


def _reading(sensor: fl.Sensor, moved: Motion) -> Array:
    x = moved.beam.length if sensor.x is None else sensor.x
    if sensor.kind == "torque":
        return moved.torque
    if sensor.kind == "strain":
        assert sensor.fibre is not None
        return moved.strain(x, sensor.fibre[0])
    return moved.gyroscope(x) if sensor.kind == "gyroscope" else moved.accelerometer(x)


def recorded(rng: np.random.Generator, rig: Rig) -> dict[str, Array]:
    """The record of a rig, with coloured noise of 0.5 to 3 % of each column's range."""
    t = np.linspace(0.0, DURATION, round(DURATION * RATE) + 1)
    found = {"t [s]": t}
    for head, y in rig.read(rig.motion(t)).items():
        found[head] = y + 10 ** rng.uniform(math.log10(0.005), math.log10(0.03)) * np.ptp(y) * noise(rng, len(t))
    return found


def posed(rng: np.random.Generator, rig: Rig, data: dict[str, Array], **run: Any) -> fl.fits.FitProblem:
    """The fit problem of a rig, with initial guesses up to 15 % off; `run` are further keys of its run."""
    start = {path: rig.values[path] * rng.uniform(0.85, 1.15) for path in rig.sought}
    columns = {head: tuple(column.tolist()) for head, column in data.items()}
    return fl.fits.FitProblem(
        scene=scene(rig).varied(start), parameter=tuple(fl.fits.FitParameter(path=path) for path in rig.sought),
        run=(fl.fits.FitRun(name="record", columns=columns, **run),),
    )  # fmt: skip


def scene(rig: Rig) -> fl.Scene:
    """A user's chain for a rig."""
    beam = rig.beam
    root = fl.details.RootStiffness(z=beam.root) if math.isfinite(beam.root) else None
    boom = fl.Link(
        name="boom", length=beam.length, flex="z", segments=rig.segments, material="strip", section="strip",
        joint=fl.Joint(armature=beam.hub, viscous=beam.viscous), root_stiffness=root,
    )  # fmt: skip
    moved = () if rig.drive.angle is None else (_prescribed(rig.drive.angle),)
    return fl.Scene(
        name="beam",
        gravity=(0.0, beam.gravity[1], -math.sqrt(GRAVITY**2 - beam.gravity[1] ** 2)),
        arm=fl.Arm(
            materials={"strip": fl.Material(young=rig.E, density=rig.ρ, loss_time=beam.loss_time)},
            sections={"strip": fl.Section(shape="rectangle", height=rig.h, width=rig.width)},
            links=(boom,), tip=fl.RigidBody(mass=beam.tip_mass),
        ),
        sensor=rig.sensors, drive=_of_scene(rig.drive), motion=moved,
        initial=fl.InitialState(joint_deg=(0.0,), passive="static"),
        run=fl.RunSettings(duration=DURATION, sample=1 / RATE),
    )  # fmt: skip


def _of_scene(drive: Drive) -> fl.Drive:
    if drive.kp:
        return fl.Drive(kind="pd", kp=(drive.kp,), kd=(drive.kd,), target_deg=(math.degrees(drive.target),))
    if drive.angle is not None:
        return fl.Drive()
    times, torques = (*drive.jumps, DURATION), (*drive.torques, drive.torques[-1])
    return fl.Drive(kind="table", times=times, torques=tuple((torque,) for torque in torques), hold=True)


def _prescribed(angle: PPoly) -> fl.PrescribedMotion:
    """The motion as a table whose interpolation of degree 5 is exact."""
    times = np.unique(np.append(np.linspace(0.0, DURATION, 21), angle.x[1:-1]))
    degrees = (np.degrees(angle.derivative(order)(times) if order else angle(times)).tolist() for order in range(3))
    θ, θd, θdd = map(tuple, degrees)
    return fl.PrescribedMotion(link="boom", times=tuple(times.tolist()), angle_deg=θ, rate_deg=θd, acceleration_deg=θdd)
