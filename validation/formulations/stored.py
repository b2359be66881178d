"""python -m validation.formulations.stored [NAME …]: compute and store reference motions of the tip.

soft_two_links  inextensible rods by Galerkin's method, which share no code with a formulation; the own error is the
                distance from a run with fewer polynomials
l_arm           no closed form exists: the finest chain of coupled cells; the own error is its distance from a chain
                with half the hinges. Exudyn's geometrically exact beams, which share no code with it, confirm it: their
                distance is stored, with the distance between Exudyn's two finest meshes. Needs exudyn.

Each takes some minutes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from flexlink.common.types import Array
from flexlink.results.tip_motion import largest_distance
from validation.formulations import flexlink_links
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
        task = task_of(name, Described(scene=name, reference=""))
        tip, found, settings = COMPUTED[name](task)
        store_reference(
            name, f"Tip of {name!r} in frame 0. {task.scene.about}", "python -m validation.formulations.stored",
            time.process_time() - began, settings=settings,
            reference={**found, "t_s": task.times.tolist(), "tip": tip.tolist()},
        )  # fmt: skip
        print(f"{name}: " + ", ".join(f"{key} {value:.1e}" for key, value in found.items()), flush=True)
    return 0


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
    from validation.formulations import exudyn_space  # noqa: PLC0415  only this reference needs exudyn

    finest = flexlink_links.run(task, "lobatto4", FINEST).tip
    witness = exudyn_space.run(task, "", WITNESS).tip
    coarser = exudyn_space.run(task, "", COARSER_WITNESS).tip
    found = {
        "own_error_m": largest_distance(finest, flexlink_links.run(task, "lobatto4", COARSER).tip),
        "witness_m": largest_distance(finest, witness),
        "witness_refined_m": largest_distance(witness, coarser),
    }
    names = ("finest", FINEST), ("coarser", COARSER), ("witness", WITNESS), ("coarser witness", COARSER_WITNESS)
    return finest, found, dict(names)


COMPUTED: dict[str, Callable[[Task], tuple[Array, dict[str, float], dict[str, Any]]]] = {
    "soft_two_links": _two_links, "l_arm": _l_arm,
}  # fmt: skip
"""Name of a scene and its reference → its tip, errors and settings."""


if __name__ == "__main__":
    sys.exit(main())
