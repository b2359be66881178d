"""Compile all machine code by calling every public function, on small arms that together cover all kinds of scenes."""

import contextlib
import functools
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

import flexlink as fl

KINDS = "tree", "space", "plane", "cells", "free"  # names of the scenes in `data/`, in order of decreasing compile time
BY_MODES = "space", "plane"  # scenes whose links are also described by modes of bending


def scene_of(name: str) -> fl.Scene:
    """Load a scene from `data/`."""
    return fl.load_scene(Path(__file__).parent / "data" / f"{name}.toml")


def count() -> int:
    """Number of calls that the rehearsal makes for all its scenes together."""
    return sum(len([*calls(scene_of(name))]) for name in KINDS)


def calls(scene: fl.Scene) -> Iterator[tuple[str, Callable[[], object]]]:
    """Calls for a scene, each with a name for its output line."""
    for method in ("RK4", "DOP853", "Radau5", "auto"):
        yield method, functools.partial(fl.simulate, _by(scene, method))
    yield from _of_states(scene)
    yield from _of_runs(scene)
    if scene.name in BY_MODES:
        yield from _of_modes(scene.varied({"link.*.modes": 1}))


def _of_modes(scene: fl.Scene) -> Iterator[tuple[str, Callable[[], object]]]:
    """Functions that have separate code for chains whose hinges move by shapes."""
    chain = fl.lump(scene)
    state = np.full((3, chain.n), 0.1)
    for name in ("forward_dynamics", "forward_dynamics_derivatives"):
        yield f"{name} by modes", functools.partial(getattr(fl, name), chain, *state)
    for name in ("modes", "solve_static"):
        yield f"{name} by modes", functools.partial(getattr(fl, name), chain, locked=chain.active)
    for method in ("RK4", "DOP853", "Radau5", "auto"):
        yield f"{method} by modes", functools.partial(fl.simulate, _by(scene, method))


def _by(scene: fl.Scene, method: str) -> fl.Scene:
    steps = {"run.unstable": "allow"} if method == "RK4" else {"run.step": None, "run.relative_tolerance": 1e-4}
    return scene.varied({"run.method": method, **steps})


def _of_states(scene: fl.Scene) -> Iterator[tuple[str, Callable[[], object]]]:
    """Functions of a chain, called with one state and with many states."""
    chain = fl.lump(scene)
    n, held = chain.n, chain.active
    state, many = np.full((3, n), 0.1), np.full((3, 9, n), 0.1)
    q, qd, qs = state[0], state[1], many[0]
    both = (state, many)
    solvers = ("lu", "cholesky")
    yield "solvers", _each(*(functools.partial(fl.forward_dynamics, chain, *state, solver=each) for each in solvers))
    for name in (
        "forward_dynamics",
        "inverse_dynamics",
        "forward_dynamics_derivatives",
        "inverse_dynamics_derivatives",
    ):
        yield name, _each(*(functools.partial(getattr(fl, name), chain, *one) for one in both))
    yield "mass matrix", _each(*(functools.partial(fl.mass_matrix, chain, one) for one in (q, qs)))
    for name in ("gravity_torque", "elastic_torque", "tip_position", "frames", "jacobian", "stable_step", "linearize"):
        yield name, functools.partial(getattr(fl, name), chain, q)
    for name in ("bias_torque", "drag_torque", "energy", "momentum", "modes"):
        yield name, functools.partial(getattr(fl, name), chain, q, qd)
    yield "friction_torque", functools.partial(fl.friction_torque, chain, qd)
    yield "com", functools.partial(chain.com, q)
    yield "point_motion", functools.partial(fl.point_motion, chain, *state)
    yield "internal_loads", functools.partial(fl.strength.internal_loads, chain, *state)
    for name in ("solve_static", "modes", "natural_frequencies"):
        yield f"{name} of held joints", functools.partial(getattr(fl, name), chain, locked=held)
    buckling = functools.partial(fl.strength.buckling_loads, chain, locked=held, tip_wrench=[-1.0, 0, 0, 0, 0, 0])
    yield "buckling", buckling
    floating = fl.lump(scene.varied({"gravity": (0.0, 0.0, 0.0)}))
    spun = {chain.joint_name(int(held[0])): 1.0} if len(held) else {}
    yield "modes in motion", functools.partial(fl.small_motion.modes_in_motion, floating, spun, locked=held[1:])
    yield "many joints", lambda: _of_many_joints(scene)


def _each(*calls: Callable[[], object]) -> Callable[[], None]:
    """Combine calls into one, which ignores their flexlink errors."""

    def call() -> None:
        for each in calls:
            with contextlib.suppress(fl.FlexlinkError):
                each()

    return call


def _of_many_joints(scene: fl.Scene) -> None:
    """Call, with more than a hundred joints, the functions that then use O(n) algorithms."""
    chain = fl.lump(scene.varied({f"link.{link.name}.segments": 121 for link in scene.arm.links if link.segments > 1}))
    fl.stable_step(chain, np.zeros(chain.n))
    for call in (functools.partial(fl.modes, count=3), fl.solve_static):
        with contextlib.suppress(fl.FlexlinkError):
            call(chain, locked=chain.active)


def _of_runs(scene: fl.Scene) -> Iterator[tuple[str, Callable[[], object]]]:
    """Simulations: many at once, with prescribed motion, controlled, step by step, stored, and for advice."""
    mass = f"link.{scene.arm.links[-1].name}.end.mass"
    fixed, sampled = _by(scene, "RK4"), {"drive.rate": 1000.0}
    for method in ("RK4", "DOP853", "Radau5", "auto"):
        members = [_by(scene, method).varied({mass: 0.01 * k}) for k in range(9)]
        yield f"many by {method}", functools.partial(fl.simulate_many, members)
    yield "sampled law", lambda: fl.simulate(fixed.varied(sampled))
    cascade: dict[str, object] = {"drive.kind": "cascade", "drive.gravity": "none"}
    yield "loop", lambda: fl.loop(fixed.varied(sampled)).growth
    yield "loop of a cascade", lambda: fl.loop(fixed.varied(sampled | cascade)).growth
    for method in ("RK4", "DOP853", "Radau5"):
        moved = _by(scene.varied({"drive": None, "motion": _constant_motion(scene)}), method)
        yield f"prescribed motion by {method}", functools.partial(fl.simulate, moved)
    free = fixed.varied({"drive": None})
    yield "control", lambda: fl.simulate(free, control=lambda t, q, qd: np.zeros(len(fl.lump(free).active)), rate=1e3)
    yield "simulator", _each(lambda: fl.Simulator(fixed).step(), lambda: fl.Simulator(_by(scene, "auto")).step())
    for method in ("RK4", "Gauss4"):
        steps = free.varied({"run.method": method})
        yield f"gradient by {method}", functools.partial(lambda each: fl.run_gradient(fl.simulate(each)), steps)
    yield "stored run", lambda: _stored(fixed)
    yield "sensitivities", lambda: fl.sensitivities(scene.varied({mass: 0.1}), [mass])
    if scene.name != "space":  # advice would try rotation-vector springs, which another process compiles
        yield "advice", lambda: fl.advise(scene, 0.3, budget=0.01)


def _constant_motion(scene: fl.Scene) -> tuple[fl.PrescribedMotion, ...]:
    """A constant prescribed motion of the last free revolute joint, if there is one."""
    none = (0.0, 0.0)
    joints = zip(scene.arm.links, scene.initial.joint_deg, strict=False)
    free = [(link.name, angle) for link, angle in joints if link.joint.kind == "revolute" and not link.joint.locked]
    return tuple(
        fl.PrescribedMotion(link=name, times=(0.0, 1.0), angle_deg=(angle,) * 2, rate_deg=none, acceleration_deg=none)
        for name, angle in free[-1:]
    )


def _stored(scene: fl.Scene) -> None:
    run = fl.simulate(scene)
    with tempfile.TemporaryDirectory() as folder:
        fl.Trajectory.load(run.save(Path(folder) / "run.npz")).columns["imbalance [J]"]


def main(names: Sequence[str]) -> None:
    """Make all calls for scenes in `data/`, and print the time of each call to stderr."""
    for name in names:
        for what, call in calls(scene_of(name)):
            begun, refused = time.process_time(), ""
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    call()
                except fl.FlexlinkError as error:
                    refused = f", refused: {error}"
            print(f"{name}: {what}: {time.process_time() - begun:.1f} s{refused}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
