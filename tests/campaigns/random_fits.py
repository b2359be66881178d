"""Fits to records of a continuous beam of another make, half of them with a scene that lacks or misstates something.

    python -m tests.campaigns.random_fits 40

The beam rotates about its root and does not stretch: a point at s is at (s + u, w) in axes that turn by θ,

    w = φᵀ q,   u = −½ qᵀ N q,   N(s) = ∫₀ˢ φ' φ'ᵀ,   κ = w'' / √(1 − w'²)        Σ m Jᵀ (J ẍ + a₀) = Q(κ + T κ̇, τ)

φ are the modes of cubic finite elements, J the rates of the positions per rate of x = (θ, q), a₀ the accelerations
without ẍ. Large bending matters: without u and κ, records differ from those of a chain by half the noise.
A record of a right model should pass; one of a wrong model
should cause a warning, or its estimates be within five standard deviations of the true values.
"""

import sys
import time
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
import scipy

import flexlink as fl

N, MODES, SAMPLE, LENGTH = 12, 4, 0.005, 1.5
Values = dict[str, float]


class Beam(NamedTuple):
    """Matrices of a beam clamped to a turning root, or held by a spring there, in its first modes."""

    K: np.ndarray
    M: np.ndarray  # of the angle and the modes, without bending
    gauge: np.ndarray  # curvature at the gauge, of each mode
    # at points along the beam, the last at the tip: position, length, mass, rigidity times length; modes with slopes,
    # curvatures and their N
    s: np.ndarray
    ds: np.ndarray
    m: np.ndarray
    EI: np.ndarray
    φ: np.ndarray
    slope: np.ndarray
    bend: np.ndarray
    N: np.ndarray


def shape(ξ: float, le: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cubic shape functions of an element of length le at ξ, with their slopes and curvatures."""
    φ = np.array([1 - 3 * ξ**2 + 2 * ξ**3, le * (ξ - 2 * ξ**2 + ξ**3), 3 * ξ**2 - 2 * ξ**3, le * (ξ**3 - ξ**2)])
    slope = [6 * ξ**2 - 6 * ξ, le * (1 - 4 * ξ + 3 * ξ**2), 6 * ξ - 6 * ξ**2, le * (3 * ξ**2 - 2 * ξ)]
    bend = [12 * ξ - 6, le * (6 * ξ - 4), 6 - 12 * ξ, le * (6 * ξ - 2)]
    return φ, np.array(slope) / le, np.array(bend) / le**2


def beam(p: Values) -> Beam:
    """Finite elements of a beam with a linear taper and a payload with rotary inertia."""
    n, le, parts = 2 * (N + 1), p["length"] / N, 5
    M, K, rows = np.zeros((n, n)), np.zeros((n, n)), list[tuple[float, float, np.ndarray]]()
    points, weights = np.polynomial.legendre.leggauss(4)

    def height(x: float) -> float:
        return float(p["height"] * (1 - p["taper"] * x / p["length"]))

    for e in range(N):
        at = slice(2 * e, 2 * e + 4)
        for ξ, weight in zip((points + 1) / 2, weights / 2 * le, strict=True):
            (φ, _, b), h = shape(ξ, le), height((e + ξ) * le)
            M[at, at] += weight * p["density"] * p["width"] * h * np.outer(φ, φ)
            K[at, at] += weight * p["young"] * p["width"] * h**3 / 12 * np.outer(b, b)
        for ξ in [*((np.arange(parts) + 0.5) / parts), *([1.0] if e == N - 1 else [])]:
            row = np.zeros((3, n))
            row[:, at] = shape(ξ, le)
            rows.append(((e + ξ) * le, height((e + ξ) * le), row))
    M[-2, -2] += p["mass"]
    M[-1, -1] += p["inertia"]
    K[1, 1] += p["root"]
    rigid = np.ravel([(k * le, 1.0) for k in range(N + 1)])
    free = [*range(2, n)] if p["root"] == 0 else [*range(1, n)]
    V = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], subset_by_index=(0, MODES - 1))[1]
    full = np.zeros((n, MODES))
    full[free] = V
    s, h, ds = np.array([x for x, _, _ in rows]), np.array([h for _, h, _ in rows]), np.full(len(rows), le / parts)
    ds[-1] = 0.0
    φ, slope, bend = np.array([row @ full for _, _, row in rows]).transpose(1, 0, 2)
    each = ds[:, None, None] * slope[:, :, None] * slope[:, None, :]
    mass, rigidity = p["density"] * p["width"] * h * ds, p["young"] * p["width"] * h**3 / 12 * ds
    mass[-1] = p["mass"]
    whole = np.column_stack([rigid, full])
    gauge = shape(0.03 / le, le)[2] @ full[:4]
    N_at = np.cumsum(each, axis=0) - each / 2
    return Beam(full.T @ K @ full, whole.T @ M @ whole, gauge, s, ds, mass, rigidity, φ, slope, bend, N_at)


def record(p: Values, target: float) -> dict[str, np.ndarray]:
    """Columns of a step of the PD drive to a target [rad], without noise."""
    one, m = beam(p), MODES
    straight = np.column_stack([one.s, one.φ])
    M = one.M - straight.T @ (one.m[:, None] * straight)  # what sums over the points lack
    moving = one.M[1:, 1:] - np.outer(one.M[0, 1:], one.M[0, 1:]) / (one.M[0, 0] + p["armature"])
    ω2 = float(scipy.linalg.eigvalsh(one.K, moving)[-1])
    steps = max(5, int(np.ceil(SAMPLE * max(np.sqrt(ω2), p["loss"] * ω2) / 2)))  # in a sample; RK4 is stable to 2.78
    step = SAMPLE / steps

    def torque(y: np.ndarray) -> float:
        return float(p["kp"] * (target - y[0]) - p["kd"] * y[1])

    def bent(y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Rates of the points along and across the beam per rate of (θ, q), and their accelerations without these."""
        θ1, q, q1 = y[1], y[2 : 2 + m], y[2 + m :]
        Nq, w, w1 = one.N @ q, one.φ @ q, one.φ @ q1
        x, u1 = one.s - Nq @ q / 2, -Nq @ q1
        along, across = np.column_stack([-w, -Nq]), np.column_stack([x, one.φ])
        return along, across, -((one.N @ q1) @ q1) - 2 * θ1 * w1 - θ1**2 * x, 2 * θ1 * u1 - θ1**2 * w

    def accelerations(y: np.ndarray) -> np.ndarray:
        θ1, q, q1 = y[1], y[2 : 2 + m], y[2 + m :]
        along, across, a, b = bent(y)
        d, c, c1 = one.slope @ q, one.bend @ q, one.bend @ q1
        root = 1 / np.sqrt(1 - d**2)
        dκ = one.bend * root[:, None] + one.slope * (c * d * root**3)[:, None]
        moment, straight = one.EI * (c * root + p["loss"] * dκ @ q1), one.EI * (c + p["loss"] * c1)
        f = -one.K @ (q + p["loss"] * q1) - moment @ dκ + straight @ one.bend
        friction = p["viscous"] * θ1 + p["coulomb"] * np.tanh(θ1 / 0.01) + p["quadratic"] * abs(θ1) * θ1
        Q = np.append(torque(y) - friction, f) - (one.m * a) @ along - (one.m * b) @ across
        if p["drag"]:
            v = one.s * θ1 + one.φ @ q1
            Q -= (0.5 * 1.2 * p["drag"] * p["width"] * np.abs(v) * v * one.ds) @ across
        whole = M + along.T @ (one.m[:, None] * along) + across.T @ (one.m[:, None] * across)
        whole[0, 0] += p["armature"]
        return np.asarray(np.linalg.solve(whole, Q))

    def rate(y: np.ndarray) -> np.ndarray:
        a = accelerations(y)
        return np.concatenate([[y[1], a[0]], y[2 + m :], a[1:]])

    y, found = np.zeros(2 + 2 * m), []
    for k in range(round(LENGTH / SAMPLE) + 1):
        q, q1, a = y[2 : 2 + m], y[2 + m :], accelerations(y)
        along, across, ax, ay = bent(y)
        sine = one.slope[-1] @ q
        cosine = np.sqrt(1 - sine**2)
        found.append((
            k * SAMPLE, torque(y), -1e6 * p["height"] / 2 * one.gauge @ q,
            across[-1, 0] * np.sin(y[0]) + one.φ[-1] @ q * np.cos(y[0]),
            cosine * (across[-1] @ a + ay[-1]) - sine * (along[-1] @ a + ax[-1]),
            y[1] + one.slope[-1] @ q1 / cosine,
        ))  # fmt: skip
        for _ in range(steps):
            k1 = rate(y)
            k2 = rate(y + step / 2 * k1)
            k3 = rate(y + step / 2 * k2)
            y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(y + step * k3))
    heads = "t [s]", "motor [N m]", "gauge [µm/m]", "tip y [m]", "acc [m/s²]", "gyro [rad/s]"
    return dict(zip(heads, np.array(found).T, strict=True))


def scene_of(p: Values, target: float) -> fl.Scene:
    """The scene that a user writes for these values; it has no root spring, taper, dry friction or air."""
    on = {"link": "l0", "x": p["length"]}
    sensors = (
        fl.Sensor(name="gauge", kind="strain", link="l0", x=0.03, fibre=(p["height"] / 2, 0.0), gain=1e6, unit="µm/m"),
        fl.Sensor(name="acc", kind="accelerometer", axis=(0, 1, 0), **on),
        fl.Sensor(name="gyro", kind="gyroscope", axis=(0, 0, 1), **on),
        fl.Sensor(name="motor", kind="torque", link="l0"),
    )  # fmt: skip
    link = fl.Link(
        name="l0", length=p["length"], flex="z", segments=5, material="steel", section="s0",
        joint=fl.Joint(armature=p["armature"], viscous=p["viscous"]),
    )  # fmt: skip
    arm = fl.Arm(
        links=(link,), tip=fl.RigidBody(mass=p["mass"]),
        materials={"steel": fl.Material(young=p["young"], density=p["density"], loss_time=p["loss"])},
        sections={"s0": fl.Section(shape="rectangle", height=p["height"], width=p["width"])},
    )  # fmt: skip
    drive = fl.Drive(kind="pd", kp=(p["kp"],), kd=(p["kd"],), target_deg=(float(np.degrees(target)),))
    run = fl.RunSettings(tolerance=1e-6, duration=LENGTH, sample=SAMPLE)
    return fl.Scene(name="bench", arm=arm, gravity=(0, 0, 0), drive=drive, run=run, sensor=sensors,
                    initial=fl.InitialState(joint_deg=(0.0,)))  # fmt: skip


WRONG: dict[str, tuple[str, str]] = {  # the value that the scene misstates, and the path that should be named
    "dry friction": ("coulomb", "joint.coulomb"), "soft root": ("root", "root_stiffness"),
    "half payload": ("mass", "tip.mass"), "length": ("length", "length"), "taper": ("taper", "section.s0_tip"),
    "armature": ("armature", "joint.armature"), "air": ("drag", "drag.coefficient"),
    "viscous": ("viscous", "joint.viscous"), "density": ("density", "density"), "young": ("young", "young"),
    "payload inertia": ("inertia", "no row"), "quadratic friction": ("quadratic", "joint.quadratic"),
}  # fmt: skip
SOUGHT = {"young": "material.steel.young", "viscous": "link.l0.joint.viscous", "armature": "link.l0.joint.armature",
          "mass": "tip.mass"}  # fmt: skip


def drawn(rng: np.random.Generator) -> Values:
    """Values of a bench."""
    ranges = {
        "length": (0.4, 0.8), "height": (2.2e-3, 2.8e-3), "young": (1.85e11, 2.2e11), "loss": (2e-4, 1e-3),
        "mass": (0.1, 0.25), "armature": (0.08, 0.12), "viscous": (0.15, 0.3), "kp": (35, 70), "kd": (2, 3.5),
    }  # fmt: skip
    p = {"width": 0.03, "density": 7850.0} | {name: rng.uniform(*ends) for name, ends in ranges.items()}
    return p | dict.fromkeys(("taper", "root", "inertia", "coulomb", "quadratic", "drag"), 0.0)


def truth_of(kind: str, p: Values, rng: np.random.Generator) -> Values:
    """Values of the arm that was recorded, of which the scene states `p`."""
    stiffness = p["young"] * p["width"] * p["height"] ** 3 / 12 / p["length"]
    lacks = {
        "coulomb": rng.uniform(0.1, 0.4), "root": stiffness * rng.uniform(5, 15), "mass": 2 * p["mass"],
        "length": p["length"] * rng.choice([0.94, 1.06]), "taper": rng.uniform(0.15, 0.3),
        "armature": 1.4 * p["armature"], "drag": rng.uniform(5, 15), "viscous": 3 * p["viscous"],
        "density": 1.15 * p["density"], "young": 0.85 * p["young"],
        "inertia": 0.05 * p["mass"] * p["length"] ** 2, "quadratic": rng.uniform(0.1, 0.3),
    }  # fmt: skip
    return p | ({WRONG[kind][0]: lacks[WRONG[kind][0]]} if kind else {})


def problem_of(seed: int, kind: str) -> tuple[fl.fits.FitProblem, Values]:
    """A problem with two sought parameters, and their true values; half of the records have autocorrelated noise."""
    rng = np.random.default_rng(seed)
    p = drawn(rng)
    sought = [
        str(one) for one in rng.choice([one for one in SOUGHT if not kind or one != WRONG[kind][0]], 2, replace=False)
    ]
    true = truth_of(kind, p | {one: p[one] * rng.uniform(0.85, 1.15) for one in sought}, rng)
    heads = rng.choice(
        ["motor [N m]", "gauge [µm/m]", "tip y [m]", "acc [m/s²]", "gyro [rad/s]"], rng.integers(2, 4), replace=False
    )
    runs, coloured = [], rng.random(len(heads)) < 0.5
    for name, target in (("a", 0.2), ("b", -0.15)):
        exact = record(true, target)
        columns = {"t [s]": exact["t [s]"]}
        for head, filtered in zip(map(str, heads), coloured, strict=True):
            e = rng.standard_normal(len(exact[head]) + 100)
            e = scipy.signal.lfilter(*scipy.signal.butter(2, 0.25), e) if filtered else e
            columns[head] = exact[head] + 0.01 * float(np.ptp(exact[head])) * e[100:] / e.std()
        extra: dict[str, Any] = (
            {} if name == "a" else {"use": "check", "set": {"drive.target_deg": [float(np.degrees(target))]}}
        )
        runs.append(
            fl.fits.FitRun(name=name, columns={head: tuple(y.tolist()) for head, y in columns.items()}, **extra)
        )
    parameters = tuple(fl.fits.FitParameter(path=SOUGHT[one]) for one in sought)
    return fl.fits.FitProblem(scene=scene_of(p, 0.2), parameter=parameters, run=tuple(runs)), {
        SOUGHT[one]: true[one] for one in sought
    }


def main(count: int, first: int = 0) -> None:
    """Fit the records; print a line for each, then the shares."""
    kinds, shares = list(WRONG), Counter[str]()
    for seed in range(first, first + count):
        kind = kinds[seed // 2 % len(kinds)] if seed % 2 else ""
        problem, true = problem_of(seed, kind)
        begun = time.process_time()
        found = fl.fit(problem)
        far = max(abs(found[path].value - value) / found[path].deviation for path, value in true.items())
        named = [str(one) for one in found.warnings if one.id.startswith("likely-")]
        doubts = [one.doubt.id for one in found.numbers if one.doubt is not None]
        warned = not found.explained or any(one != "grid-error" for one in doubts)  # which is not about the model
        shares[f"{'wrong' if kind else 'right'}"] += 1
        shares["right, explained"] += not kind and found.explained
        shares["right, passed"] += not kind and found.passed
        shares["wrong, warned or within 5"] += bool(kind) and (warned or far < 5)
        shares["wrong, silent beyond 5"] += bool(kind) and not warned and far >= 5
        row = bool(kind) and WRONG[kind][1] != "no row"
        shares["warned, with a row"] += row and not found.explained
        shares["cause first"] += row and bool(named) and WRONG[kind][1] in named[0]
        floors = [f"{one.floor_from or 'unknown'} {one.within}" for one in found.columns if one.use == "fit"]
        print(f"{seed:4} {kind or 'right':18} {'explained' if found.explained else 'warned':9} off {far:5.1f} "
              f"{time.process_time() - begun:5.1f} s  {floors} {named}", flush=True)  # fmt: skip
    print(dict(shares))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
