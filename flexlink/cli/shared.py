"""What commands share: scenes, varied by --set, errors that name their file, places to write to, pictures."""

from __future__ import annotations

import argparse
import contextlib
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.output import check_writable, write_or_keep
from flexlink.describe.plausibility.hints import hints
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.dynamics.notes import defaults, notes
from flexlink.results.files import picture_format
from flexlink.results.trajectory import plotting

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def varied_scene(path: Path, options: argparse.Namespace, own: Mapping[str, object] | None = None) -> Scene:
    """The scene of a file with `--set PATH=VALUE`, then with what the command's own options say, values by path.

    Numbers that are likely mistaken are told.
    """
    scene = varied(path, load_scene(path), options.set, own)
    print_hints(scene, options)
    return scene


def varied(path: Path, scene: Scene, settings: Sequence[str], own: Mapping[str, object] | None = None) -> Scene:
    """The scene of `path` with `--set PATH=VALUE`, then with what the command's own options say, values by path."""
    changes = assignments("--set", settings, "run.step=1e-4 or 'link.*.segments=8'", "PATH=VALUE") | dict(own or {})
    with prefix_errors(path):
        return scene.varied(changes) if changes else scene


def assignments(option: str, texts: Sequence[str], example: str, form: str = "NAME=VALUE") -> dict[str, Any]:
    """Names and values of an option's NAME=VALUE; a value is TOML, and a bare word that is none stands for itself."""
    return dict(_assignment(option, text, example, form) for text in texts)


def _assignment(option: str, text: str, example: str, form: str) -> tuple[str, object]:
    path, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not path or len(value.splitlines()) != 1:
        raise ArgumentError(f"{option} {text}: expected {form}, such as {example}", id="option-value")
    try:
        return path, tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError) as error:
        if value[0] in "\"'[{":
            raise ArgumentError(f"{option} {text}: the value is not TOML: {error}", id="option-value") from None
        return path, value


@contextlib.contextmanager
def prefix_errors(path: Path) -> Iterator[None]:
    """Let what goes wrong with a scene after it was read name its file, too."""
    try:
        yield
    except FlexlinkError as error:
        error.args = (f"{path}: {error}",)
        raise


def print_lines(word: str, texts: Iterable[str]) -> None:
    """Notes or warnings on stderr, a line each."""
    for text in texts:
        print(f"{word}: {text}", file=sys.stderr, flush=True)


def print_hints(scene: Scene, options: argparse.Namespace) -> None:
    """Numbers that are likely given in another unit, unless nobody wants to know."""
    if not options.quiet_hints:
        print_lines("warning", hints(scene))


def print_notes(scene: Scene) -> None:
    """What is to be known of a scene before it runs: defaults that decide, and what has no effect."""
    print_lines("note", (*defaults(scene), *notes(scene)))


def draw(figure: Figure, path: Path) -> None:
    """Write a picture to its file."""
    write_or_keep(path, lambda place: figure.savefig(place, dpi=150))
    print(f"plot: {path}")


def require_writable(path: Path) -> None:
    """Know before the work that the folder is there and takes files, and that no folder has the file's name."""
    if not path.parent.is_dir():
        raise ArgumentError(f"{path}: the folder {str(path.parent)!r} does not exist", id="no-such-folder")
    if path.is_dir():
        raise ArgumentError(f"{path}: is a folder; name a file", id="is-a-folder")
    check_writable(path)


def require_picture(path: Path | None) -> None:
    """Know before the work that a picture can be drawn and written."""
    if path is not None:
        picture_format(path)
        require_writable(path)
        plotting()
