"""Random arms with planted numbers and coloured noise: does the stated interval hold the true value?

python tests/random_fits.py 200
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.signal import butter, lfilter

import flexlink as fl

SOUGHT = (
    "material.steel.young", "material.steel.density", "material.steel.loss_time", "tip.mass",
    "link.1.joint.armature", "link.1.joint.viscous", "initial.joint_deg.1",
)  # fmt: skip
LONG = 400  # samples before the record, after which filters have forgotten their start


def arm(rng: np.random.Generator) -> fl.Scene:
    """One to three flexible links of a strip, hanging off to one side, falling or held by weak springs."""
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


def noise(rng: np.random.Generator, n: int) -> np.ndarray:
    """Noise of size 1 from one of four filters: first order, a resonance, a low-pass with a floor, or white."""
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


def planted(seed: int) -> tuple[fl.FitProblem, dict[str, float]]:
    """A problem that starts off, and the numbers that are true."""
    rng = np.random.default_rng(seed)
    true = arm(rng)
    run = fl.simulate(true.varied({"run.relative_tolerance": 1e-9}))
    size = 10 ** rng.uniform(-3.3, -2.3)
    names = ["tip x [m]", "tip y [m]", "q l0 [rad]"][: rng.integers(1, 4)]
    data = {"t [s]": run.t} | {name: run.columns[name] + size * noise(rng, len(run.t)) for name in names}
    paths = list(rng.choice(SOUGHT, rng.integers(1, 5), replace=False))
    values = {path: float(true.values_at(path)[0]) for path in paths}
    start = {
        path: v + rng.uniform(-3, 3) if "deg" in path else v * rng.uniform(0.85, 1.15) for path, v in values.items()
    }
    problem = fl.FitProblem(
        scene=true.varied(start), parameter=tuple(fl.FitParameter(path=path) for path in paths),
        run=(fl.FitRun(name="planted", columns=data),),
    )  # fmt: skip
    return problem, values


def held(first: int, count: int) -> tuple[int, int, list[float]]:
    """Of `count` arms whose data can tell: how many true values lie inside, how many there are, and where they lie."""
    inside, z, seed, done = 0, [], first, 0
    while done < count:
        problem, true = planted(seed)
        seed += 1
        try:
            found = fl.fit(problem)
        except fl.errors.IdentifiabilityError:
            continue
        if not found.identifiable:
            continue
        done += 1
        for path, value in true.items():
            one = found[path]
            inside += one.low <= value <= one.high
            z.append((one.value - value) / one.half)
    return inside, len(z), z


if __name__ == "__main__":
    inside, count, z = held(1000, int(sys.argv[1]) if len(sys.argv) > 1 else 20)
    print(f"{inside} of {count} inside: {100 * inside / count:.1f} %; largest |z| {np.abs(z).max():.2f}")
