"""Kernels also run as plain Python (NUMBA_DISABLE_JIT=1), which debuggers and coverage measurements need."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.dynamics.rounding import acceleration_error, of_residual
from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.bodies.plane import planar_workspace
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.tools.lanes import Eight, at, put_at, tanh, zero_of
from tests.conftest import ROOT, compiled, flexible, make_scene, nasty_scene, random_state

SCENES = {"spatial": nasty_scene(), "planar": make_scene(flexible("a", segments=3))}
CHAINS = {name: fl.lump(scene) for name, scene in SCENES.items()}
WRENCH = np.array([1.0, -2.0, 3.0, 0.3, -0.2, 0.1])


def states(chain: fl.Chain) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(8)
    return *random_state(chain, rng), rng.normal(size=chain.n)


def torques(name: str) -> np.ndarray:
    """M q̈ + T_GC of one state, computed by each recursion."""
    chain, found = CHAINS[name].arrays, []
    for work in [rne_workspace(chain)] + [planar_workspace(chain)] * (name == "planar"):
        tau = np.empty(len(chain.hinges))
        inverse_dynamics_into(chain, WRENCH, *states(CHAINS[name]), tau, work)
        found.append(tau)
    return np.array(found)


def accelerations(name: str) -> np.ndarray:
    """q̈ of one state by every solver, and for two chains side by side."""
    chain = CHAINS[name]
    state = states(chain)
    singles = [fl.forward_dynamics(chain, *state, solver=method) for method in SOLVERS]
    return np.array([*singles, *fl.forward_dynamics(chain, *(np.stack([part, part]) for part in state))])


def as_python(parts: str, folder: Path) -> Mapping[str, np.ndarray]:
    """Results by name of expressions evaluated in a process without compilation, where `t` is this module."""
    file = folder / "found.npz"
    code = f"import sys, numpy, tests.kernels.test_as_python as t; numpy.savez(sys.argv[1], {parts})"
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    subprocess.run([sys.executable, "-c", code, str(file)], env=environment, check=True)
    return dict(np.load(file))


def controlled(name: str) -> np.ndarray:
    """Final tip positions of short runs with each kind of adaptive or implicit method."""
    scene = SCENES[name].varied({"run.duration": 0.002, "run.sample": 0.001})
    runs = [fl.simulate(scene, method=method, tolerance=1e-3) for method in ("Radau5", "DOP853")]
    dry = scene.varied({"link.*.joint.coulomb": 0.1})
    runs.append(fl.simulate(dry, method="Gauss4", step=5e-4))  # arrays of real eigenvalues are empty
    return np.array([run.tip[-1] for run in runs])


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("name", CHAINS)
def test_adaptive_and_implicit_steps_agree_with_and_without_compilation(name: str, tmp_path: Path) -> None:
    found = as_python(f"a=t.controlled({name!r})", tmp_path)
    np.testing.assert_allclose(found["a"], controlled(name), rtol=0, atol=1e-10)


@compiled
@pytest.mark.parametrize("name", CHAINS)
def test_kernels_give_the_same_accelerations_with_and_without_compilation(name: str, tmp_path: Path) -> None:
    found = as_python(f"a=t.accelerations({name!r}), t=t.torques({name!r})", tmp_path)
    for in_python, as_machine_code in zip(found["a"], accelerations(name), strict=True):
        error = acceleration_error(CHAINS[name], *states(CHAINS[name]), solutions=(in_python, as_machine_code))
        assert error.max() <= 1
    explained = of_residual(CHAINS[name], *states(CHAINS[name]), np.zeros(CHAINS[name].n), tip_wrench=WRENCH)
    assert np.abs(found["t"] - torques(name)).max() <= explained


def test_vectors_of_eight_lanes_behave_as_scalars_without_compilation() -> None:
    rows = np.arange(24.0).reshape(3, 8)
    x = y = at(rows, 1)
    x += 1.0
    x *= 2.0
    x -= y
    np.testing.assert_array_equal(y, rows[1])
    np.testing.assert_array_equal(x, rows[1] + 2.0)
    put_at(rows, x, 2)
    np.testing.assert_array_equal(rows[2], x)
    x += 1.0
    assert (rows[2] != x).all()
    assert isinstance(zero_of(rows) + tanh(x), Eight)
    np.testing.assert_array_equal(tanh(x), [tanh(one) for one in x.tolist()])
