"""Simulated laboratories: the data of a fit problem, and of the experiments that `propose` names, from a true scene."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.fits import FitModes, FitParameter, FitProblem, FitRun, FitStatic

Laboratory = Callable[[fl.Scene, np.random.Generator], dict[str, Any]]
"""Function that measures an arm, its truth, and returns the parts of a problem."""


def spectrum(scene: fl.Scene, locked: Sequence[str] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and damping ratios of the elastic modes at rest, by default with locked joints."""
    chain = fl.lump(scene)
    every = chain.active.tolist()
    rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=every)
    found = fl.modes(chain, rest.q, locked=every if locked is None else list(locked))
    elastic = np.flatnonzero(np.array(found.kinds) == "elastic")
    return found.hertz[elastic], found.damping_ratios[elastic]


def tip(scene: fl.Scene) -> np.ndarray:
    """Position of the tip at rest under the scene's wrench, joints locked."""
    chain = fl.lump(scene)
    held = fl.solve_static(
        chain, fl.initial_state(scene, chain)[0], locked=chain.active.tolist(), tip_wrench=scene.tip_wrench
    )
    return np.asarray(fl.tip_position(chain, held.q))


def tapped(count: int, **changes: Any) -> Laboratory:
    """The first frequencies, ± 0.2 %."""

    def measure(truth: fl.Scene, rng: np.random.Generator) -> dict[str, Any]:
        f = spectrum(truth.varied(changes))[0][:count]
        hertz = np.sort(f * (1 + 2e-3 * rng.standard_normal(count)))
        return {"modes": (FitModes(hertz=tuple(hertz), deviation=tuple(2e-3 * f), set=changes),)}

    return measure


def sagged(newton: float) -> Laboratory:
    """Change of tip y under a force along y, ± 20 µm."""

    def measure(truth: fl.Scene, rng: np.random.Generator) -> dict[str, Any]:
        loaded, free = {"wrench.force": (0.0, newton, 0.0)}, {"wrench.force": (0.0, 0.0, 0.0)}
        change = tip(truth.varied(loaded))[1] - tip(truth.varied(free))[1]
        value = float(change + 2e-5 * rng.standard_normal())
        return {"static": (FitStatic(axis="y", value=value, deviation=2e-5, set=loaded, before=free),)}

    return measure


def recorded(noise: dict[str, float], name: str = "swing", **changes: Any) -> Laboratory:
    """Columns of the run with white noise."""

    def measure(truth: fl.Scene, rng: np.random.Generator) -> dict[str, Any]:
        run = fl.simulate(truth.varied(changes))
        columns = {head: run.columns[head] + σ * rng.standard_normal(len(run.t)) for head, σ in noise.items()}
        return {"run": (FitRun(name=name, columns={"t [s]": run.t} | columns, noise=noise, set=changes),)}

    return measure


def together(*several: Laboratory) -> Laboratory:
    """All measurements of several laboratories."""

    def measure(truth: fl.Scene, rng: np.random.Generator) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for one in several:
            for key, values in one(truth, rng).items():
                found[key] = (*found.get(key, ()), *values)
        return found

    return measure


def followed(problem: FitProblem, additions: Sequence[Any], truth: fl.Scene, rng: np.random.Generator) -> FitProblem:
    """The problem with the proposed experiments, measured on the truth with the noise that they state."""
    for one in additions:
        if isinstance(one, FitParameter):
            mean = truth.values_at(one.path)[0] + one.prior[1] * rng.standard_normal()
            new = [replace(p, prior=(mean, one.prior[1])) if p.path == one.path else p for p in problem.parameter]
            problem = replace(problem, parameter=tuple(new))
        elif isinstance(one, FitModes):
            hertz, ratios = (part[: len(one.hertz)] for part in spectrum(truth.varied(one.set), one.locked))
            noisy = np.sort(hertz + np.array(one.deviation) * rng.standard_normal(len(hertz)))
            measured = replace(one, hertz=tuple(noisy), ratios=tuple(ratios) if one.ratios else ())
            problem = replace(problem, modes=(*problem.modes, measured))
        elif isinstance(one, FitStatic):
            change = tip(truth.varied(one.set)) - tip(truth.varied({**one.set, **(one.before or {})}))
            value = float(change["xyz".index(one.axis)] + one.deviation * rng.standard_normal())
            problem = replace(problem, static=(*problem.static, replace(one, value=value)))
        else:
            problem = replace(problem, run=(*problem.run, _recorded(problem, one, truth, rng)))
    return problem


def _recorded(problem: FitProblem, run: FitRun, truth: fl.Scene, rng: np.random.Generator) -> FitRun:
    t = np.array(run.columns["t [s]"])
    true = {one.path: truth.values_at(one.path)[0] for one in problem.parameter}
    length = {"run.duration": float(f"{t[-1]:.9g}"), "run.sample": float(f"{t[1] - t[0]:.9g}")}
    seen = fl.simulate(problem.scene.varied({**run.set, **true, **length}))
    columns = {name: seen.columns[name] + σ * rng.standard_normal(len(seen.t)) for name, σ in run.noise.items()}
    return replace(run, columns={"t [s]": seen.t} | columns)
