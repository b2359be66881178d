"""Stepping loops are compiled for four kinds of chain only: plain or full, planar or spatial."""

import collections
import itertools
import subprocess
import sys

import pytest

import flexlink as fl
from flexlink.kernels.stepping.adaptive import advance
from flexlink.kernels.stepping.runge_kutta import integrate
from tests.conftest import MODELS, nasty_scene
from tests.motion.test_problem import DRIVES, MOTION, arm

MOST = 4
WAYS: list[dict[str, object]] = [
    {"run.method": "RK4"},
    {"run.method": "Radau5", "run.relative_tolerance": 1e-3},
    {"run.method": "DOP853", "run.relative_tolerance": 1e-3},
]


def scenes() -> list[fl.Scene]:
    """Every model, every control law, prescribed motion, wrenches that change, drag, dampers, lags, and all at once."""
    bare = fl.load_scene("models/t2_spatial.toml")
    laws = [arm(law) for law in DRIVES]
    changed = [
        {"link.*.drag": fl.Drag(coefficient=1.0)}, {"link.*.joint.quadratic": 1.0, "link.*.joint.hardening": 1.0},
        {"link.*.joint": fl.Joint(viscous=1.0, viscous_lag=0.1)},
        {"wrench": fl.Wrench(force=(1.0, 0.0, 0.0), frame="tip")}, {"drive": fl.Drive()},
    ]  # fmt: skip
    return [*map(fl.load_scene, MODELS), *laws, arm("linear").varied({"motion": (MOTION,)}), nasty_scene(),
            *(bare.varied(change) for change in changed)]  # fmt: skip


def count() -> None:
    """Run all scenes for two steps with each method, and print for how many kinds of chain each loop was compiled."""
    for way, scene in itertools.product(WAYS, scenes()):
        step = scene.run.fixed_step
        own = {"run.duration": 2 * step, "run.sample": step, "run.unstable": "allow", **way}
        fl.simulate(scene.varied(own if "run.relative_tolerance" in own else {**own, "run.step": step}))
    found = collections.Counter(str(signature.args[0]).partition("(")[0] for signature in advance.nopython_signatures)
    for signature in integrate.nopython_signatures:
        found["side by side" if "2d" in str(signature.args[9]) else "integrate"] += 1
    print(dict(found))


@pytest.mark.slow
def test_stepping_loops_are_compiled_for_four_kinds_of_chain_only() -> None:
    """Adaptive steps have one loop for implicit methods and one for explicit ones."""
    code = "from tests.kernels.test_kinds import count; count()"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    found = eval(printed.strip().splitlines()[-1])
    assert {"integrate", "ImplicitWork", "EmbeddedWork"} <= set(found), printed
    assert max(found.values()) <= MOST, found
