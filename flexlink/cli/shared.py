"""What commands share: errors that name the scene's file, places to write to, pictures."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.output import write_or_keep
from flexlink.motion.result import picture_format, plotting

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextlib.contextmanager
def about(path: Path) -> Iterator[None]:
    """Let what goes wrong with a scene after it was read name its file, too."""
    try:
        yield
    except FlexlinkError as error:
        error.args = (f"{path}: {error}",)
        raise


def draw(figure: Figure, path: Path) -> None:
    """Write a picture to its file."""
    write_or_keep(path, lambda place: figure.savefig(place, dpi=150))
    print(f"plot: {path}")


def require_place(path: Path) -> None:
    """What can be known before the work: that the folder is there, and that no folder has the file's name."""
    if not path.parent.is_dir():
        raise ArgumentError(f"{path}: the folder {str(path.parent)!r} does not exist")
    if path.is_dir():
        raise ArgumentError(f"{path}: is a folder; name a file")


def require_picture(path: Path | None) -> None:
    """Know before the work that a picture can be drawn and written."""
    if path is not None:
        picture_format(path)
        require_place(path)
        plotting()
