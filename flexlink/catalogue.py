"""Data files that a user can add to: Runge-Kutta tableaus and lumping rules, found by name or by path."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path
from typing import Any, TypeVar, cast

from flexlink.errors import SceneError
from flexlink.spec import decode, short

T = TypeVar("T")

DATA = Path(__file__).parent / "data"
LARGEST_FILE = 1_000_000  # bytes; a description is text that a person can read


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file, with one-line errors.

    Raises
    ------
    SceneError
        The file is missing, unreadable, larger than 1 MB, empty, not UTF-8 or not TOML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)  # a size asked for beforehand says nothing about pipes and devices
        text = data.decode()
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 at byte {error.start}; a description is UTF-8 text") from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise SceneError(f"{path}: cannot be read: {getattr(error, 'strerror', error)}") from None
    if len(data) > LARGEST_FILE:
        raise SceneError(f"{path}: more than {LARGEST_FILE} bytes; a description is text that a person can read")
    if not text.strip():
        raise SceneError(f"{path}: empty; a description is a TOML file")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: TOMLDecodeError, or an integer of 5000 digits
        raise SceneError(f"{path}: not TOML: {error}") from None


def names(folder: str) -> list[str]:
    """Names that come with flexlink in `folder` ("tableaus" or "lumping")."""
    return sorted(path.stem for path in (DATA / folder).glob("*.toml"))


def load(folder: str, key: str, name: str, kind: type[T]) -> T:
    """Description of a type of `Spec` by name, or from the user's own file if `name` ends in ".toml".

    Parameters
    ----------
    folder
        "tableaus" or "lumping".
    key
        Key of the scene that holds `name`, for messages.
    name
        Name of a description that comes with flexlink, or a path.
    kind
        What to decode.

    Raises
    ------
    SceneError
        No such name (the message lists those that exist), or a file that is not a valid description.
    """
    own = isinstance(name, str) and name.endswith(".toml")
    path = Path(name) if own else DATA / folder / f"{name}.toml"
    if not own and name not in names(folder):
        allowed = ", ".join(names(folder))
        raise SceneError(f"{key} = {short(name)}: unknown; allowed are {allowed} or a path ending in .toml")
    try:
        changed = path.stat().st_mtime_ns if path.exists() else 0
        found: T = _decoded(path, changed, cast("Any", kind))
    except (SceneError, OSError, ValueError) as error:
        raise SceneError(f"{key} = {short(name)}: {error}") from None
    return found


@functools.lru_cache(maxsize=64)
def _decoded(path: Path, _changed: int, kind: Any) -> Any:
    """Decode a file once for each time it was changed."""
    raw = read_toml(path)
    try:
        return decode(raw, kind)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
