"""Data files that a user can add to: Runge-Kutta methods and lumping rules, found by name or by path."""

from __future__ import annotations

import functools
import os
import tomllib
from pathlib import Path
from typing import Any, cast

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.files import read_regular
from flexlink.common.types import T
from flexlink.describe.spec import decode, did_you_mean, truncated

DATA = Path(__file__).parent / "data"


def require_path(name: str, value: object) -> Path:
    """`value`, a str or a Path, as a Path.

    Raises
    ------
    ArgumentError
        It is neither; the message says what it is.
    """
    if not isinstance(value, str | os.PathLike):
        raise ArgumentError(f"{name} = {truncated(value)}: expected a str or a Path, got {type(value).__name__}")
    return Path(value)


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file, with one-line errors.

    Raises
    ------
    SceneError
        The file is missing, unreadable, a pipe (which may never say anything), larger than 1 MB, empty, not UTF-8 or
        not TOML.
    """
    data = read_regular(path, largest=1_000_000, error=SceneError)
    try:
        text = data.decode("utf-8-sig")  # some editors put a byte order mark in front
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 at byte {error.start}; save the file as UTF-8") from None
    if not text.strip():
        raise SceneError(f"{path}: empty; expected a TOML file")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: TOMLDecodeError, or an integer of 5000 digits
        raise SceneError(f"{path}: not TOML: {error}") from None


@functools.cache
def names(folder: str) -> tuple[str, ...]:
    """Names that come with flexlink in `folder` ("methods" or "lumping")."""
    return tuple(sorted(path.stem for path in (DATA / folder).glob("*.toml")))


def load(folder: str, key: str, name: str, kind: type[T]) -> T:
    """Description of a type of `Spec` by name, or from the user's own file if `name` ends in ".toml".

    Parameters
    ----------
    folder
        "methods" or "lumping".
    key
        Key of the scene that holds `name`, for messages.
    name
        Name of a description that comes with flexlink, or a path.
    kind
        What to decode.

    Raises
    ------
    ArgumentError
        No such name; the message lists those that exist.
    DataFileError
        A file that is missing, or not a valid description.
    """
    if not isinstance(name, str) or not (is_user_file(name) or _is_ours(folder, name)):
        known = names(folder)
        raise ArgumentError(
            f"{key} = {truncated(name)}: unknown; allowed are {', '.join(known)} or a path ending in .toml"
            f"{did_you_mean(name, known)}"
        )
    try:
        description: T = _of_user(name, kind) if is_user_file(name) else _of_ours(folder, name, cast("Any", kind))
    except (SceneError, OSError, ValueError) as error:
        raise DataFileError(f"{key} = {truncated(name)}: {error}") from None
    return description


@functools.lru_cache(maxsize=256)
def _is_ours(folder: str, name: str) -> bool:
    """Whether a description of this name comes with flexlink: a look at one file, once, not at all of a folder."""
    return Path(name).name == name and (DATA / folder / f"{name}.toml").is_file()


def is_user_file(name: object) -> bool:
    """Whether `name` is a path to the user's own file, not the name of a description that comes with flexlink."""
    return isinstance(name, str) and name.endswith(".toml")


def absolute(name: str, folder: Path = Path()) -> str:
    """An own file's path, which starts from `folder`, wherever the program moves to; a name stays as it is."""
    return str((folder / name).absolute()) if is_user_file(name) else name


NAMED = {"method", "lumping", "kind"}
"""Keys whose values are names of descriptions, or paths of the user's own."""


def beside(folder: Path, document: T) -> T:
    """A parsed file, its files named from its folder, wherever the program moves; tables and lists change in place.

    These are all values of `file`, and those of `method`, `lumping` and `kind` that are own files. A key may be a path
    such as "run.method", a value a list of several. However deep a file is nested, no recursion is.
    """
    left: list[tuple[str, Any]] = [("", document)]
    while left:
        above, node = left.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            value = node[key]
            name = key.rpartition(".")[2] if isinstance(key, str) else above
            if isinstance(value, str):
                node[key] = _from(folder, name, value)
            else:
                left.append((name, value))
    return document


def _from(folder: Path, key: str, value: str) -> str:
    if key == "file" and value:
        return str((folder / value).absolute())
    return absolute(value, folder) if key in NAMED else value


@functools.cache
def _of_ours(folder: str, name: str, kind: Any) -> Any:
    return _decoded(DATA / folder / f"{name}.toml", (), kind)


def _of_user(name: str, kind: Any) -> Any:
    """Read again where it has changed."""
    path = Path(absolute(name))
    return _decoded(path, _version(path), kind)


def _version(path: Path) -> tuple[int, ...]:
    if not path.exists():
        return ()
    status = path.stat()
    return status.st_mtime_ns, status.st_size, status.st_ino


@functools.lru_cache(maxsize=64)
def _decoded(path: Path, _version: tuple[int, ...], kind: Any) -> Any:
    """Decode a file once for each version of it."""
    raw = read_toml(path)
    try:
        return decode(raw, kind)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
