"""Writing results so that none is lost: whole or not at all, and never over a good file with half a one."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from flexlink.common.errors import OutputError
from flexlink.common.interruption import deferred


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside `path`, then move it there in one step; no signal comes between.

    A link is followed, and the file that it leads to replaced. A new file gets the permissions of the umask, a replaced
    one keeps its own.

    Raises
    ------
    OutputError
        The folder is missing or not writable, the disk is full, or `path` is a folder, a device or a pipe; `path` is
        left as it was.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem}-{secrets.token_hex(4)}{target.suffix}")
    try:
        with deferred():
            try:
                os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
                if target.exists():
                    if not target.is_file():
                        raise OSError("is not a regular file")
                    shutil.copymode(target, temporary)
                write(temporary)
                temporary.replace(target)
            finally:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


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
