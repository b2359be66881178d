"""Random arms of every kind as compiled C and as CasADi, against equations that share no code with the kernels.

    python -m tests.campaigns.random_code 200       # of every kind, then a table; exit code 1 if one is wrong
    python -m tests.campaigns.random_code 20 drag "free base"

The residual of the equations of motion is computed to 50 digits by virtual power, from the bodies of the chain. MuJoCo
and Pinocchio give accelerations where they can load the arm. All errors are in units of the rounding bound.
"""

from __future__ import annotations

import collections
import ctypes
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mpmath import mp, mpf
from numpy.typing import NDArray

import flexlink as fl
from flexlink.dynamics import rounding
from flexlink.dynamics.free_motion import all_motions
from flexlink.engines import load
from flexlink.errors import ArgumentError
from flexlink.formats.code.model import name_of
from flexlink.kernels.layout import SPRINGS
from tests.campaigns.random_motors import random_motor
from validation.oracles.planar_chain import DIGITS
from validation.oracles.spatial_chain import STEP, SpatialChain, exactly
from validation.random_arms import Dice, random_arm, random_tree

Array = NDArray[np.float64]
Code = Callable[[Array, Array], Array]  # x, u → ẋ and the tip


def arm(seed: int, **keys: Any) -> fl.Scene:
    """A random arm or tree with these keys: `joint__…` for free joints, `drag` for beams, else for links that bend."""
    scene = random_arm(seed) if seed % 2 else random_tree(seed)
    links = {
        "joint": [link.name for link in scene.arm.links if not link.joint.locked],
        "drag": [link.name for link in scene.arm.links if link.beam.length],
        "bends": [link.name for link in scene.arm.links if link.flex != "rigid"],
    }
    changes = {
        f"link.{name}.{key.replace('__', '.')}": value
        for key, value in keys.items() for name in links.get(key.partition("__")[0], links["bends"])
    }  # fmt: skip
    density = {"air_density": 40.0} if "drag" in keys and changes else {}
    return scene.varied({"initial.q": None, "initial.qd": None, **changes, **density})


TURNING, SLIDING = ("angle_deg", "rate_deg", "acceleration_deg"), ("position_m", "rate_m", "acceleration_m")


def moved(seed: int) -> fl.Scene:
    """An arm, in one of three cases with strain modes, in which every second free joint has a prescribed motion."""
    scene = arm(seed) if seed % 3 else arm(seed, modes=1, segments=5)
    motion = [
        {"link": link.name, "times": (0.0, 1.0)} | dict.fromkeys(SLIDING if link.joint.slides else TURNING, (0.0, 0.0))
        for link in [link for link in scene.arm.links if not link.joint.locked][::2]
    ]
    return scene.varied({"initial": fl.InitialState(), "motion": motion})


KINDS: dict[str, tuple[Callable[[int], fl.Scene], Callable[[fl.Chain], Any]]] = {
    "in a plane": (lambda seed: random_motor(Dice(seed)), lambda chain: chain.is_planar),
    "in space": (random_arm, lambda chain: not chain.is_planar),
    "branches": (random_tree, lambda chain: not chain.is_serial),
    "slides": (random_tree, lambda chain: chain.slides[6 * chain.has_free_base :].any()),
    "free base": (random_tree, lambda chain: chain.has_free_base),
    "couplings": (lambda seed: arm(seed, lumping=("lobatto2", "lobatto4")[seed // 2 % 2], segments=5),
                  lambda chain: len(chain.couplings)),
    "rotation springs": (lambda seed: arm(seed, lumping=("gauss_rotation", "lobatto2_rotation")[seed // 2 % 2],
                                          flex="xyz", segments=5, rigidity=None, material="stuff", section="bar",
                                          section_tip=None),
                         lambda chain: chain.has_rotation_springs),
    "strain modes": (lambda seed: arm(seed, modes=1 + seed // 2 % 3, segments=5), lambda chain: chain.shapes),
    "drag": (lambda seed: arm(seed, drag=fl.Drag(coefficient=1.5, breadth=(0.2, 0.1))), lambda chain: len(chain.drag)),
    "dampers": (lambda seed: arm(seed, joint__quadratic=0.7), lambda chain: "dampers" in chain.forces),
    "lags": (lambda seed: arm(seed, joint__viscous=0.4, joint__viscous_lag=0.05), lambda chain: len(chain.internal)),
    "motion": (moved, lambda chain: chain.hinges["prescribed"].any()),
}  # fmt: skip
"""Scenes of every kind by seed, and whether a chain is of this kind."""


def arms(kind: str) -> Iterator[tuple[int, fl.Chain]]:
    """Seeds and chains of a kind."""
    scene, fits = KINDS[kind]
    for seed in itertools.count():
        chain = fl.lump(scene(seed))
        if fits(chain):
            yield seed, chain


def compiled(chain: fl.Chain, folder: Path) -> Code:
    """The functions of `to_c`."""
    (folder / "arm.c").write_text(fl.to_c(chain), encoding="utf-8")
    build = ["cc", "-std=c99", "-O0", "-Wall", "-Werror", "-shared", "-fPIC", "arm.c", "-o", "arm.so", "-lm"]
    subprocess.run(build, cwd=folder, check=True)
    library, pointer = ctypes.CDLL(str(folder / "arm.so")), np.ctypeslib.ndpointer(np.float64)
    rate, tip = library[f"{name_of(chain)}_rate"], library[f"{name_of(chain)}_tip"]
    rate.argtypes, tip.argtypes = [pointer] * 3, [pointer] * 2

    def code(x: Array, u: Array) -> Array:
        dx, p = np.zeros(len(x)), np.zeros(3)
        rate(x, u, dx)
        tip(x, p)
        return np.append(dx, p)

    return code


def in_casadi(chain: fl.Chain) -> Code:
    """The functions of `to_casadi`."""
    names: dict[str, Any] = {"__name__": "arm"}
    exec(fl.to_casadi(chain), names)
    f, tip = names["functions"]()
    return lambda x, u: np.append(f(x, u).full(), tip(x).full())


def state(chain: fl.Chain, seed: int) -> tuple[Array, Array]:
    """A random x and u; some hinges turn so far that rotation vectors are beyond their series."""
    rng, Φ = np.random.default_rng(seed), all_motions(chain)
    z = (0.2, 1.0)[seed % 2] * rng.normal(size=chain.freedoms) / np.maximum(1.0, np.abs(Φ).sum(axis=0))
    return np.append(z, rng.normal(size=chain.freedoms)), rng.normal(size=len(chain.active))


def rotation_vector(θ: list[mp.mpf], axes: list[int]) -> mp.matrix:
    """φ of a product of rotations about axes, by their quaternions."""
    w, v = mp.mpf(1), [mp.mpf(0)] * 3
    for angle, axis in zip(θ, axes, strict=True):
        c, s, j, k = mp.cos(angle / 2), mp.sin(angle / 2), (axis + 1) % 3, (axis + 2) % 3
        new = [mp.mpf(0)] * 3
        new[axis], new[j], new[k] = v[axis] * c + w * s, v[j] * c + v[k] * s, v[k] * c - v[j] * s
        w, v = w * c - v[axis] * s, new
    sine = mp.sqrt(sum(x * x for x in v))
    return [x * (2 * mp.atan2(sine, w) / sine if sine else 2) for x in v]


def potential(chain: fl.Chain, θ: list[mp.mpf]) -> mp.mpf:
    """Elastic energy V of all triples of a chain at angles from rest; cells integrate κ² at two Gauss points."""
    vectors, K, bodies = [], chain.matrix("stiffness"), chain.bodies[chain.bodies["springs"] != SPRINGS.angles]
    axes = [chain.hinges["axis"][b.first : b.stop].tolist() for b in bodies]
    places = [[int(b.first) + along.index(a) for a in range(3)] for b, along in zip(bodies, axes, strict=True)]
    for b, along in zip(bodies, axes, strict=True):
        vectors.append(rotation_vector(θ[b.first : b.stop], along))
    V = mp.mpf(0)
    if bodies["springs"][0] != SPRINGS.cell:
        φ = {k: vectors[t][a] for t, own in enumerate(places) for a, k in enumerate(own)}
        return sum(mp.mpf(K[i, j]) * φ[i] * φ[j] for i, j in np.argwhere(K).tolist() if i in φ and j in φ) / 2
    slope = 2 / mp.sqrt(3)
    for t in range(0, len(places), 2):
        φ1, φ2 = vectors[t], vectors[t + 1]
        w = [-(φ1[(a + 1) % 3] * φ2[(a + 2) % 3] - φ1[(a + 2) % 3] * φ2[(a + 1) % 3]) / 6 for a in range(3)]
        for a in range(3):
            i, j = places[t][a], places[t + 1][a]
            # K = Cᵀ diag(r) C with r = w_q EI / h at the Gauss points, C = (1 ± 2/√3, 1 ∓ 2/√3).
            both, apart = -3 * mp.mpf(K[i, j]), (mp.mpf(K[i, i]) - mp.mpf(K[j, j])) / (4 * slope)
            for sign in (1, -1):
                κ = (1 + sign * slope) * φ1[a] + (1 - sign * slope) * φ2[a] + w[a]
                V += (both + sign * apart) / 2 * κ * κ / 2
    return V


def required(chain: fl.Chain, q: Array, qd: Array, qdd: Array) -> Array:
    """The drive torques of a motion to 50 digits, rounded once."""
    θ, rate, between = exactly(q), exactly(qd), np.zeros((2, chain.n, chain.n))
    for field, matrix in zip(("stiffness", "damping"), between, strict=True):
        matrix[:] = chain.matrix(field) - np.diag(chain.hinges[field])
    found = SpatialChain(chain).torque(θ, rate, exactly(qdd), [mpf(0)] * 6)
    bent = [x - mpf(float(rest)) for x, rest in zip(θ, chain.rest, strict=True)]
    for k in range(chain.n):
        found[k] += mp.fdot(exactly(between[0, k]), bent) + mp.fdot(exactly(between[1, k]), rate)
    for each in chain.force("dampers"):
        found[each["hinge"]] += mpf(float(each["quadratic"])) * abs(rate[each["hinge"]]) * rate[each["hinge"]]
    for each in chain.force("gyrators"):
        i, j, g = each["inner"], each["outer"], mpf(float(each["gyration"]))
        found[i], found[j] = found[i] + g * rate[j], found[j] - g * rate[i]
    for b in chain.bodies[chain.bodies["springs"] != SPRINGS.angles]:
        for k in range(b["first"], b["stop"]):
            ends = [potential(chain, [*bent[:k], bent[k] + h, *bent[k + 1 :]]) for h in (STEP, -STEP)]
            linear = mp.fdot(exactly(chain.matrix("stiffness")[k]), bent)
            found[k] += (ends[0] - ends[1]) / (2 * STEP) - linear
    return np.array(found, dtype=float)


def errors(chain: fl.Chain, code: Code, seed: int) -> dict[str, float]:
    """Errors of the code at a random state, by their reference."""
    (x, u), Φ, m = state(chain, seed), all_motions(chain), chain.freedoms
    dx, given = code(x, u), chain.hinges["prescribed"] != 0
    rest = 0.0 if chain.shapes is None else chain.rest
    q, qd, qdd, tau = rest + Φ @ x[:m], Φ @ x[m:], Φ @ dx[m : 2 * m], np.zeros(chain.n)
    tau[chain.active] = u
    with mp.workdps(DIGITS):
        left = required(chain, q, qd, qdd) - np.where(given, 0.0, tau)
    free = ~(Φ[given] != 0).any(axis=0)
    bound = np.abs(Φ).sum(axis=0) * rounding.of_residual(chain, q, qd, qdd, np.where(given, 0.0, tau))
    found = {"50 digits": float((np.abs(Φ.T @ left) / bound)[free].max(initial=0.0))}
    found["inputs"] = float(np.abs(qdd - tau)[given].max(initial=0.0) + np.abs(dx[:m] - x[m:]).max())
    found["tip"] = float(np.abs(dx[2 * m :] - fl.tip_position(chain, q)).max() / (1e-13 * chain.size))
    others = chain.shapes is None and not chain.forces and not given.any()
    for engine in ("mujoco", "pinocchio") if others else ():
        try:
            other = load(engine, chain).forward_dynamics(q, qd, tau)
        except ArgumentError:
            continue
        found[engine] = float(rounding.acceleration_error(chain, q, qd, tau, solutions=(qdd, other)).max())
    return found


def judged(chain: fl.Chain, seed: int, *, casadi: bool) -> dict[str, float]:
    """Errors of the C code and, on request, of the CasADi code."""
    with tempfile.TemporaryDirectory() as folder:
        found = errors(chain, compiled(chain, Path(folder)), seed)
    if casadi:
        found |= {f"casadi {name}": error for name, error in errors(chain, in_casadi(chain), seed).items()}
    return found


def main(arguments: list[str]) -> int:
    """Print the number of arms and the largest errors of every kind."""
    wrong = 0
    for kind in arguments[1:] or KINDS:
        worst, counts = collections.Counter[str](), collections.Counter[str]()
        for seed, chain in itertools.islice(arms(kind), int(arguments[0])):
            found = judged(chain, seed, casadi=seed % 5 == 0)
            counts.update(found.keys())
            worst |= collections.Counter(found)
            if not max(found.values()) <= 1.0:
                wrong += 1
                print(f"{kind} {seed}: {found}")
        listed = (f"{name}: {count} arms, worst {worst[name]:.2g}" for name, count in counts.items())
        print(kind, *listed, sep="\n    ", flush=True)
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
