"""Digests of every run, term, export and sweep row; a refactoring must not change any of them.

    python -m tests.support.baseline before.json            # write the digests
    python -m tests.support.baseline --against before.json  # list the differences; exit code 1 if any digest differs

Scenes are all of `models/`, one with each control law, and the arm with every feature. Digests cover runs with fixed,
implicit and adaptive steps (alone, side by side, by a Simulator, continued from a sample), the terms of the equation of
motion and their derivatives at random states, URDF, MJCF and SDF, and the rows of a sweep. Changes can be correct.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flexlink as fl
from tests.conftest import MODELS, ROOT, nasty_scene, random_state
from tests.motion.test_problem import DRIVES, MOTION, arm

SAMPLES, CONTINUED = 10, 3  # number of samples of a run; number of the sample from which the run is continued
WAYS: dict[str, dict[str, Any]] = {
    "RK4": {"method": "RK4"},
    "Gauss4": {"method": "Gauss4"},
    "auto 1e-4": {"method": "auto", "relative_tolerance": 1e-4},
    "Radau9 1e-6": {"method": "Radau9", "relative_tolerance": 1e-6},
    "DOP853 1e-4": {"method": "DOP853", "relative_tolerance": 1e-4},
}
STATES = 5


def digest(*values: Any) -> str:
    """Digest of all bits of arrays, or of texts."""
    sha = hashlib.sha256()
    for value in values:
        sha.update(value.encode() if isinstance(value, str) else np.ascontiguousarray(value, dtype=float).tobytes())
    return sha.hexdigest()[:16]


def of_parts(result: object) -> str:
    """Digest of all fields of a result."""
    return digest(*vars(result).values())


def of_run(run: fl.Trajectory) -> str:
    """Digest of the results of a run, including its number of evaluations."""
    return digest(run.t, run.q, run.qd, run.tau, run.tip, run.energy.parts, run.imbalance, repr(run.steps))


def scenes() -> Iterator[tuple[str, fl.Scene]]:
    """All scenes."""
    for path in MODELS:
        yield path.stem, fl.load_scene(path)
    for law in DRIVES:
        yield f"law {law}", arm(law)
    yield "motion", arm("linear").varied({"motion": (MOTION,)})
    yield "nasty", nasty_scene()


def runs(scene: fl.Scene) -> Iterator[tuple[str, str]]:
    """Digests of the runs of a scene, or of the error that it raises."""
    step = scene.run.fixed_step
    short = {"run.sample": 20 * step, "run.duration": 20 * SAMPLES * step, "run.unstable": "allow"}
    for way, changes in WAYS.items():
        fixed = {} if "relative_tolerance" in changes else {"run.step": step}
        settings = fixed | {f"run.{key}": value for key, value in changes.items()}
        given = scene.varied({**short, **settings})
        yield f"{way}, alone", attempt(lambda given=given: of_run(fl.simulate(given)))
        yield f"{way}, continued", attempt(lambda given=given: continued(given))
        yield f"{way}, Simulator", attempt(lambda given=given: stepped(given))
    by_step = {**short, "run.method": "RK4", "run.step": step}
    eight = [scene.varied({**by_step, "gravity": (0.0, 0.0, -g)}) for g in np.linspace(8.0, 10.0, 8)]
    yield "RK4, side by side", attempt(lambda: digest(*map(of_run, fl.simulate_many(eight))))


def attempt(what: Any) -> str:
    """Return the digest, or the text of the error."""
    try:
        return str(what())
    except fl.FlexlinkError as error:
        return f"{type(error).__name__}: {error}"


def continued(scene: fl.Scene) -> str:
    """Digest of a run that starts from a sample of another run."""
    run = fl.simulate(scene)
    t, q, qd = run.state(CONTINUED)
    left = scene.run.duration - CONTINUED * scene.run.spacing
    return of_run(fl.simulate(scene, q0=q, qd0=qd, t0=t, duration=left))


def stepped(scene: fl.Scene) -> str:
    """Digest of an arm stepped by a Simulator without torques."""
    simulator = fl.Simulator(scene)
    states = [simulator.step(duration=scene.run.spacing) for _ in range(SAMPLES)]
    return digest(*(np.concatenate([state.q, state.qd]) for state in states))


def terms(chain: fl.Chain) -> Iterator[tuple[str, str]]:
    """Digests of the terms of the equation of motion at random states."""
    rng = np.random.default_rng(20261121)
    for k in range(STATES):
        q, qd = random_state(chain, rng)
        tau, force = rng.normal(size=chain.n), rng.normal(size=6)
        qdd = fl.forward_dynamics(chain, q, qd, tau, tip_wrench=force)
        yield f"M {k}", digest(*(fl.mass_matrix(chain, q, algorithm=m) for m in ("composite", "upper")))
        yield (
            f"torques {k}",
            digest(fl.bias_torque(chain, q, qd), fl.elastic_torque(chain, q), fl.friction_torque(chain, qd)),
        )
        yield f"accelerations {k}", digest(qdd, fl.inverse_dynamics(chain, q, qd, qdd, tip_wrench=force))
        yield (f"slopes {k}", of_parts(fl.forward_dynamics_derivatives(chain, q, qd, tau, tip_wrench=force)))
        yield (f"inverse slopes {k}", of_parts(fl.inverse_dynamics_derivatives(chain, q, qd, qdd, tip_wrench=force)))
        yield f"energy {k}", of_parts(fl.energy(chain, q, qd))


def digests() -> dict[str, str]:
    """All digests by name."""
    found = {}
    for name, scene in scenes():
        print(name, file=sys.stderr, flush=True)
        chain = fl.lump(scene)
        initial = fl.initial_state(scene, chain)
        texts = fl.to_urdf(chain), fl.to_sdf(chain), fl.to_mjcf(chain, initial=initial)
        for part in (runs(scene), terms(chain), [("files", digest(*texts))]):
            found |= {f"{name}: {key}": value for key, value in part}
    for path in sorted((ROOT / "validation" / "sweeps").glob("*.toml")):
        rows = fl.sweep(path)
        found[f"sweep {path.stem}"] = digest(json.dumps([list(map(repr, part)) for part in (rows.columns, rows.rows)]))
    return found


def main() -> int:
    """Run the command and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.baseline", description=__doc__)
    parser.add_argument("file", type=Path, help="JSON file of digests")
    parser.add_argument("--against", action="store_true", help="compare with the file instead of writing it")
    choice = parser.parse_args()
    now = digests()
    if not choice.against:
        choice.file.write_text(json.dumps(now, indent=1), encoding="utf-8")
        return 0
    before = json.loads(choice.file.read_text(encoding="utf-8"))
    changed = [key for key in before.keys() | now.keys() if before.get(key) != now.get(key)]
    print(*(f"{key}: {before.get(key)} → {now.get(key)}" for key in sorted(changed)), sep="\n")
    print(f"{len(now) - len(changed)} of {len(now)} are the same")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
