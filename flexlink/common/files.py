"""Read a file named by the user; error messages have one line."""

from __future__ import annotations

import errno
from pathlib import Path

from flexlink.common.errors import FlexlinkError


def shown_path(path: str | Path) -> str:
    """Return a path for a message, relative to the current folder if it is inside this folder, else unchanged."""
    try:
        return str(Path(path).absolute().relative_to(Path.cwd()))
    except (OSError, ValueError):
        return str(path)


def read_regular(path: Path, *, largest: int, error: type[FlexlinkError]) -> bytes:
    """Return the bytes of a regular file.

    Parameters
    ----------
    path
        The file.
    largest
        Largest allowed size in bytes.
    error
        Class of the errors.

    Returns
    -------
    bytes
        The complete file.

    Raises
    ------
    FlexlinkError
        Of class `error`: the file is missing, unreadable, larger than `largest`, or a pipe (which might block forever).
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():  # for a folder, `open` raises a clear error
            raise OSError(errno.EINVAL, "is a pipe or a device; give a regular file")
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as reason:  # ValueError: a null character in the path
        raise error(f"{path}: cannot be read: {getattr(reason, 'strerror', reason)}", id="cannot-read") from None
    if len(data) > largest:
        raise error(f"{path}: more than {largest} bytes; give a smaller file", id="file-too-large")
    return data
