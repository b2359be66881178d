"""Time complete user calls: run a problem that has run before, or run a scene file."""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import mujoco
import pinocchio as pin

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.common.memo import Memo
from flexlink.describe.scene import Scene
from flexlink.engines.mujoco import quiet
from flexlink.formats.mjcf import to_mjcf
from flexlink.formats.urdf import to_urdf
from flexlink.results.trajectory import Trajectory
from validation.trade.native_ladder import Timed
from validation.trade.scenes import seen

PROBLEMS = Memo(4)
REPEATS = 5


def prepared(scene: Scene, _longest: float) -> Timed:
    """Time a run of a problem that has run before."""

    def run_once() -> fl.Problem:
        problem = fl.Problem(scene)
        _quietly(problem.simulate)
        return problem

    return _timed(PROBLEMS(scene, None, run_once).simulate)


def described(scene: Scene, _longest: float) -> Timed:
    """Time reading a scene file, lumping a new chain and running it."""
    with tempfile.TemporaryDirectory() as folder:
        path = scene.save(Path(folder) / "scene.toml")
        return _timed(lambda: fl.simulate(fl.load_scene(path)))


def _timed(run: Callable[[], Trajectory]) -> Timed:
    begun = time.thread_time()
    trajectory = _quietly(run)
    seconds = time.thread_time() - begun
    evaluations = 0 if trajectory.steps is None else trajectory.steps.evaluations
    return Timed(seen(trajectory.chain, trajectory.q), seconds, evaluations)


def _quietly(run: Callable[[], Trajectory]) -> Trajectory:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # about doubtful results; here a reference measures the error
        return run()


def loading_mujoco(chain: Chain) -> float:
    """Least CPU seconds for MuJoCo to read and compile a chain's MJCF and create its data."""
    text = to_mjcf(chain, shapes=False)

    def load() -> object:
        return mujoco.MjData(mujoco.MjModel.from_xml_string(text))

    with quiet():
        return _least(load)


def loading_pinocchio(chain: Chain) -> float:
    """Least CPU seconds for Pinocchio to read a chain's URDF and create its data."""
    text = to_urdf(chain, shapes=False)
    return _least(lambda: pin.buildModelFromXML(text).createData())


def _least(call: Callable[[], object]) -> float:
    def seconds() -> float:
        begun = time.thread_time()
        call()
        return time.thread_time() - begun

    return min(seconds() for _ in range(REPEATS))
