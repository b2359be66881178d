"""Gyroscopes between the ends of a flexible link read the rotation of their rigid segment, with an error of order h.

The rotation of segment i is that of the beam at b_i = Σ w_j over the hinges before it, w_j the weights of the lumping
rule; at x = s L it differs by the share (s − b_i) / (b_{i+1} − b_i) of the change to the next segment. Twice the hinges
may leave this share of a segment's length as it is, so that refinement alone does not show the error.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from msgspec.structs import replace

from flexlink.common.types import Array
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.sensor import Sensor, column_names
from flexlink.identification.data import Source
from flexlink.identification.inputs import gauss_newton
from flexlink.identification.solve import Found, Search


def errors_of_inner_gyroscopes(search: Search, best: Found) -> list[Array]:
    """Changes of the coordinates by the error of each inner gyroscope whose column is fitted, shape (p,) each.

    Raises
    ------
    FlexlinkError
        The simulation fails.
    """
    sources, found = search.signals.sources, []
    names = {name for source in sources for sensor in _inner(source) for name in [sensor.name]}
    before = gauss_newton(search, best, sources) if names else np.zeros(len(best.x))
    for name in sorted(names):
        moved, share = list(sources), 0.0
        for k, source in enumerate(sources):
            for sensor in _inner(source):
                if sensor.name == name:
                    x, share = _neighbour(source.scene, sensor)
                    others = tuple(replace(one, x=x) if one.name == name else one for one in source.scene.sensor)
                    moved[k] = dataclasses.replace(source, scene=replace(source.scene, sensor=others))
        found.append(share * (gauss_newton(search, best, moved) - before))
    return found


def _inner(source: Source) -> list[Sensor]:
    """Gyroscopes between the ends of flexible links, whose columns are compared."""
    if not source.is_run:
        return []
    arm, compared = source.scene.arm, {block.name for block in source.blocks}
    return [
        one for one in source.scene.sensor
        if one.kind == "gyroscope" and one.x is not None and isinstance(one.link, str | int)
        and compared & {*column_names((one,), arm)} and _bends_at(_link(source.scene, one), one.x)
    ]  # fmt: skip


def _bends_at(link: Link, x: float) -> bool:
    return link.flex != "rigid" and 0 < x < link.beam.length * (1 - 1e-9)


def _link(scene: Scene, sensor: Sensor) -> Link:
    return scene.arm.links[scene.arm.number(sensor.link) - 1]


def _neighbour(scene: Scene, sensor: Sensor) -> tuple[float, float]:
    """Position in the segment next to a gyroscope, and the share of the change to it that is the gyroscope's error."""
    link = _link(scene, sensor)
    assert sensor.x is not None
    nodes, weights = lumping_rule(link.lumping).hinges(link.segments - 1)
    s, ends = sensor.x / link.beam.length, np.concatenate([[0.0], nodes, [1.0]])
    b = np.concatenate([[0.0], np.cumsum(weights)])
    i = int(np.searchsorted(ends, s, side="right")) - 1
    other = i + 1 if (s > b[i] and i + 1 < len(b)) or i == 0 else i - 1
    share = abs(s - b[i]) / abs(b[other] - b[i])
    return float((ends[other] + ends[other + 1]) / 2 * link.beam.length), float(share)
