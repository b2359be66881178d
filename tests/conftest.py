"""Shared fixtures: the scenes of `models/`, and arms built in Python."""

import gc
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # one process per core: BLAS threads would spin and wait for each other
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # must be set before NumPy is imported

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from flexlink import (
    Arm,
    Chain,
    InitialState,
    Joint,
    Link,
    Material,
    Mount,
    RigidBody,
    RunSettings,
    Scene,
    Section,
    load_scene,
    lump,
)
from flexlink.describe.spec import Vector3

pytest.register_assert_rewrite("tests.matrix")
ROOT = Path(__file__).parent.parent
MODELS = sorted((ROOT / "models").glob("*.toml"))
ALUMINIUM = Material(young=70e9, poisson=0.33, density=2700.0)
SQUARE = Section(shape="rectangle", height=0.04, width=0.04)
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell without job control ignores SIGINT in background jobs
    signal.signal(signal.SIGINT, signal.default_int_handler)
compiled = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="needs compiled kernels: NUMBA_DISABLE_JIT is set")
LONG = frozenset((ROOT / "tests" / "long.txt").read_text(encoding="utf-8").splitlines())
LONGEST_AS_PYTHON = 10.0  # s of processor time; slower tests are skipped if kernels run as Python


settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")  # deadlines would depend on the speed of the computer


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Number of processes for `-n auto`: one per processor, up to four, since each takes up to 2 GB of memory."""
    return min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, 4)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run files with many slow tests first: otherwise all processes wait for one long test at the end of the run.

    Files that compile kernels for other files run even earlier. A run for which no files or folders are named leaves
    out the tests that take long.
    """
    if config.args == config.getini("testpaths"):
        left_out = {
            item
            for item in items
            if item.get_closest_marker("long") or not LONG.isdisjoint((item.nodeid, item.nodeid.partition("[")[0]))
        }
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: (item.get_closest_marker("first") is None, -slow[item.path]))


def pytest_collection_finish() -> None:
    """Exclude modules and tests from garbage collection, and collect other objects less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)


class _TooSlow(BaseException):
    """Raised by a timer. No tested code catches it."""


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_pyfunc_call() -> Iterator[None]:
    """Skip a test that takes too long because its kernels are not compiled and a hundred times slower."""
    if not numba.config.DISABLE_JIT or not hasattr(signal, "setitimer"):
        return (yield)
    due = True

    def ring(*_: object) -> None:
        if due:
            raise _TooSlow

    signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_AS_PYTHON)
    try:
        return (yield)
    except _TooSlow:
        pytest.skip(f"takes more than {LONGEST_AS_PYTHON:.0f} s where kernels are not compiled")
    finally:
        due = False
        signal.setitimer(signal.ITIMER_PROF, 0)


def flexible(name: str, flex: str = "z", segments: int = 5, **fields: object) -> Link:
    """A flexible aluminium link of 1.25 m, as in the paper's figure 5."""
    defaults = {"length": 1.25, "material": "aluminium", "section": "square", "lumping": "paper"}
    return Link(name=name, flex=flex, segments=segments, **{**defaults, **fields})


def make_scene(*links: Link, tip: RigidBody | None = None, **fields: object) -> Scene:
    """A scene of the given links at zero angles, with time steps of 0.1 ms."""
    arm = Arm(links=links, materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE}, tip=tip or RigidBody())
    usual = {"initial": InitialState(joint_deg=(0.0,) * len(links)), "run": RunSettings(step=1e-4)}
    return Scene(name="test", arm=arm, **{**usual, **fields})


def chain_of(arm: Arm, gravity: Vector3 = (0.0, 0.0, 0.0), joint_deg: tuple[float, ...] | None = None) -> Chain:
    """Return the chain of an arm, by default without gravity and at zero angles."""
    initial = InitialState(joint_deg=joint_deg or (0.0,) * len(arm.links))
    return lump(Scene(name="arm", arm=arm, gravity=gravity, initial=initial))


def nasty_scene() -> Scene:
    """Return an arm with every feature: zero-length free waist, skew mounts, mixed flex types, payload, friction."""
    return make_scene(
        Link(name="waist", mount=Mount(rpy_deg=(10.0, 20.0, 30.0), xyz=(0.1, -0.2, 0.3))),
        flexible("upper", "xyz", 4, mount=Mount(rpy_deg=(-75.0, 5.0, 0.0)), joint=Joint(viscous=1.0, armature=0.02)),
        Link(name="rigid", length=0.4, material="aluminium", section="square", mount=Mount(rpy_deg=(0.0, 40.0, 0.0))),
        flexible("fore", "yz", 3, lumping="midpoint", mount=Mount(xyz=(0.05, 0.02, 0.0)), joint=Joint(coulomb=0.7)),
        flexible("hand", "z", 3, lumping="gauss", joint=Joint(locked=True)),
        tip=RigidBody(mass=0.8, inertia=(1e-3, 2e-3, 3e-3)),
        gravity=(1.0, -2.0, 9.0),
        initial=InitialState(joint_deg=(0.0, 10.0, 20.0, 30.0, 25.0)),
    )


@pytest.fixture(params=[*[path.stem for path in MODELS], "nasty"])
def chain(request: pytest.FixtureRequest) -> Chain:
    """Chains of all scenes in `models/`, and of the arm with every feature."""
    if request.param == "nasty":
        return lump(nasty_scene())
    return lump(load_scene(ROOT / "models" / f"{request.param}.toml"))


@pytest.fixture
def rng() -> np.random.Generator:
    """Random number generator with a fixed seed."""
    return np.random.default_rng(20260701)


def random_state(chain: Chain, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random angles over the full range, and rates up to 10 rad/s."""
    return rng.uniform(-np.pi, np.pi, chain.n), rng.uniform(-10, 10, chain.n)


@pytest.fixture
def models() -> Path:
    """Folder `models/`."""
    return ROOT / "models"
