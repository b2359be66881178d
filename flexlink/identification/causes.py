"""Physical causes of what a model leaves unexplained: each is one more unknown of the scene, a row of `causes.toml`."""

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.data.documents import read_toml
from flexlink.describe.link import Link
from flexlink.describe.material import BREADTHS
from flexlink.describe.scene import Scene
from flexlink.describe.writing import without_defaults
from flexlink.identification.coordinates import Coordinate, coordinate_of
from flexlink.identification.data import Source
from flexlink.identification.problem import FitParameter
from flexlink.identification.signals import STEP, Signals


class Row(NamedTuple):
    """A row of `causes.toml`."""

    name: str
    path: str
    of: str
    tried: tuple[float, ...] = ()


class Cause(NamedTuple):
    """One more unknown of the model: of the scene, or of the times of a run."""

    name: str  # in messages; "" for times
    unknown: Coordinate
    sources: Sequence[Source]  # the measurements, with scenes that contain the unknown
    tried: tuple[float, ...]  # values to try


def causes(signals: Signals, x: Array) -> Iterator[Cause]:
    """Physical causes that apply to the scenes at a point and that the problem neither estimates nor sets per run."""
    every = range(len(signals.sources))
    scenes = [signals.scene(k, point) for point in (x, x + STEP) for k in every]
    seen = set[str]()
    for row in _rows():
        for number, link in enumerate(scenes[0].arm.links, 1):
            path, added = _placed(row, scenes[0], link, number)
            if path and path not in seen:
                seen.add(path)
                yield from _cause(row, link, path, added, scenes, signals.sources)


def _placed(row: Row, scene: Scene, link: Link, number: int) -> tuple[str, dict[str, object]]:
    """Path of a cause on a link, "" if it does not apply, and what the scene needs before the path can be set."""
    applies = {"joint": not link.joint.locked, "beam": link.flex != "rigid", "arm": True}[row.of]
    if not applies or ("{material}" in row.path and link.material is None):
        return "", {}
    if "{taper}" not in row.path:
        return row.path.format(link=scene.arm.path(number), material=link.material), {}
    section = scene.arm.sections.get(link.section or "")
    if section is None or section.shape not in BREADTHS or link.section_tip is not None:
        return "", {}
    added = {f"section.{link.section}_tip": without_defaults(section),
             f"{scene.arm.path(number)}.section_tip": f"{link.section}_tip"}  # fmt: skip
    return f"section.{link.section}_tip.{BREADTHS[section.shape][1]}", added


def _cause(
    row: Row, link: Link, path: str, added: dict[str, object], scenes: Sequence[Scene], sources: Sequence[Source]
) -> Iterator[Cause]:
    try:
        whole = [scene.varied(added) if added else scene for scene in scenes]
        present = {scene.values_at(path)[0] for scene in whole}
        now = present.pop()
        tried = (0.8 * now, 1.25 * now) if now else tuple(row.tried)
        if present or not tried:
            return
        unknown = coordinate_of(whole[0], FitParameter(path=path, start=tried[0], scale="log"))
    except FlexlinkError:  # the path does not exist on this arm
        return
    own = [dataclasses.replace(one, scene=one.scene.varied(added)) if added else one for one in sources]
    yield Cause(row.name.format(link=link.name, material=link.material), unknown, own, tried)


@functools.cache
def _rows() -> tuple[Row, ...]:
    return tuple(Row(**one) for one in read_toml(Path(__file__).parent / "causes.toml")["cause"])
