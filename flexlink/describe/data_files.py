"""Built-in data files that users can extend: Runge-Kutta methods, lumping rules and shapers, by name or path."""

import functools
import re
from pathlib import Path
from typing import Any, cast

from flexlink.common.errors import ArgumentError, DataFileError, SceneError, errors_at
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
    if not is_user_file(name):
        if isinstance(name, str) and (ours := _ours(folder, name, cast("Any", kind))) is not None:
            return cast("T", ours)
        known, given = names(folder), re.escape(truncated(name).strip("'"))
        word = re.compile(rf"'s {given}\b", re.IGNORECASE)  # as other programs call it: "SciPy's RK45"
        abouts = ((each, str(read_toml(DATA / folder / f"{each}.toml")["about"])) for each in known)
        near = did_you_mean(next((each for each, about in abouts if word.search(about)), name), known)
        allowed = f"allowed are {', '.join(known)} or a path ending in .toml"
        raise ArgumentError(f"{key} = {truncated(name)}: unknown; {allowed}{near}", id="unknown-name")
    try:
        path = Path(absolute(name))
        status = path.stat() if path.exists() else None  # differs after a user's file has changed
        version = () if status is None else (status.st_mtime_ns, status.st_size, status.st_ino)
        return cast("T", _decoded(path, version, cast("Any", kind)))
    except (SceneError, OSError, ValueError) as error:
        raise DataFileError(f"{key} = {truncated(name)}: {error}") from None


@functools.lru_cache(maxsize=256)
def _ours(folder: str, name: str, kind: Any) -> Any:
    """A built-in description, or None; looks for its file, once, instead of listing the folder."""
    path = DATA / folder / f"{name}.toml"
    return _decoded(path, (), kind) if Path(name).name == name and path.is_file() else None


@functools.lru_cache(maxsize=256)
def _decoded(path: Path, _version: tuple[int, ...], kind: Any) -> Any:
    """Decode a file, and decode it again only after it has changed."""
    raw = read_toml(path)
    with errors_at(f"{path}: "):
        return decode(raw, kind)
