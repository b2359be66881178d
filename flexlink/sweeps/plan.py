"""A sweep as data: a scene, what is set, what varies, what is wanted; strict TOML in, members by number out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from flexlink.common.errors import DataFileError, SceneError
from flexlink.describe import data_files
from flexlink.describe.scene import FIELDS, Scene, load_scene
from flexlink.describe.spec import Spec, check_keys, decode, did_you_mean, fields_of, truncated
from flexlink.describe.vary import apply_changes
from flexlink.engines import ENGINES
from flexlink.sweeps.measures import SweepOutput
from flexlink.sweeps.ranges import MOST, Axis, RandomDesign, grid_axis, sample_axis, together_axis

ENGINE = "engine"
"""The one key that is not the scene's: which engine integrates."""

RESERVED = ("number", "status", "reason", "warnings")
"""Columns of all rows."""

SLOW = ("engine", "run", "drive", "motion", "wrench"), ("flex", "segments", "lumping", "locked", "axis")
"""Beginnings and ends of keys in which members that run side by side are alike: they vary slowest."""


class Sweep(Spec, frozen=True):
    """Variants of one scene, and what is wanted of each.

    All keys are paths of `Scene.varied`, or "engine". `set` holds for all members. Every combination of the axes is a
    member: each key of `grid` is an axis, all keys of `together` are one, number by number, and `sample` is one.
    `quantity` names the numbers that are kept of each run.
    """

    scene: Scene
    quantity: dict[str, SweepOutput]
    about: str = ""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    grid: dict[str, Any] = msgspec.field(default_factory=dict)
    together: dict[str, Any] = msgspec.field(default_factory=dict)
    sample: RandomDesign | None = None

    def __repr__(self) -> str:
        return f"<Sweep of {self.scene.name!r}: {', '.join(self.keys)} → {', '.join(self.quantity)}>"

    @property
    def keys(self) -> tuple[str, ...]:
        """What varies, in the order of the file."""
        return (*self.grid, *self.together, *(self.sample.keys if self.sample else ()))


class Plan:
    """The members of a sweep, by number.

    Attributes
    ----------
    sweep
        What is planned.
    members
        How many there are.

    Raises
    ------
    SceneError
        An axis is empty or has a value that it does not take, a key varies twice, or two columns have one name.
    """

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        axes = [grid_axis(key, said) for key, said in sweep.grid.items()]
        axes += [together_axis(sweep.together)] if sweep.together else []
        axes += [sample_axis(sweep.sample)] if sweep.sample else []
        self.axes = sorted(axes, key=lambda axis: not _is_slow(axis))
        self.members = math.prod(axis.count for axis in axes)
        self._check()

    def values(self, number: int) -> dict[str, Any]:
        """What varies of a member, by key; the last axis changes fastest."""
        found: dict[str, Any] = {}
        for axis in reversed(self.axes):
            number, place = divmod(number, axis.count)
            found |= zip(axis.keys, axis.at(place), strict=True)
        return {key: found[key] for key in self.sweep.keys}

    def member(self, number: int) -> tuple[Scene, str]:
        """The scene of a member, and its engine; errors as in `Scene.varied`."""
        changes = {**self.sweep.set, **self.values(number)}
        engine = changes.pop(ENGINE, "native")
        if engine not in ENGINES:
            allowed = ", ".join(ENGINES) + did_you_mean(engine, ENGINES)
            raise SceneError(f"engine = {truncated(engine)}: unknown; allowed are {allowed}")
        return (self.sweep.scene.varied(changes) if changes else self.sweep.scene), engine

    @property
    def engines(self) -> set[str]:
        """Engines that members may name."""
        sweep = self.sweep
        drawn = sweep.sample.keys if sweep.sample else {}
        said = [table[ENGINE] for table in (sweep.grid, sweep.together, drawn) if isinstance(table.get(ENGINE), list)]
        return {str(name) for names in [*said, [sweep.set.get(ENGINE, "native")]] for name in names}

    def check_paths(self) -> None:
        """Know before the work that every key leads somewhere in the scene; whether a value fits is a member's matter.

        Raises
        ------
        SceneError
            A path leads nowhere; the message names what is allowed there.
        """
        changes = {**self.sweep.set, **self.values(0)}
        changes.pop(ENGINE, None)
        apply_changes(self.sweep.scene.document(), FIELDS, changes)

    def _check(self) -> None:
        keys, wanted = self.sweep.keys, tuple(self.sweep.quantity)
        if not wanted:
            raise SceneError("quantity: empty; name at least one number that is wanted of each run")
        twice = [key for key, count in Counter(keys).items() if count > 1]
        if twice:
            raise SceneError(f"{twice[0]}: varies twice; name it in one of grid, together and sample")
        columns = Counter(name.casefold() for name in (*RESERVED, *keys, *wanted))
        for name in (*keys, *wanted):
            if columns[name.casefold()] > 1:
                raise SceneError(
                    f"{name}: would name two columns of the rows, which small letters and capitals are not"
                )
            if not name or not name.isprintable():
                raise SceneError(f"{truncated(name)}: cannot be the name of a column")
        if self.members > MOST:
            raise SceneError(f"{self.members} members: a sweep has at most {MOST}")


def load_sweep(path: str | Path) -> Sweep:
    """Read a sweep file.

    Parameters
    ----------
    path
        A TOML file: `scene`, a path from the file's own folder, then tables `set`, `grid`, `together`, `sample` and
        `quantity`. Keys may be written as tables, `run.duration = 1.0`, or in quotes, `"run.duration" = 1.0`.

    Returns
    -------
    Sweep
        As the file says.

    Raises
    ------
    ArgumentError
        `path` is no path.
    SceneError
        The message names the file, the key path, the value and what is allowed.
    DataFileError
        The file of a rule or method that the scene names is not valid.
    """
    path = data_files.require_path("path", path)
    raw = data_files.read_toml(path)
    try:
        fields = {field.encode_name: field for field in fields_of(Sweep)}
        check_keys(raw, fields, required=("scene", "quantity"))
        if not isinstance(raw["scene"], str):
            raise SceneError(f"scene = {truncated(raw['scene'])}: expected the path of a scene file")
        folder = path.parent
        for table, leaf in (("set", ()), ("grid", ("between",)), ("together", ("between",))):
            if isinstance(raw.get(table), dict):
                raw[table] = _beside(folder, dict(_paths(raw[table], leaf)))
        sample = raw.get("sample")
        if isinstance(sample, dict) and isinstance(sample.get("keys"), dict):
            sample["keys"] = _beside(folder, dict(_paths(sample["keys"], ("between", "mean", "deviation"))))
        scene = load_scene(folder / raw.pop("scene"))
        sweep = Sweep(scene=scene, **{key: decode(value, fields[key].type, key) for key, value in raw.items()})
        Plan(sweep)
        return sweep
    except (SceneError, DataFileError) as error:
        raise type(error)(f"{path}: {error}") from None


def _paths(table: Mapping[str, Any], leaf: tuple[str, ...], above: str = "") -> Iterator[tuple[str, Any]]:
    """Keys that TOML has taken apart at their dots, as paths again; a table with one of `leaf` is a value."""
    for key, value in table.items():
        if isinstance(value, dict) and value and not any(name in value for name in leaf):
            yield from _paths(value, leaf, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _beside(folder: Path, values: dict[str, Any]) -> dict[str, Any]:
    """Own files of methods, rules and shapers are named from the folder of the sweep."""
    return {
        key: _absolute(value, folder) if key.rpartition(".")[2] in {"method", "lumping", "kind"} else value
        for key, value in values.items()
    }


def _absolute(value: Any, folder: Path) -> Any:
    if isinstance(value, list):
        return [_absolute(item, folder) for item in value]
    return data_files.absolute(value, folder) if isinstance(value, str) else value


def _is_slow(axis: Axis) -> bool:
    first, last = SLOW
    return any(key.split(".")[0] in first or key.split(".")[-1] in last for key in axis.keys)
