"""Scenes of the study of cost against accuracy, their references, and the two errors that it measures.

The error of a run is the tip's largest distance from the reference at the outputs, divided by the reference tip's
largest distance from its initial position: 1e-2 is a hundredth of the motion. The deflection is the vector by which the
hinges displace the tip; its error is relative to the reference's largest deflection.
"""

from __future__ import annotations

import functools
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.data import documents
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.describe.spec import Spec, decode
from flexlink.dynamics.placement import tip_position, unbent
from flexlink.results.tip_motion import largest_distance, tip_travel
from validation.case import STUDY_SCENES, scene_file
from validation.physics.formulas import INPUTS
from validation.reference_values import reference_array
from validation.trade.first_order import FirstOrder
from validation.trade.work_precision import Point

FILE = STUDY_SCENES / "trade" / "scenes.toml"
OUTPUTS = 20  # number of outputs of every run, after the initial state
PROBED = 1e-7  # relative tolerance, above the cancellation errors of a stiff chain and below any real change


class Varied(Spec, frozen=True):
    """A scene defined by its differences from another one; `change` is the argument of `Scene.varied`."""

    about: str
    base: str
    change: dict[str, Any] = msgspec.field(default_factory=dict)
    input: Literal["none", "torque_pulse", "torques_of_motion"] = "none"


@functools.cache
def scenes() -> dict[str, Varied]:
    """Definitions in the file, by name of the scene."""
    return {name: decode(raw, Varied, name) for name, raw in documents.read_toml(FILE).items()}


@functools.cache
def trade_scene(name: str) -> Scene:
    """A scene of the trade study, sampled at its outputs.

    Raises
    ------
    ArgumentError
        No such scene exists.
    SceneError
        Its definition in the file is not a valid scene.
    """
    scene = varied_scene(require_one_of("scene", name, scenes()), name)
    every = scene.run.duration / OUTPUTS
    return scene.varied({"run.step": every, "run.sample": every})


def varied_scene(varied: Varied, name: str) -> Scene:
    """A scene of this name with changes to its base, which is a scene of the trade study or a file."""
    return INPUTS[varied.input](_varied(varied, name))


def _varied(varied: Varied, name: str) -> Scene:
    base = (
        _varied(scenes()[varied.base], varied.base) if varied.base in scenes() else load_scene(scene_file(varied.base))
    )
    return base.varied(varied.change | {"name": name, "about": varied.about})


def probe(scene: Scene) -> Array:
    """Fingerprint of a scene: q̇ and q̈ along a fixed direction, at and near the initial state, at two times."""
    f, random = FirstOrder(scene), np.random.default_rng(0)
    direction, aside = random.normal(size=(2, len(f.start)))
    later = scene.run.duration / 3
    states = (0.0, f.start), (later, f.start), (later, f.start + 0.01 * aside)
    return np.array([*(f(t, y) @ direction for t, y in states), scene.run.duration])


def is_of(scene: Scene, name: str) -> bool:
    """Whether the stored reference belongs to this scene, up to rounding."""
    return np.allclose(reference_array(reference_name(name), "probe"), probe(scene), rtol=PROBED, atol=0.0)


def reference_name(name: str) -> str:
    """Name of the file in `validation/reference/`."""
    return f"trade/{name}"


class Seen(NamedTuple):
    """Outputs of a run in frame 0 [m], including the initial state; nan after a failure.

    `bend` is the deflection: the tip minus the tip of the same arm with its springs at rest.
    """

    tip: Array  # (OUTPUTS + 1, 3)
    bend: Array  # (OUTPUTS + 1, 3)


def seen(chain: Chain, q: Array) -> Seen:
    """Tip and deflection for angles at the outputs, shape (OUTPUTS + 1, n)."""
    tip, there = np.full((2, len(q), 3), np.nan)
    good = np.isfinite(q).all(axis=1)
    tip[good], there[good] = tip_position(chain, q[good]), tip_position(chain, unbent(chain, q[good]))
    return Seen(tip, tip - there)


@functools.cache
def reference(name: str) -> Seen:
    """The stored reference, on which two methods agree."""
    return Seen(*(reference_array(reference_name(name), part) for part in Seen._fields))


def errors(name: str, found: Seen) -> tuple[float, float]:
    """Error of the tip relative to its motion, and of the deflection relative to the largest one; inf if a run fails.

    For a rigid arm the deflection and its error are zero.
    """
    exact = reference(name)
    sizes = tip_travel(exact.tip), float(np.linalg.norm(exact.bend, axis=1).max())
    parts = (
        largest_distance(ours, theirs) / (size or 1.0) for ours, theirs, size in zip(found, exact, sizes, strict=True)
    )
    of_tip, of_bend = (part if np.isfinite(part) else np.inf for part in parts)
    return of_tip, of_bend


def point(name: str, found: Seen, setting: float, seconds: float, evaluations: int) -> Point:
    """A point of a work-precision diagram: a run with its errors."""
    of_tip, of_bend = errors(name, found)
    return Point(setting, of_tip, seconds, of_bend, evaluations)
