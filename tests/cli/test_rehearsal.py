"""`flexlink compile` meets every algorithm that kernels select by the type of a workspace."""

import importlib
import pkgutil
from collections.abc import Iterator
from typing import Any

import numpy as np

import flexlink as fl
import flexlink.kernels
from flexlink.cli.rehearsal import BY_MODES, KINDS, scene_of
from flexlink.dynamics.accelerations import SOLVERS, solver_for
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.run_gradient import workspace_for
from flexlink.motion.single_run import SingleRun


def test_every_workspace_that_selects_an_algorithm_is_made_by_a_scene_of_the_rehearsal() -> None:
    assert {kind.__name__ for kind in selecting() - {kind for scene in scenes() for kind in met(scene)}} == set()


def selecting() -> set[type]:
    """Types by which kernels select an algorithm."""
    modules = pkgutil.walk_packages(flexlink.kernels.__path__, "flexlink.kernels.")
    functions = [each for module in modules for each in vars(importlib.import_module(module.name)).values()]
    return {kind for each in functions for kind in getattr(each, "algorithms", {})}


def scenes() -> Iterator[fl.Scene]:
    for name in KINDS:
        yield scene_of(name)
    for name in BY_MODES:
        yield scene_of(name).varied({"link.*.modes": 1})


def met(scene: fl.Scene) -> Iterator[type]:
    """Types of all workspaces, and of their parts, of the functions that the rehearsal calls for a scene."""
    chain = fl.lump(scene)
    for solver in SOLVERS:
        yield from types_in(solver_for(chain, solver).workspace(chain.arrays))
    fl.forward_dynamics_derivatives(chain, *np.full((3, chain.n), 0.1))
    fl.inverse_dynamics_derivatives(chain, *np.full((3, chain.n), 0.1))
    for kept in (call for name, call in vars(chain).items() if name.startswith("bound ")):
        yield from types_in(kept.kept[0])
    if chain.shapes is None:
        yield from types_in(workspace_for(scene, chain))
    for method in ("DOP853", "Radau5"):
        run = scene.varied({"run.method": method, "run.step": None, "run.relative_tolerance": 1e-4})
        yield from types_in(SingleRun(problem_of(run)).steps.work)


def types_in(record: Any) -> Iterator[type]:
    if isinstance(record, tuple):
        yield type(record)
        for part in record:
            yield from types_in(part)
