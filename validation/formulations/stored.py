"""python -m validation.formulations.stored [NAME …]: compute and store reference motions of the tip.

soft_two_links  inextensible rods by Galerkin's method, which share no code with a formulation; the own error is the
                distance from a run with fewer polynomials
l_arm           no closed form exists: the finest chain of coupled cells; the own error is its distance from a chain
                with half the hinges. Exudyn's geometrically exact beams, which share no code with it, confirm it: their
                distance is stored, with the distance between Exudyn's two finest meshes. Needs exudyn.
others          arms with drives, friction, branches: the finest chain of coupled cells. Chains of gauss, another family
                of rules, must have the same limit; Pinocchio's accelerations with SciPy's Radau, or MuJoCo's RK4, which
                share no code with flexlink, must compute the same motion of the finest of these. The own error is the
                largest of these distances, and of that from a chain with half the hinges.

Each takes some minutes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np

from flexlink.common.types import Array
from flexlink.describe.spec import decode
from flexlink.results.convergence import extrapolated
from flexlink.results.tip_motion import largest_distance
from validation.case import CASES, load_case
from validation.formulations import exported_chains, flexlink_links
from validation.formulations.task import Described, Task, task_of
from validation.oracles import inextensible_rods
from validation.reference_values import store_reference

POLYNOMIALS, FEWER, TOLERANCE = 16, 12, 1e-8
FINEST, COARSER = {"hinges": 48, "tolerance": 1e-8}, {"hinges": 24, "tolerance": 1e-8}
WITNESS = {"elements": 32, "stiffness": 1e5, "step": 2.5e-4}
COARSER_WITNESS = {"elements": 16, "stiffness": 1e5, "step": 2.5e-4}


def main(arguments: Sequence[str] | None = None) -> int:
    """Compute and store the references."""
    parser = argparse.ArgumentParser(prog="python -m validation.formulations.stored", description=__doc__)
    parser.add_argument("names", nargs="*", default=list(COMPUTED), help="names (default: all)")
    for name in parser.parse_args(arguments).names:
        began = time.process_time()
        task = _task(name)
        tip, found, settings = COMPUTED[name](task)
        store_reference(
            name, f"Tip of {name!r} in frame 0. {task.scene.about}", "python -m validation.formulations.stored",
            time.process_time() - began, settings=settings,
            reference={**found, "t_s": task.times.tolist(), "tip": tip.tolist()},
        )  # fmt: skip
        print(f"{name}: " + ", ".join(f"{key} {value:.1e}" for key, value in found.items()), flush=True)
    return 0


def _task(name: str) -> Task:
    """The task of the case whose reference has this name, without its reference."""
    tasks = load_case(CASES / "formulations.toml").settings["task"]
    described: Described = next(decode(raw, Described, name) for raw in tasks.values() if raw["reference"] == name)
    return task_of(name, msgspec.structs.replace(described, reference=""))


def _two_links(task: Task) -> tuple[Array, dict[str, float], dict[str, Any]]:
    arm = galerkin_arm(task)

    def tip(polynomials: int) -> Array:
        plane = inextensible_rods.tips(arm, task.times, polynomials, TOLERANCE)
        return np.asarray(plane @ task.axes[:, :2].T)

    finest = tip(POLYNOMIALS)
    settings = {"polynomials": POLYNOMIALS, "fewer": FEWER, "tolerance": TOLERANCE}
    return finest, {"own_error_m": largest_distance(finest, tip(FEWER))}, settings


def galerkin_arm(task: Task) -> inextensible_rods.Arm:
    """A planar task for Galerkin's method, in the axes of its first joint."""
    angles = [float(np.arctan2(*(task.axes.T @ rod.turn[:, 0])[1::-1])) for rod in task.rods]
    rods = tuple(
        inextensible_rods.Rod(rod.length, rod.mass, rod.rotary[2], rod.bending[1], angle)
        for rod, angle in zip(task.rods, angles, strict=True)
    )
    gravity = (task.axes.T @ task.gravity)[:2].tolist()
    return inextensible_rods.Arm(rods, (gravity[0], gravity[1]), task.rotor, task.payload, task.torque)


def _l_arm(task: Task) -> tuple[Array, dict[str, float], dict[str, Any]]:
    from validation.formulations import exudyn_elements  # noqa: PLC0415  only this reference needs exudyn

    finest = flexlink_links.run(task, "lobatto4", FINEST).tip
    witness = exudyn_elements.run(task, exudyn_elements.IN_SPACE, WITNESS).tip
    coarser = exudyn_elements.run(task, exudyn_elements.IN_SPACE, COARSER_WITNESS).tip
    found = {
        "own_error_m": largest_distance(finest, flexlink_links.run(task, "lobatto4", COARSER).tip),
        "witness_m": largest_distance(finest, witness),
        "witness_refined_m": largest_distance(witness, coarser),
    }
    names = ("finest", FINEST), ("coarser", COARSER), ("witness", WITNESS), ("coarser witness", COARSER_WITNESS)
    return finest, found, dict(names)


def _chain(task: Task) -> tuple[Array, dict[str, float], dict[str, Any]]:
    """A finest chain of coupled cells, the limit of chains of another rule, and another program on one of these."""
    finest = flexlink_links.run(task, "lobatto4", FINE).tip
    levels = [(each, flexlink_links.run(task, "gauss", SAME_STEPS | {"hinges": each}).tip) for each in GAUSS]
    witness = WITNESSES.get(task.name, RADAU)
    there = exported_chains.run(task, witness.element, witness.setting)
    (here,) = (tip for hinges, tip in levels if hinges == witness.setting["hinges"])
    limit = extrapolated(levels).tip
    found = {
        "coarser_m": largest_distance(finest, flexlink_links.run(task, "lobatto4", COARSE).tip),
        "other_rule_m": largest_distance(finest, limit),
        "witness_m": largest_distance(here, there.tip),
    }
    settings = {"finest": FINE, "coarser": COARSE, "hinges of gauss": GAUSS, "witness": witness._asdict()}
    return finest, {"own_error_m": max(found.values()), **found}, settings


class Witness(NamedTuple):
    """Another program with its solver and settings, on a chain of gauss that flexlink also runs."""

    element: str
    setting: dict[str, float]


FINE, COARSE, GAUSS = {"hinges": 24, "tolerance": 1e-8}, {"hinges": 12, "tolerance": 1e-8}, (8, 16)
SAME_STEPS = {"tolerance": 1e-8}
RADAU = Witness("pinocchio Radau", {"hinges": 16, "tolerance": 1e-7, "most": 1e7})
WITNESSES = {
    "paper_arm": Witness("mujoco RK4", {"hinges": 16, "step": 1e-5})  # undamped: explicit steps are cheaper
}
Computed = Callable[[Task], tuple[Array, dict[str, float], dict[str, Any]]]
COMPUTED: dict[str, Computed] = {"soft_two_links": _two_links, "l_arm": _l_arm} | dict.fromkeys(
    ("crane", "ur5_soft", "spatial_arm", "paper_arm", "dual_arm"), _chain
)
"""Name of a reference → its tip, errors and settings."""


if __name__ == "__main__":
    sys.exit(main())
