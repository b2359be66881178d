"""Pages of keys: the keys of every file, from the types that the files are read into."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

from docs.generators.api import path_of
from docs.generators.rest import directive, heading, literal, prose
from docs.generators.sentences import sentences, units_in
from flexlink.describe import data_files
from flexlink.describe.arm import Arm
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import LumpingRule
from flexlink.describe.schemes.methods import Method
from flexlink.describe.shaping import ShaperRule
from flexlink.describe.spec import ONE_PER_LINK, default_of, fields_of
from flexlink.describe.writing import toml_of
from flexlink.identification.experiments import Experiments
from flexlink.identification.problem import FitProblem
from flexlink.robots.collection import KnownArm
from flexlink.robots.flexible import FlexibleLink
from flexlink.sweeps.plan import Sweep
from flexlink.sweeps.ranges import Range, Spread

Record = Any
"""A class of records; msgspec's metaclass hides that they are subtypes of `Struct`."""

PARTS = {
    "scene_arm": ("Keys of the arm", ("base", "link", "material", "rigidity", "section", "tip")),
    "scene_motion": ("Keys of initial state, drive, motion and load", ("drive", "initial", "motion", "wrench")),
    "scene_run": ("Keys of sensors, ties, stops and simulation", ("limits", "run", "sensor", "tie")),
}
"""Pages of a scene's tables: name of the page, its title, and the tables."""

NAMED_BY_FILES = {"lumping": "lumping", "method": "methods", "kind": "shapers"}
"""Keys of type str whose values are names of data files, with their folder in `flexlink/describe/data`."""


def scene_page(_: Path) -> str:
    """Return the keys of a scene."""
    intro = """\
All keys of a scene file, and of :class:`flexlink.Scene` in Python. Units are SI; angles are in degrees if the key
ends in ``_deg``, otherwise in radians. For prismatic joints use the key ending in ``_m``, in metres; their torques,
gains and friction are forces, N/m and so on. The options ``--set``, :meth:`flexlink.Scene.varied` and sweeps take the
same paths: ``--set link.upper.segments=9``. A link is given by its name or its number from 1; ``*`` means every link
on which the key has an effect. Components of a vector are x, y and z (``gravity.x``). Unknown keys, wrong types and
impossible values are refused with a message that names the key.
"""
    pages = directive("toctree", body="\n".join(PARTS), maxdepth="1")
    return _page("Keys of a scene", f"{intro}\n{pages}", [("", Scene)], lambda place: not place)


def scene_part(name: str, _: Path) -> str:
    """Return the keys of some tables of a scene."""
    title, tables = PARTS[name]
    intro = f"The tables {', '.join(map(literal, tables))} of a scene; :doc:`scene` lists all tables.\n"
    return _page(title, intro, [("", Scene)], lambda place: place.partition(".")[0] in tables)


def sweep_page(_: Path) -> str:
    """Return the keys of a sweep and of its ranges."""
    intro = """\
All keys of a sweep file, and of :class:`flexlink.Sweep` in Python; the prefix ``sweep.`` denotes the file. Keys under
``set``, ``grid``, ``together`` and ``sample.keys`` are paths of the scene, see :doc:`scene`, or ``engine``. Values in
``grid`` and ``together`` are lists or ranges; values in ``sample.keys`` are lists or spreads.
"""
    roots = [("sweep", Sweep), ("sweep.grid.KEY", Range), ("sweep.sample.keys.KEY", Spread)]
    return _page("Keys of a sweep", intro, roots)


def fit_page(_: Path) -> str:
    """Return the keys of a fit and of its measurements."""
    intro = """\
All keys of a fit problem's file, and of :class:`flexlink.fits.FitProblem` in Python; the prefix ``fit.`` denotes the
file. Keys under ``set`` and ``before`` are paths of the scene, see :doc:`scene`.
"""
    intro += """
A file of experiments for ``flexlink fit --propose --experiments`` has the keys of :class:`flexlink.fits.Experiments`;
the prefix ``experiments.`` denotes the file.
"""
    return _page("Keys of a fit", intro, [("fit", FitProblem), ("experiments", Experiments)])


def data_files_page(_: Path) -> str:
    """Return the keys of the data files that a user can add."""
    intro = """\
Rules, methods, shapers and robots are data files. Select your own file by its path, relative to the folder of the
file that uses it. The first word of a key below is the kind of file: ``rule.about`` is the key ``about`` of a rule's
file.
"""
    files = [
        ("rule", LumpingRule), ("method", Method), ("shaper", ShaperRule), ("robot", KnownArm),
        ("flexible", FlexibleLink),
    ]  # fmt: skip
    return _page("Keys of data files", intro, files)


def _page(
    title: str, intro: str, roots: list[tuple[str, Record]], wanted: Callable[[str], bool] = lambda _: True
) -> str:
    parts = [heading(title), intro]
    known: set[Record] = set()
    for path, record in roots:
        for place, kind in records(record, path, known):
            if not wanted(place):
                continue
            parts.append(heading(f"[{place}]" if place else "Top level", 1))
            parts.append(_summary(kind))
            parts += [_entry(place, field, sentence) for field, sentence in entries(kind)]
    return "\n".join(parts)


def _summary(kind: Record) -> str:
    first = inspect.getdoc(kind) or ""
    path = path_of(kind.__name__)
    shown = f"In Python :class:`{path}`. " if path else ""
    return f"{shown}{prose(first.split(chr(10) * 2)[0])}\n"


def records(kind: Record, path: str, known: set[Record]) -> Iterator[tuple[str, Record]]:
    """Yield a record and all records below it, each once, with the first path that leads to it."""
    if kind in known or kind is Arm:
        return
    known.add(kind)
    yield path, kind
    for field, _ in entries(kind):
        for below in _records_in(field.type):
            if below is not Scene:
                yield from records(below, _join(path, field.encode_name, field.type), known)


def entries(kind: Record) -> list[tuple[msgspec.structs.FieldInfo, str]]:
    """Return the fields of a record in file order, each with the sentence below it in the source."""
    texts = sentences(kind)
    found = [(field, texts[field.encode_name]) for field in fields_of(kind)]
    if kind is Scene:  # an arm has no separate table in a file
        found = [pair for pair in found if pair[0].name != "arm"] + entries(Arm)
    return found


def _entry(path: str, field: msgspec.structs.FieldInfo, sentence: str) -> str:
    unit = ", ".join(units_in(sentence))
    kind = words(field.type) + (f", in {unit}" if unit not in {"", "1"} else "")
    default = _default(field)
    named = NAMED_BY_FILES.get(field.name, "") if _plain(field.type) is str else ""
    allowed = f" Known: {', '.join(map(literal, data_files.names(named)))}." if named else ""
    options = {"type": kind, "default": default} if default else {"type": kind}
    return directive("confval", _join(path, field.encode_name), prose(sentence) + allowed, **options)


def _default(field: msgspec.structs.FieldInfo) -> str:
    value = default_of(field)
    if value is msgspec.NODEFAULT:
        return "required"
    if value is None or isinstance(value, msgspec.Struct) or value in ((), {}):
        return ""
    text = toml_of({"x": value}).removeprefix("x = ").strip()
    return "" if text == '""' else literal(text)


def _join(path: str, key: str, kind: Any = None) -> str:
    named = ".NAME" if kind is not None and get_origin(_plain(kind)) in {dict, tuple} else ""
    if named and key == "filter":  # filters have no name
        named = ".NUMBER"
    return f"{path}.{key}{named}" if path else f"{key}{named}"


def words(kind: Any) -> str:
    """Describe a type in a reader's terms."""
    if isinstance(kind, type) and not get_args(kind):
        return _class_words(kind)
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        of = words(parts[0])
        if ONE_PER_LINK in parts[1:]:
            return of.replace("list of numbers", "list of numbers, one per link")
        return " ".join([of, *(limit for meta in parts[1:] for limit in _limits(meta))])
    if origin in {Union, UnionType}:
        return " or ".join(words(part) for part in parts if part is not NoneType)
    if origin is dict:
        return "table of tables by name" if _records_in(kind) else "table by key"
    return ", ".join(literal(f'"{value}"') for value in parts) if origin is Literal else _list_words(parts)


def _class_words(kind: type) -> str:
    if issubclass(kind, msgspec.Struct):
        return "path of a scene file" if kind is Scene else "table"
    return {float: "number", int: "integer", bool: "true or false", str: "text"}.get(kind, "any value")


def _list_words(parts: tuple[Any, ...]) -> str:
    if Ellipsis not in parts:
        return f"{len(parts)} {_plural(words(parts[0]))}"
    return "list of tables" if _records_in(parts[0]) else f"list of {_plural(words(parts[0]))}"


def _plural(text: str) -> str:
    if text.startswith(("list of ", "table")) or re.match(r"\d", text):
        return text.replace("list of", "lists of", 1) if text.startswith("list of") else f"lists of {text}"
    return text.replace("number", "numbers", 1).replace("text", "texts", 1)


def _limits(meta: Any) -> Iterator[str]:
    for name, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤")):
        limit = getattr(meta, name, None)
        if limit is not None:
            yield f"{sign} {limit:g}" if limit < 1e6 else f"{sign} {limit:.3g}"


def _plain(kind: Any) -> Any:
    """Return a type without limits and without None."""
    if get_origin(kind) is Annotated:
        return _plain(get_args(kind)[0])
    if get_origin(kind) in {Union, UnionType}:
        (kind, *_) = (part for part in get_args(kind) if part is not NoneType)
        return _plain(kind)
    return kind


def _records_in(kind: Any) -> list[Record]:
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return [kind]
    return [record for part in get_args(kind) for record in _records_in(part)]
