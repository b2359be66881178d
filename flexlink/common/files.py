"""Read a file named by the user; error messages have one line."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

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
    with open_regular(path, error=error) as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise error(f"{path}: more than {largest} bytes; give a smaller file", id="file-too-large")
    return data


@contextlib.contextmanager
def open_regular(path: Path, *, error: type[FlexlinkError]) -> Iterator[BinaryIO]:
    """Open a regular file for reading; raises the errors of `read_regular`, also while the file is read."""
    try:
        if path.exists() and not path.is_file() and not path.is_dir():  # for a folder, `open` raises a clear error
            raise OSError(errno.EINVAL, "is a pipe or a device; give a regular file")
        file = path.open("rb")
    except (OSError, ValueError) as reason:  # ValueError: a null character in the path
        raise error(f"{path}: cannot be read: {getattr(reason, 'strerror', reason)}", id="cannot-read") from None
    with file:
        try:
            yield file
        except OSError as reason:
            raise error(f"{path}: cannot be read: {reason.strerror or reason}", id="cannot-read") from None
