"""A sweep as data, read from TOML (a scene, fixed and varied values, outputs), and its plan of numbered members."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from flexlink.common.errors import ArgumentError, FlexlinkError, SceneError, errors_at
from flexlink.common.versions import __version__
from flexlink.common.wording import did_you_mean, truncated
from flexlink.data import documents
from flexlink.data.documents import is_user_file
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import scene_named
from flexlink.describe.spec import Spec, decode
from flexlink.describe.variants import Variants
from flexlink.describe.vary import top_level_keys
from flexlink.engines import ENGINES
from flexlink.sweeps.measures import SweepOutput
from flexlink.sweeps.ranges import MAX_MEMBERS, Axis, RandomDesign, grid_axis, sample_axis, together_axis
from flexlink.sweeps.statistics import Statistics

ROW_COLUMNS = ("number", "status", "reason", "warnings")
"""First columns of every table; the varied keys and the outputs follow."""


class Sweep(Spec, frozen=True):
    """Variants of one scene, and the outputs of each run.

    All keys are paths of `Scene.varied`, or "engine". `set` applies to all members. Every combination of the axes is a
    member: each key of `grid` is one axis, all keys of `together` form one axis whose values are paired, and `sample`
    is one axis. `quantity` defines the outputs of each run.

    Examples
    --------
    >>> plan = fl.Sweep(
    ...     scene=scene,
    ...     set={"run.duration": 0.1},
    ...     grid={"tip.mass": {"between": [1.0, 5.0], "count": 3}},
    ...     quantity={"bend [m]": {"of": "deflection [m]", "take": "max"}},
    ... )
    >>> rows = fl.sweep(plan)
    >>> print(rows.column("tip.mass"), [f"{1e3 * bend:.1f} mm" for bend in rows.column("bend [m]")])
    [1.0, 3.0, 5.0] ['9.6 mm', '21.2 mm', '28.7 mm']
    """

    scene: Scene
    """The scene to vary; in a file, its path relative to the file."""
    quantity: dict[str, SweepOutput]
    """Outputs of each run, by name."""
    about: str = ""
    """A sentence on the purpose of the sweep."""
    set: dict[str, Any] = msgspec.field(default_factory=dict)
    """Values for all members, by path."""
    grid: dict[str, Any] = msgspec.field(default_factory=dict)
    """A list or range of values by path; every combination is a member."""
    together: dict[str, Any] = msgspec.field(default_factory=dict)
    """A list or range of values by path; the k-th values of all lists belong together."""
    sample: RandomDesign | None = None
    """Random points."""
    statistics: Statistics | None = None
    """Statistics of the outputs over all members, in place of their rows."""

    def __repr__(self) -> str:
        return f"<Sweep of {self.scene.name!r}: {', '.join(self.keys)} → {', '.join(self.quantity)}>"

    @property
    def keys(self) -> tuple[str, ...]:
        """Varied keys, in the order of the file."""
        return (*self.grid, *self.together, *(self.sample.keys if self.sample else ()))

    @classmethod
    def load(cls, path: str | Path) -> Sweep:
        """Read a sweep file.

        Parameters
        ----------
        path
            A TOML file: `scene`, a path relative to the file, then tables `set`, `grid`, `together`, `sample` and
            `quantity`. Keys may be written as tables, `run.duration = 1.0`, or in quotes, `"run.duration" = 1.0`.

        Returns
        -------
        Sweep
            The sweep in the file.

        Raises
        ------
        ArgumentError
            `path` is not a path.
        SceneError
            The message names the file, the key path, the value and the allowed values.
        DataFileError
            The file of a lumping rule or method in the scene is not valid.

        Examples
        --------
        >>> plan = fl.Sweep.load("models/sweeps/payload.toml")
        >>> print(plan.scene.name, list(plan.quantity))
        paper_fig5 ['tip_z', 'bend', 'swing', 'error']
        """
        path = documents.require_path("path", path)
        raw = documents.read_toml(path)
        with errors_at(f"{path}: "):
            scene, types = scene_named(raw, path, cls, "a sweep plan")
            for table, leaf in (("set", ()), ("grid", ("between",)), ("together", ("between",))):
                if isinstance(raw.get(table), dict):
                    raw[table] = documents.with_absolute_paths(path.parent, dict(documents.paths_of(raw[table], leaf)))
            sample = raw.get("sample")
            if isinstance(sample, dict) and isinstance(sample.get("keys"), dict):
                files = dict(documents.paths_of(sample["keys"], ("between", "mean", "deviation")))
                sample["keys"] = documents.with_absolute_paths(path.parent, files)
            sweep = cls(scene=scene, **{key: decode(value, types[key], key) for key, value in raw.items()})
            Plan(sweep)
            return sweep


class Plan:
    """The members of a sweep, by number; empty axes, invalid values, and keys or columns given twice are refused."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        axes = [grid_axis(key, values) for key, values in sweep.grid.items()]
        axes += [together_axis(sweep.together)] if sweep.together else []
        axes += [sample_axis(sweep.sample)] if sweep.sample else []
        self.axes = sorted(axes, key=lambda axis: not _is_slow(axis))
        self.members = math.prod(axis.count for axis in axes)
        self._check()

    def numbers(self, part: str | None) -> range:
        """Numbers of the members of a part, such as "17/200"; of all members if it is None."""
        if part is None:
            return range(self.members)
        found = re.fullmatch(r"([1-9]\d{0,8})/([1-9]\d{0,8})", part) if isinstance(part, str) else None
        k, n = map(int, found.groups()) if found else (1, 0)
        if k > n:
            why = f"part = {truncated(part)}: expected 'K/N' with K from 1 to N, such as '17/200'"
            raise ArgumentError(why, id="wrong-value")
        return range((k - 1) * self.members // n, k * self.members // n)

    def values(self, number: int) -> dict[str, Any]:
        """Varied values of a member, by key; the last axis changes fastest."""
        values = {key: value for axis, k in self._at(number) for key, value in zip(axis.keys, axis.at(k), strict=True)}
        return {key: values[key] for key in self.sweep.keys}

    def places(self, number: int) -> dict[str, float]:
        """Where each value of a member is among all values of its key, 0 ≤ u < 1."""
        return {key: u for axis, k in self._at(number) for key, u in zip(axis.keys, axis.places(k), strict=True)}

    def _at(self, number: int) -> Iterator[tuple[Axis, int]]:
        for axis in reversed(self.axes):
            number, index = divmod(number, axis.count)
            yield axis, index

    def member(self, number: int) -> tuple[Scene, str]:
        """Scene and engine of a member."""
        changes = {**self._start[1], **self.values(number)}
        engine = changes.pop("engine", "native")
        if engine not in ENGINES:
            allowed = ", ".join(ENGINES) + did_you_mean(engine, ENGINES)
            raise SceneError(f"engine = {truncated(engine)}: unknown; allowed are {allowed}", id="unknown-name")
        return self._variants.varied(changes), engine

    @functools.cached_property
    def _variants(self) -> Variants:
        scene, fixed = self._start
        return Variants(scene, [path for path in (*fixed, *self.sweep.keys) if path != "engine"])

    @functools.cached_property
    def _start(self) -> tuple[Scene, dict[str, Any]]:
        """Scene that members vary, and the fixed values to set together with the varied values.

        Fixed values in tables without varied keys are set once. If the scene is then not valid, all fixed values are
        set together with the varied values.
        """
        scene, varied = self.sweep.scene, top_level_keys(dict.fromkeys(self.sweep.keys))
        fixed = dict(self.sweep.set)
        torques = any(output.of.startswith("tau ") for output in self.sweep.quantity.values())
        if torques and "run" not in fixed:  # torques contain vibrations that do not move the tip
            fixed = {"run.outputs": [*dict.fromkeys((*scene.run.outputs, "torques"))]} | fixed
        once = {path: value for path, value in fixed.items() if not top_level_keys({path: value}) & varied}
        once.pop("engine", None)
        beside = {path: value for path, value in fixed.items() if path not in once}
        try:
            return (scene.varied(once) if once else scene), beside
        except FlexlinkError:
            return scene, fixed

    @property
    def engines(self) -> set[str]:
        """Engines of the members."""
        sweep = self.sweep
        sampled = sweep.sample.keys if sweep.sample else {}
        lists = [table.get("engine") for table in (sweep.grid, sweep.together, sampled)]
        lists += [[sweep.set.get("engine", "native")]]
        return {str(name) for names in lists if isinstance(names, list) for name in names}

    def _check(self) -> None:
        keys, outputs = self.sweep.keys, tuple(self.sweep.quantity)
        if not outputs:
            raise SceneError("quantity: empty; name at least one output of each run", id="empty")
        twice = [key for key, count in Counter(keys).items() if count > 1]
        if twice:
            raise SceneError(f"{twice[0]}: varies twice; use only one of grid, together and sample", id="varied-twice")
        columns = Counter(name.casefold() for name in (*ROW_COLUMNS, *keys, *outputs))
        for name in (*keys, *outputs):
            if columns[name.casefold()] > 1:
                why = f"{name}: two columns would have this name (case is ignored); rename one"
                raise SceneError(why, id="column-twice")
            if not name or not name.isprintable():
                raise SceneError(f"{truncated(name)}: is not a column name; use printable characters", id="column-name")
        if self.members > MAX_MEMBERS:
            raise SceneError(f"{self.members} members: a sweep has at most {MAX_MEMBERS}", id="too-many-members")


def _is_slow(axis: Axis) -> bool:
    """Whether members with different values of these keys cannot run side by side; such an axis varies slowest."""
    tables, fields = {"engine", "run", "drive", "motion", "wrench"}, {"flex", "segments", "lumping", "locked", "axis"}
    return any(key.split(".")[0] in tables or key.split(".")[-1] in fields for key in axis.keys)


Fingerprint = dict[str, Any]


@functools.cache
def version() -> str:
    """Version of flexlink with a hash of its sources, since the sources can change without a new version."""
    folder = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.suffix in {".py", ".toml"}:
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return f"{__version__} (sources {digest.hexdigest()[:12]})"


def fingerprint(sweep: Sweep) -> Fingerprint:
    """Everything that the rows depend on, as JSON, without the descriptions `about`."""
    parts: dict[str, Any] = msgspec.to_builtins(sweep)
    parts.pop("about")
    parts["scene"].pop("about")
    files = {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in sorted(set(_own_files(parts)))}
    packages = ("numpy", "scipy", "numba")  # affect the last bit of a number, or the points of a sample
    versions = {"flexlink": version(), **{name: importlib.metadata.version(name) for name in packages}}
    return {**parts, "files": files, "versions": versions}


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Text with the first three differences between two fingerprints; empty if there are none."""
    changes = [f"{path} was {truncated(a)} and is {truncated(b)}" for path, a, b in _different(old, new)]
    return "; ".join(changes[:3]) + (f" and {len(changes) - 3} more" if len(changes) > 3 else "")


def _different(old: Any, new: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in {**old, **new}:
            yield from _different(old.get(key), new.get(key), f"{path}.{key}".lstrip("."))
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _different(a, b, f"{path}[{k}]")
    elif old != new:
        yield path, old, new


def _own_files(value: Any) -> Iterator[str]:
    """Existing files of methods and lumping rules that the sweep refers to."""
    if isinstance(value, Mapping | list | tuple):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _own_files(item)
    elif is_user_file(value) and Path(value).is_file():
        yield value
