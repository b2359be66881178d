"""Writing results so that none is lost: whole or not at all, and never over a good file with half a one."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from flexlink.common.errors import OutputError
from flexlink.common.interruption import deferred
from flexlink.common.types import T


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
    with _temporary(path) as (temporary, target):
        write(temporary)
        temporary.replace(target)


@contextlib.contextmanager
def _temporary(path: Path) -> Iterator[tuple[Path, Path]]:
    """A new file beside `path`, links followed, and where it is to be moved; errors as in `write_whole`."""
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
                yield temporary, target
            finally:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}", id="cannot-write") from None


def check_writable(path: Path) -> None:
    """Know before the work that a file can be made beside `path`; errors as in `write_whole`."""
    with _temporary(path):
        pass


def make_folder(path: Path) -> None:
    """Make a folder and its parents, and know before the work that files can be made in it.

    Raises
    ------
    OutputError
        One of both is impossible.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: the folder cannot be made: {error.strerror or error}", id="cannot-write") from None
    check_writable(path / "index.html")


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text whole or not at all; errors as in `write_whole`."""
    write_whole(path, lambda temporary: temporary.write_bytes(text.encode()))


def write_or_keep(path: Path, write: Callable[[Path], object]) -> None:
    """Like `write_whole`, but a finished result is never lost: `or_keep`."""
    or_keep(path, lambda place: write_whole(place, write))


def or_keep(path: Path, write: Callable[[Path], T]) -> T:
    """Let `write` make a file or folder; a finished result that `path` cannot take goes to the temporary folder.

    Raises
    ------
    OutputError
        `path` cannot be written; the message says where the result is instead, if anywhere.
    """
    try:
        return write(path)
    except OutputError as first:
        refuge = Path(tempfile.gettempdir()) / f"flexlink-{os.getpid()}-{path.name}"
        try:
            write(refuge)
        except OutputError as second:
            raise OutputError(f"{first}; nor {second}") from None
        raise OutputError(f"{first}; the result is kept in {refuge}", id="result-kept") from None
