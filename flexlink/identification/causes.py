"""Physical causes of what a model leaves unexplained: each is one more unknown of the scene, a row of `causes.toml`."""

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

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


class Cause(NamedTuple):
    """One more unknown of the model: of the scene, or of the times of a run."""

    name: str  # in messages; "" for times
    unknown: Coordinate
    sources: Sequence[Source]  # the measurements, with scenes that contain the unknown
    tried: tuple[float, ...]  # values to try
    stated: bool = True  # whether the scene states a value, with which a search begins


def causes(signals: Signals, x: Array) -> Iterator[Cause]:
    """Physical causes that apply to the scenes at a point and that the problem neither estimates nor sets per run."""
    scenes, seen = [signals.scene(k, at) for at in (x, x + STEP) for k in range(len(signals.sources))], set[str]()
    for row, link in itertools.product(_rows(), scenes[0].arm.links):
        if {"joint": not link.joint.locked, "beam": link.flex != "rigid", "arm": True}[row["of"]]:
            try:
                one = _cause(row, link, scenes, signals.sources)
            except FlexlinkError:  # the path does not exist on this arm
                continue
            if one is not None and one.unknown.path not in seen:
                seen.add(one.unknown.path)
                yield one


def _cause(row: dict[str, Any], link: Link, scenes: Sequence[Scene], sources: Sequence[Source]) -> Cause | None:
    """A cause on a link; None if the link lacks what it changes, or if the scenes differ in its value."""
    arm, added, taper = scenes[0].arm, dict[str, Any](), f"{link.section}_tip"
    section = arm.sections.get(link.section or "")
    on = {"link": arm.path(arm.number(link.name)), "material": link.material}
    if "{taper}" in row["path"]:
        if section is None or section.shape not in BREADTHS or link.section_tip is not None:
            return None
        added = {f"section.{taper}": without_defaults(section), f"{on['link']}.section_tip": taper}
        on["taper"] = f"{taper}.{BREADTHS[section.shape][1]}"
    path, lengthens = row["path"].format(**on), row["path"].endswith(".length")

    def prepared(scene: Scene) -> Scene:
        at_end = [one for one in scene.sensor if one.x == link.length and arm.number(one.link) == arm.number(link.name)]
        moved = {f'sensor."{one.name}".x': None for one in at_end if lengthens}  # sensors at the end remain there
        return scene.varied(added | moved) if added or moved else scene

    whole = [prepared(scene) for scene in scenes]
    now, *others = {scene.values_at(path)[0] for scene in whole}
    tried = tuple(by * now for by in row.get("factors", (0.8, 1.25))) if now else tuple(row.get("tried", ()))
    if others or not tried:
        return None
    unknown = coordinate_of(whole[0], FitParameter(path=path, start=now or tried[0], scale="log"))
    own = [dataclasses.replace(one, scene=prepared(one.scene)) for one in sources]
    return Cause(row["name"].format(link=link.name, material=link.material), unknown, own, tried, bool(now))


@functools.cache
def _rows() -> list[dict[str, Any]]:
    return list(read_toml(Path(__file__).parent / "causes.toml")["cause"])
