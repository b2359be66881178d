"""What each case depends on: its entry, its kind with all modules that it imports, and the data that these name.

The dependencies are found without running the case. They may contain a file too many, so that a case is measured again
without need, but no file too few: `validation/tests/test_dependencies.py` compares them with the files that cases open.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import NamedTuple

import msgspec

from flexlink.common.wording import plural
from validation.case import ALL, Case, load_cases, module_of
from validation.imports import Project
from validation.sources import DATA, ROOT, digest, digests, sources

MEASURING = "validation.measuring"  # calls every kind, and judges what it yields
SHEETS = "data_sheets"  # the kind that measures with the kinds, settings and scenes of all cases with a data sheet
REFERENCES = "validation/bench/flexarm_bench/references/"
DATA_BY_NAME = ("validation/reference/", REFERENCES, "validation/scenes/", "validation/sweeps/", "models/")
"""Folders whose files a result depends on if the case, its modules or its other data name them."""
QUOTED = re.compile(r"""(?=["'`]([\w./ -]+)["'`])""")
FOLDER_OF_ANY = re.compile(r"""["'/]([\w-]+)(?:/\{|["'] / f["'])""")  # f"trade/{name}", "robots" / f"{name}.toml"

Files = Mapping[str, str]
"""Path from the root → digest of the content."""


def of_cases(cases: Iterable[Case]) -> dict[str, dict[str, str]]:
    """Case → the files that it depends on, with their digests; its entry counts as a file."""
    now = digests()
    return {case.name: _of_case(case, now) for case in cases}


def _of_case(case: Case, now: Files) -> dict[str, str]:
    found = {path: now[path] for path in _paths(case, now)} | _entry(case)
    if case.kind == SHEETS:
        for other in (each for each in load_cases() if each.sheet):
            found |= _of_case(other, now)
    return found


def everything() -> dict[str, str]:
    """Every file and entry that some case may depend on, with its digest."""
    found = digests()
    for case in load_cases(*ALL):
        found |= _entry(case)
    return found


def key(files: Files) -> str:
    """Hash of everything that a case depends on in this project; equal on all machines."""
    return hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()[:16]


def changes(now: Files, then: Files) -> str:
    """The first file that differs and the number of others, in words; "" if none differs."""
    verbs = {
        "changed": [path for path in now if path in then and now[path] != then[path]],
        "is new": [path for path in now if path not in then],
        "is gone": [path for path in then if path not in now],
    }
    found = [f"{path} {verb}" for verb, paths in verbs.items() for path in sorted(paths)]
    more = f", and {plural(len(found) - 1, 'other file')}" if len(found) > 1 else ""
    return f"{found[0]}{more}" if found else ""


def _entry(case: Case) -> dict[str, str]:
    """The case as read from its file, so that comments, and the other parts of a case in parts, do not count."""
    name = f"validation/cases/{case.path.name}" + (f": {case.part}" if case.part else "")
    return {name: digest(msgspec.json.encode(case))}


def _paths(case: Case, known: Collection[str]) -> set[str]:
    code = _of_kind(case.kind)
    scenes = {_name(path) for path in case.scene_files}
    found = {*code.files, *scenes}
    words = code.words.union(_words(msgspec.json.encode(case).decode()), *map(_words_of, scenes))
    while new := set(_named(words, known)) - found:
        found |= new
        words = words.union(*(_words_of(name) for name in new if name.endswith(".toml")))  # a scene may name a file
    return found & set(known)


class _Code(NamedTuple):
    files: frozenset[str]
    words: frozenset[str]  # words in quotes, in the modules and data of the study


@functools.cache
def _of_kind(kind: str) -> _Code:
    """The modules of a kind, with the data next to them."""
    modules = [_project().files[name] for name in _project().closure(module_of(kind), MEASURING)]
    files = frozenset(_name(path) for path in (*modules, *_data_beside(modules)))
    return _Code(files, frozenset().union(*(_words_of(name) for name in files if name.startswith("validation/"))))


def _data_beside(modules: Iterable[Path]) -> Iterator[Path]:
    """Data files in the folders of modules, and in the folders `data` there."""
    for folder in {module.parent for module in modules}:
        yield from (path for path in (*folder.iterdir(), *(folder / "data").rglob("*")) if path.suffix in DATA)


def _named(words: AbstractSet[str], known: Iterable[str]) -> Iterator[str]:
    """Files by name that are named with their folder, or whose folder is named before a name in braces."""
    for path in known:
        if path.startswith(DATA_BY_NAME):
            folder, stem = path.split("/")[-2], path.rpartition("/")[2].partition(".")[0]
            if (stem in words and (folder in words or _is_top(path))) or f"{folder}/*" in words:
                yield path


def _is_top(path: str) -> bool:
    """Whether a file is directly in one of the folders."""
    return any(path.startswith(top) and "/" not in path.removeprefix(top) for top in DATA_BY_NAME)


@functools.cache
def _words_of(name: str) -> frozenset[str]:
    return _words((ROOT / name).read_text(encoding="utf-8"))


def _words(text: str) -> frozenset[str]:
    """Parts of quoted paths without endings; "FOLDER/*" for a folder before a name in braces."""
    parts = {part for quoted in QUOTED.findall(text) for part in quoted.split("/")}
    whole = {f"{folder}/*" for folder in FOLDER_OF_ANY.findall(text)}
    return frozenset({part.partition(".")[0] for part in parts} | whole)


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@functools.cache
def _project() -> Project:
    names = {path.relative_to(ROOT).with_suffix("").as_posix().replace("/", "."): path for path in _modules()}
    return Project({name.removesuffix(".__init__"): path for name, path in names.items()})


def _modules() -> list[Path]:
    return [path for path in sources() if path.suffix == ".py"]
