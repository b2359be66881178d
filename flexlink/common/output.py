"""Write results safely: no partial file remains, and a failed write never damages an old file."""

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
    """Let `write` fill a temporary file in the same folder, then rename it to `path`; signals are deferred.

    Symbolic links are followed, and their target is replaced. A new file gets the permissions of the umask; a replaced
    file keeps its permissions.
    """
    with _temporary(path) as (temporary, target):
        write(temporary)
        temporary.replace(target)


@contextlib.contextmanager
def _temporary(path: Path) -> Iterator[tuple[Path, Path]]:
    """Yield a temporary file, and the file that it will replace (`path` without links); errors as in `write_whole`."""
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
    """Check, before results are computed, that a file can be created next to `path`; errors as in `write_whole`."""
    with _temporary(path):
        pass


def make_folder(path: Path) -> None:
    """Create a folder and its parents, and check, before results are computed, that files can be created in it."""
    if path.suffix in {".html", ".toml", ".csv", ".png", ".pdf", ".npz", ".docx", ".slx"} and not path.is_dir():
        why = f"a folder of several files is written; give its name, such as {path.with_suffix('')}"
        raise OutputError(f"{path}: {why}", id="folder-needed")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: the folder cannot be made: {error.strerror or error}", id="cannot-write") from None
    check_writable(path / "index.html")


def begin_page(folder: Path) -> None:
    """Make the folder of a page, without the page of an earlier report, whose files are replaced one by one."""
    make_folder(folder)
    (folder / "index.html").unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text so that no partial file remains; raises the errors of `write_whole`."""
    write_whole(path, lambda temporary: temporary.write_bytes(text.encode()))


def write_or_keep(path: Path, write: Callable[[Path], object]) -> None:
    """Write a finished result with `write_whole`; if `path` cannot be written, save it elsewhere, as `or_keep` does."""
    or_keep(path, lambda target: write_whole(target, write))


def or_keep(path: Path, write: Callable[[Path], T]) -> T:
    """Let `write` create a file or folder; if `path` cannot be written, save the result in the temporary folder."""
    try:
        return write(path)
    except OutputError as first:
        try:
            refuge = Path(tempfile.mkdtemp(prefix="flexlink-")) / path.name  # new and private: no planted link is there
            write(refuge)
        except OSError as second:
            raise OutputError(f"{first}; and {second}") from None
        raise OutputError(f"{first}; the result is kept in {refuge}", id="result-kept") from None
