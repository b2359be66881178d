"""Every key, option, command, call, file and name in code type on a page exists in the program as it is written."""

import ast
import inspect
import keyword
import re
import tomllib
from collections.abc import Iterator, Set
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, get_args

import msgspec
import pytest

import flexlink as fl
from docs.generators import api, command_line, keys, messages
from flexlink.cli.main import build_parser
from flexlink.describe import data_files
from tests.books.test_pages import PAGES, name_of
from tests.books.test_site import KEY_PAGES
from tests.conftest import ROOT

LISTED = tomllib.loads(Path(__file__).with_name("page_words.toml").read_text(encoding="utf-8"))
"""Names by which pages call objects of a class, and words that are not of flexlink."""
FILE = r"\w+\.(c|csv|html|json|npz|py|sdf|toml|urdf|xml)"
UNIT = re.compile(r" \[.*?\]")
WORD = re.compile(r"\b[^\W\d]\w*")


@cache
def fields() -> dict[str, list[msgspec.structs.FieldInfo]]:
    """Fields of all files by every end of their paths, without names of tables."""
    found: dict[str, list[msgspec.structs.FieldInfo]] = {}
    known: set[keys.Record] = set()
    records = [pair for roots in KEY_PAGES.values() for root in roots for pair in keys.records(root, "", known)]
    for place, kind in records:
        for field, _ in keys.entries(kind):
            parts = [part for part in [*place.split("."), field.encode_name] if part and not part.isupper()]
            for k in range(len(parts)):
                found.setdefault(".".join(parts[k:]), []).append(field)
    return found


@cache
def options() -> dict[str, set[str]]:
    """Options of each command."""
    commands = command_line.commands(build_parser())
    return {name: {word for one in each._actions for word in one.option_strings} for name, each in commands.items()}


@cache
def public() -> dict[str, Any]:
    """Public things by path, such as `small_motion.loop`."""
    paths = [path.partition(".")[2] for name in fl.__all__ for path in [f"flexlink.{name}", *api._paths(name)]]
    return {path: eval(f"fl.{path}") for path in paths}


@cache
def words() -> set[str]:
    """Words that exist: keys, values, options, names, attributes, data files, extras, ids, words in the source."""
    found = {*fields(), *options(), *messages.texts(), *keyword.kwlist, *LISTED["objects"]}
    found |= {word for text in LISTED["others"].values() for word in text.split()}
    found |= {str(value) for several in fields().values() for field in several for value in literals(field.type)}
    found |= {name for folder in ("methods", "lumping", "shapers") for name in data_files.names(folder)}
    found |= {path.stem for path in ROOT.glob("validation/cases/*.toml")}
    found |= {*tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]}
    found |= {part for path in (*public(), *LISTED["objects"].values()) for part in re.split("[.:]", path)}
    for thing in [*public().values(), *map(resolve_name, LISTED["objects"].values())]:
        found |= attributes_of(thing) if inspect.isclass(thing) else set()
        found |= {*inspect.signature(thing).parameters} if callable(thing) else set()
    return found | in_sources()


def in_sources() -> set[str]:
    """Words of the strings without spaces in the source, such as names of coordinates, columns and verdicts."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "flexlink").rglob("*.py")]
    constants = {node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    names = [UNIT.sub("", text) for text in constants if isinstance(text, str)]
    return {word for name in names if " " not in name for word in WORD.findall(name)}


def literals(kind: Any) -> Iterator[object]:
    for part in get_args(kind):
        yield from literals(part) if get_args(part) else [part]


def attributes_of(kind: Any) -> set[str]:
    parts = (getattr(each, "__annotations__", ()) for each in getattr(kind, "__mro__", ()))
    return {*dir(kind), *getattr(kind, "__dict__", ())}.union(*parts)


@cache
def of_the_project() -> set[str]:
    """Words of all code and data, which pages for developers may name."""
    folders = ("flexlink", "tests", "validation", "reports", "docs", "build_tools")
    paths = [path for folder in folders for end in ("py", "toml") for path in (ROOT / folder).rglob(f"*.{end}")]
    return {word for path in paths if path != Path(__file__) for word in WORD.findall(path.read_text(encoding="utf-8"))}


def for_developers(page: Path) -> bool:
    return "development" in page.parts or page.stem == "CONTRIBUTING"


def exists(span: str, more: Set[str]) -> bool:
    """Whether what is in code type exists; `more` are further words, of the page's blocks."""
    known_as = (in_a_shell(span), in_a_file(span), in_python(span))
    named = {word for word in WORD.findall(UNIT.sub("", span)) if not word.isupper()}
    return next((sure for sure in known_as if sure is not None), named <= words() | more)


def in_a_shell(span: str) -> bool | None:
    """Whether this is a command whose options exist, options, or a path that exists; None if it is neither."""
    if " && " in span or "; " in span:
        return all(in_a_shell(each) is not False for each in re.split(" && |; ", span))
    first, *others = re.sub('^([A-Z_]+=(".*?"|\\S+) )+', "", span).split()
    used = set(re.findall(r"(?<!\S)--?[a-z][\w-]*", span))
    if first == "flexlink" and others:
        return others[0] == "--version" or (others[0] in options() and used <= options()[others[0]])
    if first in LISTED["programs"] or span in LISTED["whole"] or re.fullmatch(FILE, span):
        return True
    if first == "python" and "-m" in others:
        return others[1] in LISTED["programs"] or is_run(others[1], {*others[2:]})
    if re.fullmatch(r"[\w./*-]+(/[\w./*-]*|\.(md|cff))", span):
        return any(ROOT.glob(span.rstrip("/").replace("NAME", "*")))
    return used <= set().union(*options().values()) if span.startswith("-") else None


def is_run(module: str, words: set[str]) -> bool:
    """Whether a module exists that has these options; of the study also these cases."""
    if (spec := find_spec(module)) is None or spec.origin is None:
        return False
    place = Path(spec.origin)
    files = place.parent.glob("*.py") if spec.submodule_search_locations else [place]
    source = " ".join(file.read_text(encoding="utf-8") for file in files)
    cases = {re.split(r"-|\*|NAME", word.strip("'"))[0] for word in words if re.match("'?[a-z][^/]+$", word)}
    known_cases = module != "validation" or all(any(ROOT.glob(f"validation/cases/{name}*.toml")) for name in cases)
    return known_cases and all(word in source for word in words if word.startswith("--"))


def in_a_file(span: str) -> bool | None:
    """Whether this is a path of keys, or TOML whose keys take its values; None if it has other keys, or is neither."""
    path = ".".join(part for part in span.strip("[]").split(".") if not part.isupper())
    if path in fields():
        return True
    try:
        pairs = list(flat(tomllib.loads(re.sub(r"^(\[\[?[\w.]+\]\]?) ", r"\1\n", span))))
    except tomllib.TOMLDecodeError:
        return None
    if not {key for key, _ in pairs} <= {*fields()}:
        return None
    return all(any(takes(field, value) for field in fields()[key]) for key, value in pairs)


def flat(pairs: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in pairs.items():
        path = above if key.isupper() else f"{above}{key}."
        yield from flat(value, path) if isinstance(value, dict) else [(path[:-1], value)]


def takes(field: msgspec.structs.FieldInfo, value: Any) -> bool:
    try:
        msgspec.convert(value, field.type)
    except (msgspec.ValidationError, fl.FlexlinkError):
        return False
    return True


def in_python(span: str) -> bool | None:
    """Whether this is Python whose names exist and whose calls have the right arguments; None for other names."""
    try:
        tree = ast.parse(span.replace("…", "..."))
    except SyntaxError:
        return None
    found = [known(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute | ast.Call)]
    return False if False in found else None if None in found or not found else True


def known(node: ast.AST) -> bool | None:
    """Whether an attribute exists, or a call has the right arguments; None if it is not known of what."""
    if isinstance(node, ast.Attribute):
        of = thing_of(node.value)
        return None if of is None else node.attr in attributes_of(of)
    assert isinstance(node, ast.Call)
    if (thing := thing_of(node.func)) is None:
        return None
    given: list[object] = [each for each in node.args if ast.unparse(each) != "..."]
    signature = inspect.signature(thing)
    bind = signature.bind if len(given) == len(node.args) else signature.bind_partial
    unbound = isinstance(node.func, ast.Attribute) and inspect.isclass(thing_of(node.func.value))
    try:
        bind(*[None] * unbound, *given, **{str(word.arg): None for word in node.keywords})
    except TypeError:
        return False
    return True


def thing_of(node: ast.AST) -> Any:
    """The public thing, or the class of the object, of a name or an attribute; None if it is not known."""
    if isinstance(node, ast.Attribute):
        thing = getattr(thing_of(node.value), node.attr, None)
        return thing if callable(thing) or inspect.ismodule(thing) else None
    name = getattr(node, "id", "")
    return resolve_name(LISTED["objects"][name]) if name in LISTED["objects"] else public().get(name)


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_all_that_a_page_names_in_code_type_exists(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    code = "".join(re.findall(r"^```(?:sh|python|toml|console)\n(.*?)^```", text, re.DOTALL | re.MULTILINE))
    more = {*WORD.findall(code)} | (of_the_project() if for_developers(path) else set())
    prose = re.sub(r"^(```+|:::+)\w.*?^\1|^(```|:::+).*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    spans = [span for role, span in re.findall(r"(\{\w+\})?`([^`]+)`", prose) if not role]  # Sphinx checks roles
    assert [span for span in spans if not exists(" ".join(span.split()), more)] == []


WRONG = """\
modes.plot(); run.imbalances; fl.simulat(scene); fl.tip_position(chain, q, where=1); drive.kpp; profile = 'sharp'
segments = 2.5; flexlink modes SCENE --locks upper; flexlink mode SCENE; --tolerances 1e-3; [[fff]]
models/paper_fig6.toml; python -m validations; read_urdfs
"""


@pytest.mark.parametrize("span", re.split(r"; |\n", WRONG.strip()))
def test_a_name_that_does_not_exist_is_found(span: str) -> None:
    assert not exists(span, set())
