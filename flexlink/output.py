"""Writing results so that none is lost: whole or not at all, and never over a good file with half a one."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from flexlink.errors import OutputError


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside `path`, then move it there in one step.

    Raises
    ------
    OutputError
        The folder is missing or not writable, or the disk is full; `path` is left as it was.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    os.close(handle)
    temporary = Path(name)
    try:
        write(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text whole or not at all; errors as in `write_whole`."""
    write_whole(path, lambda temporary: temporary.write_bytes(text.encode()))


def write_or_keep(path: Path, write: Callable[[Path], object]) -> None:
    """Like `write_whole`, but a finished result that `path` cannot take is kept in the system's temporary folder.

    Raises
    ------
    OutputError
        `path` cannot be written; the message says where the result is instead, if anywhere.
    """
    try:
        write_whole(path, write)
    except OutputError as first:
        refuge = Path(tempfile.gettempdir()) / f"flexlink-{os.getpid()}-{path.name}"
        try:
            write_whole(refuge, write)
        except OutputError as second:
            raise OutputError(f"{first}; nor {second}") from None
        raise OutputError(f"{first}; the result is kept in {refuge}") from None
