"""`flexlink info`: Show the model of a scene: joints, mass, frequencies, stable steps, damping.

flexlink info models/paper_fig5.toml
flexlink info models/paper_fig5.toml --set 'link.*.segments=9'
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.cli.modes import first_elastic, print_modes
from flexlink.cli.shared import prefix_errors, print_notes, varied_scene
from flexlink.common.types import Array, Complex
from flexlink.common.wording import short_list
from flexlink.describe import data_files
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.dynamics.vibration.modal import Modes, modes
from flexlink.dynamics.vibration.stability import fastest_eigenvalues, stable_step_of
from flexlink.motion.evaluation_cost import machine_factor, step_cost
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.inputs.tip_wrench import initial_wrench


def add_options(command: argparse.ArgumentParser) -> None:
    """Options of `info`."""
    command.add_argument("scene", type=Path, help="scene file (.toml)")


def run_command(options: argparse.Namespace) -> int:
    """Print what a scene's chain is like, and what it says without effect."""
    scene = varied_scene(options.scene, options)
    with prefix_errors(options.scene):
        _show(scene)
        print_notes(scene)
    return 0


def _show(scene: Scene) -> None:
    chain = lump(scene)
    q0, _ = initial_state(scene, chain)
    print(f"{scene.name}: {scene.about}" if scene.about else scene.name)
    print(f"{chain.n} degrees of freedom, {len(chain.active)} driven; mass {chain.bodies['mass'].sum():.6g} kg")
    listed = 100
    for k in range(min(chain.n, listed)):
        print(f"  {k:4d}  {chain.joint_name(k):<16} {_kind(chain, k)}")
    if chain.n > listed:
        print(f"  … {chain.n - listed} more")
    if scene.sensor:
        print(f"sensors: {', '.join(column_names(scene.sensor, scene.arm))}")
    if chain.n > 10_000:  # the largest eigenvalues take more than a few seconds
        print(f"computing the fastest modes of {chain.n} joints …", file=sys.stderr)
    λ = fastest_eigenvalues(chain, q0)
    found = None
    if chain.n <= 300:  # O(n³)
        wrench, frame = initial_wrench(scene, chain)
        found = modes(chain, q0, tip_wrench=wrench, frame=frame)
    _show_frequencies(scene, chain, q0, λ, found)
    bare = _without_structural_damping(chain)
    free = λ if bare is chain else fastest_eigenvalues(bare, q0)
    _show_steps(chain, machine_factor(problem_of(scene, chain)), λ, free)
    if bare is not chain and found is not None:
        print("structural damping about the start, with gravity:")
        print_modes(scene, found, np.flatnonzero(found.eigenvalues.imag)[:4])


def _show_frequencies(scene: Scene, chain: Chain, q0: Array, λ: Complex, found: Modes | None) -> None:
    """Frequencies about the start by kind, the first elastic one at rest, and the stiffness ratio."""
    if found is None:
        slowest = slowest_frequency(chain, q0)
    else:
        slowest = 2 * np.pi * found.first_elastic_hertz
        for kind in ("elastic", "pendulum"):
            hertz = found.hertz[[k == kind for k in found.kinds]]
            if len(hertz):
                print(f"{kind} frequencies at the start, joints free [Hz]: {_some(hertz)}")
        print(first_elastic(scene, chain, q0))
    if np.isfinite(slowest):
        fastest = np.abs(λ).max()
        ends = f"fastest eigenvalue {fastest:.4g} 1/s, slowest elastic mode {slowest:.4g} rad/s with free joints"
        print(f"stiffness ratio {fastest / slowest:.3g}: {ends}")


def _kind(chain: Chain, k: int) -> str:
    """What a joint is: a spring, or driven, and within which limits."""
    slides = bool(chain.slides[k])
    if chain.coordinate(k).of_base:
        return "of the free base"
    if chain.coordinate(k).axis:
        coupled = short_list(list(map(str, chain.coupled_joints[k])))
        turned = ", of a rotation vector" if chain.bodies["springs"][chain.body(k)] else ""
        unit, more = "N/m" if slides else "N m/rad", f", coupled with {coupled}" if coupled else ""
        return f"k = {chain.stiffness[k]:.6g} {unit}{turned}{more}"
    lower, upper = (chain.place_in_words(k, float(chain.hinges[side][k])) for side in ("lower", "upper"))
    driven = "driven, slides" if slides else "driven"
    return f"{driven}, {lower} … {upper}" if np.isfinite(chain.hinges["lower"][k]) else driven


def _show_steps(chain: Chain, factor: float, λ: Complex, free: Complex) -> None:
    """Largest stable steps, also without structural damping, and their CPU time, `factor` times the listed one."""
    rk4 = step_cost(chain, "RK4") / stable_step_of(λ, "RK4")
    print("with a tolerance, the default, steps follow from the error; fixed steps, by method:")
    for method in data_files.names("methods"):
        h, cost, price = stable_step_of(λ, method), step_cost(chain, method), ""
        if np.isfinite(h):
            price = f", {factor * cost / h:.2g} s of CPU time for one second of motion"
        elif rk4 > 0:
            price = f", as cheap as RK4 with about {rk4 / cost:.0f} steps per second"
        undamped = stable_step_of(free, method)
        without = "" if undamped == h else f"; {_step(undamped)} without structural damping"
        print(f"  {method:<6} {_step(h)}{price}{without}")


def _without_structural_damping(chain: Chain) -> Chain:
    """The chain with Kelvin-Voigt's law left out; the same chain where there is none."""
    hinges, couplings = chain.hinges.copy(), chain.couplings.copy()
    hinges["damping"][[k for k, c in enumerate(chain.coordinates) if c.axis]] = 0.0
    couplings["damping"] = 0.0
    same = np.array_equal(hinges, chain.hinges) and np.array_equal(couplings, chain.couplings)
    return chain if same else dataclasses.replace(chain, hinges=hinges, couplings=couplings)


def _step(h: float) -> str:
    return f"at most {h:.4g} s" if np.isfinite(h) else "no limit"


def _some(values: Array) -> str:
    shown = [f"{value:.4g}" if np.isfinite(value) else "none: it falls" for value in values]
    return ", ".join(shown if len(shown) <= 8 else [*shown[:4], "…", *shown[-2:]])
