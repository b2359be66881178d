"""Read benchmarks: `cases/NAME.toml` has the arm, its parts, and where their exact values are in `references/`."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.resources import files
from typing import Any

import numpy as np

from flexarm_bench.case import Array, BenchError, Case, Link, Pulse, SpinUp

ROOM = files("flexarm_bench")
ERRORS = {
    "statics": "|u − u_ref| / |u_ref|, u the displacement of the tip",
    "buckling": "|load / load_ref − 1|",
    "frequencies": "largest |f / f_ref − 1| of the modes asked for",
    "motion": "largest distance of the tip from the reference, at all times [m]",
}
"""Definition of the error of an answer."""


@dataclass(frozen=True)
class Reference:
    """Where the exact values of a part are, and how an answer follows from them.

    The entry at the keys `at` of the part `reference` of a file; of it the entries `take`, or the columns of a table,
    or the first numbers of a list. The answer is `offset` + `scale` × values ** `power`.
    """

    file: str
    at: tuple[str, ...] = ()
    take: tuple[str | int, ...] = ()
    scale: tuple[float, ...] = (1.0,)
    offset: tuple[float, ...] = (0.0,)
    power: int = 1

    @property
    def document(self) -> Any:
        """The whole file."""
        return _document(self.file)

    def values(self, case: Case) -> Array:
        """The exact answer."""
        found = functools.reduce(lambda entry, key: entry[key], self.at, self.document["reference"])
        if case.ask == "motion":
            return self._scaled(np.array(found, dtype=float)[:, np.array(self.take, dtype=int)])
        if self.take:
            found = [found[key] for key in self.take]
        listed = found if isinstance(found, list) else [found]
        size = min(case.shape[0], len(listed))
        values = self._scaled(np.array(listed[:size], dtype=float))
        return np.concatenate([values, np.zeros(case.shape[0] - size)])

    def _scaled(self, values: Array) -> Array:
        return np.array(self.offset) + np.array(self.scale) * values**self.power


@dataclass(frozen=True)
class Benchmark:
    """A published problem: its parts as cases, the accepted error with its reason, and where the problem comes from."""

    name: str
    title: str
    about: str
    source: str
    accepted: float
    reason: str
    parts: tuple[tuple[Case, Reference], ...]

    @property
    def ask(self) -> str:
        """What is to be computed."""
        return self.parts[0][0].ask

    @property
    def error(self) -> str:
        """Definition of the error."""
        return ERRORS[self.ask]


@functools.cache
def _document(name: str) -> Any:
    return json.loads(ROOM.joinpath("references", f"{name}.json").read_text(encoding="utf-8"))


@functools.cache
def _all() -> tuple[Benchmark, ...]:
    names = sorted(path.name for path in ROOM.joinpath("cases").iterdir() if path.name.endswith(".toml"))
    return tuple(_read(name.removesuffix(".toml")) for name in names)


def load_benchmarks(*wanted: str) -> list[Benchmark]:
    """Benchmarks by name, glob, or what they ask for; by default all.

    Raises
    ------
    BenchError
        One of `wanted` matches none.
    """
    every = _all()
    for pattern in wanted:
        if not any(_is_meant(each, pattern) for each in every):
            raise BenchError(f"case = {pattern!r}: no such case; available: {', '.join(each.name for each in every)}")
    return [each for each in every if not wanted or any(_is_meant(each, pattern) for pattern in wanted)]


def _is_meant(benchmark: Benchmark, pattern: str) -> bool:
    return fnmatchcase(benchmark.name, pattern) or benchmark.ask == pattern


def _read(name: str) -> Benchmark:
    raw = tomllib.loads(ROOM.joinpath("cases", f"{name}.toml").read_text(encoding="utf-8"))
    heads = {key: raw.pop(key) for key in ("title", "about", "source", "accepted", "reason")}
    parts = raw.pop("part")
    return Benchmark(name, **heads, parts=tuple(_part(name, raw, part) for part in parts))


def _part(name: str, common: Mapping[str, Any], part: dict[str, Any]) -> tuple[Case, Reference]:
    own = dict(part)
    reference, change = own.pop("reference"), own.pop("change", {})
    values = {key: value for key, value in common.items() if key not in {"link", "samples"}} | own
    links = tuple(_link(raw | change.get(raw["name"], {})) for raw in common["link"])
    if "samples" in common:
        interval, count = common["samples"]
        values["times"] = tuple(float(interval * k) for k in range(count + 1))
    for key, kind in (("torque", Pulse), ("motion", SpinUp)):
        if key in values:
            values[key] = kind(**values[key])
    case = Case(name=name, part=values.pop("name", ""), links=links, **_frozen(values))
    return case, Reference(**_frozen(reference))


def _link(raw: Mapping[str, Any]) -> Link:
    values = dict(raw)
    if "angle_deg" in values:
        values["angle"] = math.radians(values.pop("angle_deg"))
    return Link(**values)


def _frozen(values: Mapping[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}


def described(values: object, leave_out: Iterable[str] = ()) -> Sequence[tuple[str, Any]]:
    """Names and values of all fields that differ from their defaults."""
    fields = [each for each in dataclasses.fields(values) if each.name not in set(leave_out)]  # type: ignore[arg-type]
    pairs = [(each.name, getattr(values, each.name), each.default) for each in fields]
    return [(name, value) for name, value, default in pairs if value != default]
