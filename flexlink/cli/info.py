"""The command `flexlink info`."""

import argparse
import dataclasses
import math
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import SPRINGS, Kind
from flexlink.chain.lumping import lump, open_chain
from flexlink.cli.modes import as_document, elastic_hertz, first_elastic, print_modes
from flexlink.cli.shared import prefix_errors, print_notes, varied_scene, with_ids
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import plural, short_list
from flexlink.describe import data_files
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.notes import defaults, notes
from flexlink.dynamics.ties import independent_rows, number_of_rows
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.dynamics.vibration.modal import Modes, modes
from flexlink.dynamics.vibration.stability import fastest_eigenvalues, stable_step_of
from flexlink.motion.evaluation_cost import machine_factor, step_cost
from flexlink.motion.inputs.actuation import initial_wrench
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.trajectory import Trajectory


def run_command(options: argparse.Namespace) -> int:
    """Print the model of a scene, and notes on keys without effect."""
    scene = varied_scene(options.scene, options)
    with prefix_errors(options.scene):
        about, found = _examined(scene, options.json)
        if options.run is not None:
            run = Trajectory.load(options.run)
            about["run"] = str(run)
            if run.scene is not None and run.scene.arm != scene.arm:
                text = f"--run {options.run}: of another arm, in scene {run.scene.name!r}; give its own scene and --set"
                raise ArgumentError(text, id="chains-differ")
        options.document = about
        _show(about)
        if found is not None:
            print("structural damping in the initial configuration, with gravity:")
            print_modes(scene, found, np.flatnonzero(found.eigenvalues.imag)[:4])
        print_notes(open_chain(scene))
    return 0


def _examined(scene: Scene, costs: bool) -> tuple[dict[str, Any], Modes | None]:
    """The model at its start as plain data; its modes, whose time grows with the joints' cube, up to 300 joints."""
    opened, tied = open_chain(scene), bool(scene.ties)
    chain = lump(opened)
    q, _ = initial_state(scene, chain)
    if chain.n > 10_000:  # computing the largest eigenvalues takes more than a few seconds
        print(f"computing the fastest modes of {chain.n} joints …", file=sys.stderr)
    found = None
    if tied or chain.n <= 300:
        wrench, frame = initial_wrench(scene, chain)
        found = modes(chain, q, tip_wrench=wrench, frame=frame, ties=scene)
    λ = found.eigenvalues if found is not None and tied else fastest_eigenvalues(chain, q)
    slowest = slowest_frequency(chain, q) if found is None else float(2 * np.pi * found.first_elastic_hertz)
    bare = _without_structural_damping(chain)
    undamped = λ if bare is chain else fastest_eigenvalues(bare, q)
    return {
        "scene": scene.name, "about": scene.about, "degrees_of_freedom": chain.freedoms, "driven": len(chain.active),
        "mass_kg": float(chain.bodies["mass"].sum()),
        "payload_on": scene.arm.links[-1].name if scene.arm.tip.mass and len(scene.arm.tips) > 1 else "",
        "bending": [
            {"link": link.name, "about": link.flex, "ei_y_n_m2": EI[0], "ei_z_n_m2": EI[1]}
            for link in scene.arm.links if (EI := scene.arm.bending_stiffness(link))
        ],
        "joints": [{"name": chain.joint_name(k), "description": _kind(chain, k)} for k in range(chain.n)],
        "sensors": list(column_names(scene.sensor, scene.arm)) if scene.sensor else [],
        "ties": list(_ties(scene, chain, q)),
        "modes": [] if found is None else as_document(found),
        "first_elastic_hz": elastic_hertz(scene, chain, q) if found is not None and not tied else None,
        "fastest_eigenvalue_per_s": float(np.abs(λ).max()), "slowest_elastic_rad_per_s": slowest,
        "stable_steps": [] if tied else list(_stable_steps(scene, chain, λ, undamped, costs)),
        "notes": with_ids((*defaults(scene), *notes(scene))),
    }, None if bare is chain else found  # fmt: skip


def _show(about: Mapping[str, Any]) -> None:
    """Print the model: joints, sensors, frequencies, stable steps."""
    joints = about["joints"]
    print(f"{about['scene']}: {about['about']}" if about["about"] else about["scene"])
    freedoms = about["degrees_of_freedom"]
    stations = f" ({plural(len(joints), 'hinge')} move by strain modes)" if freedoms < len(joints) else ""
    driven, mass = about["driven"], about["mass_kg"]
    print(f"{plural(freedoms, 'degree')} of freedom{stations}, {driven} driven; mass {mass:.6g} kg")
    listed = 100
    for k, joint in enumerate(joints[:listed]):
        print(f"  {k:4d}  {joint['name']:<16} {joint['description']}")
    if len(joints) > listed:
        print(f"  … {len(joints) - listed} more")
    for link in about["bending"]:
        axes, EI = " and ".join(link["about"].strip("x")), (link["ei_y_n_m2"], link["ei_z_n_m2"])
        print(f"{link['link']} bends about {axes}: EI = {EI[0]:.4g} N m² about y, {EI[1]:.4g} N m² about z")
    if about["payload_on"]:
        print(f"the payload, tip, is at the end of {about['payload_on']}, the last link")
    if about["sensors"]:
        print(f"sensors: {', '.join(about['sensors'])}")
    for kind in ("elastic", "pendulum"):
        values = [mode["frequency_hz"] for mode in about["modes"] if mode["kind"] == kind]
        hertz = [f"{value:.4g}" if np.isfinite(value) else "none (unstable equilibrium)" for value in values]
        some = ", ".join(hertz if len(hertz) <= 8 else [*hertz[:4], "…", *hertz[-2:]])
        if hertz:
            print(f"{kind} frequencies in the initial configuration, joints free [Hz]: {some}")
    if about["modes"]:
        ties, left = about["ties"], freedoms - sum(tie["independent_rows"] for tie in about["ties"])
        each = ", ".join(f"{tie['name']} {tie['about']}" for tie in ties)
        held = f"ties leave {left} of {plural(freedoms, 'degree')} of freedom: {each}"
        print(held if ties else first_elastic(about["first_elastic_hz"]))
    fastest, slowest = about["fastest_eigenvalue_per_s"], about["slowest_elastic_rad_per_s"]
    if np.isfinite(slowest):
        ends = f"fastest eigenvalue {fastest:.4g} 1/s, slowest elastic mode {slowest:.4g} rad/s with free joints"
        print(f"stiffness ratio {fastest / slowest:.3g}: {ends}")
    if "run" in about:
        print(about["run"])
    if steps := [_step_text(row) for row in about["stable_steps"] if np.isfinite(row["step_s"])]:
        print(f"largest stable fixed steps [s], methods without a limit left out: {', '.join(steps)}")


def _ties(scene: Scene, chain: Chain, q: Array) -> Iterator[dict[str, Any]]:
    """Names, kinds and numbers of independent rows of ties."""
    for tie, rows in zip(scene.ties, independent_rows(scene, chain, q), strict=True):
        of, spring = number_of_rows(tie), not tie.exact
        held = "spring" if spring else plural(of, "row") + (f", {of - rows} redundant" if rows < of else "")
        yield {"name": tie.name, "kind": tie.kind, "independent_rows": rows, "about": f"({tie.kind}, {held})"}


def _kind(chain: Chain, k: int) -> str:
    """Describe a joint by its spring or, for a driven joint, by its limits."""
    of_joint = chain.joint_kinds[k]
    if chain.coordinate(k).kind is Kind.BASE:
        return "of the free base"
    if chain.coordinate(k).kind is not Kind.JOINT:
        coupled = short_list(list(map(str, chain.coupled_joints[k])))
        turned = ", of a rotation vector" if chain.bodies["springs"][chain.body(k)] else ""
        more = f", coupled with {coupled}" if coupled else ""
        return f"k = {chain.stiffness[k]:.6g} {of_joint.torque}/{of_joint.si}{turned}{more}"
    lower, upper = (chain.place_in_words(k, float(chain.hinges[side][k])) for side in ("lower", "upper"))
    driven = "driven" if of_joint.si == "rad" else f"driven, {of_joint.moves}"
    return f"{driven}, {lower} … {upper}" if np.isfinite(chain.hinges["lower"][k]) else driven


def _stable_steps(scene: Scene, chain: Chain, λ: Complex, undamped: Complex, costs: bool) -> Iterator[dict[str, Any]]:
    """Largest stable step [s] of every method, inf if it is unlimited, and CPU time for one second of motion."""
    factor = machine_factor(problem_of(scene, chain)) if costs else math.nan  # measuring compiles the steps of a run
    for method in data_files.names("methods"):
        h, without = stable_step_of(λ, method), stable_step_of(undamped, method)
        cost = factor * step_cost(chain, method) / h if np.isfinite(h) else None
        yield {"method": method, "step_s": h, "cpu_s_per_s": cost, "step_without_structural_damping_s": without}


def _step_text(row: Mapping[str, Any]) -> str:
    h, undamped = row["step_s"], row["step_without_structural_damping_s"]
    return f"{row['method']} {h:.4g}" + ("" if undamped == h else f" (without structural damping {undamped:.4g})")


def _without_structural_damping(chain: Chain) -> Chain:
    """The chain without Kelvin-Voigt damping; the same object if it has none."""
    hinges, couplings = chain.hinges.copy(), chain.couplings.copy()
    hinges["damping"][chain.where(*SPRINGS)] = 0.0
    couplings["damping"] = 0.0
    same = np.array_equal(hinges, chain.hinges) and np.array_equal(couplings, chain.couplings)
    return chain if same else dataclasses.replace(chain, hinges=hinges, couplings=couplings)
