"""Read files named by the user, parse TOML documents, and handle paths and file names inside a document."""

import errno
import os
import re
import stat
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from flexlink.common.errors import ArgumentError, Diagnostic, FlexlinkError, SceneError
from flexlink.common.types import T
from flexlink.common.wording import truncated


def require_path(name: str, value: object) -> Path:
    """Convert a str or Path to a Path."""
    if not isinstance(value, str | os.PathLike):
        text = f"{name} = {truncated(value)}: expected a str or a Path, got {type(value).__name__}"
        raise ArgumentError(text, id="wrong-type")
    if "\n" in str(value):
        raise ArgumentError(f"{name} = {truncated(value)}: is a text; give the path of a file with it", id="wrong-type")
    return Path(value)


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file; any other file (XML, CSV, Python, not UTF-8) is refused in one line that names its kind."""
    text = read_text(path, largest=1_000_000, error=SceneError)
    if not text.strip():
        raise SceneError(f"{path}: empty; expected a TOML file", id="file-empty")
    if text.lstrip().startswith("<"):
        raise SceneError(f"{path}: is XML; import it first: flexlink import {path} -o arm.toml", id="is-xml")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: TOMLDecodeError, or an integer of 5000 digits
        raise SceneError(f"{path}: not TOML: {explained(text, error)}", id="not-toml") from None


def in_json(document: object) -> str:
    """A document as JSON, with null for numbers that are not finite and [re, im] for complex numbers."""
    return msgspec.json.format(msgspec.json.encode(document, enc_hook=_plain), indent=1).decode()


def _plain(value: object) -> object:
    """Convert types unknown to msgspec: arrays, NumPy numbers, complex numbers, texts with an id."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Diagnostic):
        return str(value)
    if isinstance(value, complex):
        return value.real, value.imag
    raise NotImplementedError(type(value).__name__)


def is_user_file(name: object) -> bool:
    """Whether `name` is a path to a user's file rather than the name of a built-in description."""
    return isinstance(name, str) and name.endswith(".toml")


def absolute(name: str, folder: Path = Path()) -> str:
    """Absolute path of a user's file, relative to `folder`; built-in names are unchanged."""
    return str((folder / name).absolute()) if is_user_file(name) else name


def with_absolute_paths(folder: Path, document: T) -> T:
    """Make all file names in a parsed file absolute, relative to its `folder`; tables and lists change in place.

    File names are all values of `file`, and values of `method`, `lumping` and `kind` that end in .toml. A key may be a
    path such as "run.method", and a value may be a list of file names. The function is not recursive, so deep nesting
    is safe.
    """
    text = _as_json(document)
    if text and b'.toml"' not in text and b'file"' not in text:
        return document
    left: list[tuple[str, Any]] = [("", document)]
    while left:
        above, node = left.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            value = node[key]
            name = key.rpartition(".")[2] if isinstance(key, str) else above
            if not isinstance(value, str):
                left.append((name, value))
            elif name == "file" and value:
                node[key] = str((folder / value).absolute())
            elif name in {"method", "lumping", "kind"}:  # built-in names, or paths of user files
                node[key] = absolute(value, folder)
    return document


def is_finite(document: object) -> bool:
    """Whether every number of a parsed file is finite; False if this cannot be determined."""
    text = _as_json(document)
    return bool(text) and b"null" not in text


def _as_json(document: object) -> bytes:
    """A parsed file as JSON, in a few µs, with null for infinite and nan; empty if it cannot be encoded."""
    try:
        return msgspec.json.encode(document)
    except (TypeError, ValueError, OverflowError, RecursionError):
        return b""


def paths_of(table: Mapping[str, Any], leaf: tuple[str, ...] = (), above: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted key paths and values of nested tables; a table that contains a key in `leaf` counts as a value."""
    for key, value in table.items():
        if isinstance(value, dict) and value and not any(name in value for name in leaf):
            yield from paths_of(value, leaf, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def explained(text: str, error: Exception) -> str:
    """The parser's reason, the line where it failed, and a remedy for common mistakes."""
    reason, lines = str(error), text.rstrip().splitlines()
    found = re.search(r"at line (\d+)", reason)
    line = lines[int(found[1]) - 1].strip() if found else lines[-1].strip()
    return f"{reason}: {truncated(line)}{_remedy('not_toml.toml', reason=reason, line=line)}"


def _remedy(file: str, **given: str) -> str:
    """Remedy in the first row of a file of mistakes whose patterns, by name, all match the given texts; else empty."""
    for row in tomllib.loads(Path(__file__).with_name(file).read_text(encoding="utf-8"))["mistake"]:
        found = [re.match(row[name], text, re.DOTALL) for name, text in given.items()]
        if all(found) and (last := found[-1]):
            return f"; {last.expand(row['remedy'])}"
    return ""


def shown_path(path: str | Path) -> str:
    """Return a path for a message, relative to the current folder if it is inside this folder, else unchanged."""
    try:
        return str(Path(path).absolute().relative_to(Path.cwd()))
    except (OSError, ValueError):
        return str(path)


def read_text(path: Path, *, largest: int, error: type[FlexlinkError]) -> str:
    """Return the text of a file in UTF-8; one of another program is refused with what it is, by its first bytes."""
    data = read_regular(path, largest=largest, error=error)
    try:
        return data.decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError as wrong:
        remedy = _remedy("no_text.toml", begins=data[:200].decode("latin-1"))
        raise error(f"{path}: not UTF-8 at byte {wrong.start}{remedy}", id="not-utf8") from None


def read_regular(path: Path, *, largest: int, error: type[FlexlinkError]) -> bytes:
    """Return the bytes of a regular file of at most `largest` bytes; a pipe, which might block forever, is refused."""
    try:
        if not stat.S_ISREG(mode := path.stat().st_mode):
            name = "a folder; name a file in it" if stat.S_ISDIR(mode) else "a pipe or a device; give a regular file"
            raise OSError(errno.EINVAL, f"is {name}")
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as reason:  # ValueError: a null character in the path
        raise error(f"{path}: cannot be read: {getattr(reason, 'strerror', reason)}", id="cannot-read") from None
    if len(data) > largest:
        raise error(f"{path}: more than {largest} bytes; give a smaller file", id="file-too-large")
    return data
