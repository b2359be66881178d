"""Built-in data files that users can extend: Runge-Kutta methods, lumping rules and shapers, by name or path."""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import Any, cast

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import T
from flexlink.common.wording import did_you_mean, truncated
from flexlink.data.documents import absolute, is_user_file, read_toml
from flexlink.describe.spec import decode

DATA = Path(__file__).parent / "data"


@functools.cache
def names(folder: str) -> tuple[str, ...]:
    """Names of the built-in descriptions in `folder` ("methods" or "lumping")."""
    return tuple(sorted(path.stem for path in (DATA / folder).glob("*.toml")))


def load(folder: str, key: str, name: str, kind: type[T]) -> T:
    """Load a description of a type by the name in a folder of `data`, or from the user's file if it ends in ".toml".

    Messages name the `key` of the scene whose value is the name.
    """
    if not isinstance(name, str) or not (is_user_file(name) or _is_ours(folder, name)):
        known = names(folder)
        raise ArgumentError(
            f"{key} = {truncated(name)}: unknown; allowed are {', '.join(known)} or a path ending in .toml"
            f"{did_you_mean(_called_elsewhere(folder, name) or name, known)}",
            id="unknown-name",
        )
    try:
        description: T = _of_user(name, kind) if is_user_file(name) else _of_ours(folder, name, cast("Any", kind))
    except (SceneError, OSError, ValueError) as error:
        raise DataFileError(f"{key} = {truncated(name)}: {error}") from None
    return description


def _called_elsewhere(folder: str, name: object) -> str | None:
    """The built-in description that has this name in another program according to its `about`: SciPy's RK45."""
    given = re.escape(truncated(name).strip("'"))
    word = re.compile(rf"'s {given}\b", re.IGNORECASE)
    abouts = ((each, str(read_toml(DATA / folder / f"{each}.toml")["about"])) for each in names(folder))
    return next((each for each, about in abouts if word.search(about)), None)


@functools.lru_cache(maxsize=256)
def _is_ours(folder: str, name: str) -> bool:
    """Whether a built-in description has this name; looks for its file, once, instead of listing the folder."""
    return Path(name).name == name and (DATA / folder / f"{name}.toml").is_file()


@functools.cache
def _of_ours(folder: str, name: str, kind: Any) -> Any:
    return _decoded(DATA / folder / f"{name}.toml", (), kind)


def _of_user(name: str, kind: Any) -> Any:
    """Load a description from a user's file, which is read again only if it has changed."""
    path = Path(absolute(name))
    return _decoded(path, _version(path), kind)


def _version(path: Path) -> tuple[int, ...]:
    if not path.exists():
        return ()
    status = path.stat()
    return status.st_mtime_ns, status.st_size, status.st_ino


@functools.lru_cache(maxsize=64)
def _decoded(path: Path, _version: tuple[int, ...], kind: Any) -> Any:
    """Decode a file, and decode it again only after it has changed."""
    raw = read_toml(path)
    try:
        return decode(raw, kind)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
