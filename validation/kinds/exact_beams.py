"""Motions of chains against geometrically exact beams in Exudyn, and Exudyn's beams against other references.

The chain is lumped with two resolutions. The distance between the two tips bounds the error of the coarser chain and,
generously, of the finer one, which is compared with the reference. The error of the reference (own error) is estimated
from its mesh, step, stiffnesses and residual:

    distance to the reference / (own error + |coarse − fine|) ≤ 1
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.physics.beam_references import beam_reference, beam_scene, file_name, plane_of
from validation.physics.variant import Rule
from validation.reference_values import look_up, reference_array
from validation.runs import stable_steps
from validation.store import Series

LONG = True


def run(
    case: Case, coarse: Rule, fine: Rule, of_stable: Positive = 0.5, others: dict[str, str] | None = None
) -> Iterator[Measured | Series]:
    """Yield tip distances, absolute and in units of the allowed error.

    `coarse` and `fine` lump the chain, `of_stable` is the step as a fraction of the largest stable one, and `others`
    names a second reference for some scenes.
    """
    for name in case.scenes:
        scene, (exact, own) = beam_scene(name), beam_reference(name)
        tip, coarser = (_tip(scene, cut, of_stable) for cut in (fine, coarse))
        distance, between = largest_distance(tip, exact), largest_distance(coarser, tip)
        yield Measured("tip apart", distance, name, varied=fine.facts)
        yield Measured("tip apart / allowed", distance / (own + between), name, varied=fine.facts)
        yield Measured("coarser chain apart", between, name, varied=coarse.facts)
        yield Measured("reference, its own error", own, name, "exudyn")
        if others and name in others:
            other = reference_array(others[name], "values")
            plane = exact @ plane_of(scene).axes
            yield Measured("references apart / own error", largest_distance(plane[:, :2], other) / own, name, "exudyn")
        if "shear_and_stretch_m" in look_up(file_name(name)):
            yield Measured("shear and stretch", float(look_up(file_name(name), "shear_and_stretch_m")), name, "exudyn")
        yield _series(scene, exact, tip)


def _tip(scene: Scene, cut: Rule, of_stable: float) -> Array:
    """Tip of the chain, with a step that divides the time between samples."""
    scene = scene.varied({"link.*.lumping": cut.rule, "link.*.segments": cut.hinges + 1})
    return fl.simulate(scene, step=scene.run.spacing / stable_steps(scene, scene.run.method, of_stable)).tip


def _series(scene: Scene, exact: Array, fine: Array) -> Series:
    columns = {"time [s]": scene.run.times, "flexlink": np.linalg.norm(fine - exact, axis=1)}
    title = f"{scene.name}: distance of the chain's tip from that of Exudyn's beams"
    return Series("beams", title, columns, "time [s]", "time [s]", "distance [m]", scene=scene.name)
