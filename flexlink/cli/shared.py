"""Functions that commands share: scenes with `--set`, errors that name their file, outputs, plots and JSON."""

from __future__ import annotations

import argparse
import contextlib
import re
import shlex
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexlink.common.errors import ArgumentError, Diagnostic, FlexlinkError
from flexlink.common.notebook import drawing_module
from flexlink.common.output import check_writable, write_or_keep
from flexlink.common.wording import coloured, id_of
from flexlink.data.documents import shown_path
from flexlink.describe.plausibility.hints import hints
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.dynamics.notes import defaults, notes
from flexlink.results.files import ending

if TYPE_CHECKING:
    from matplotlib.figure import Figure


OF_ENGINES = {".urdf": "urdf", ".xml": "mjcf", ".sdf": "sdf"}  # formats of files of engines, by the ends of their names


def varied_scene(path: Path, options: argparse.Namespace, own: Mapping[str, object] | None = None) -> Scene:
    """Load a scene with `--set PATH=VALUE` and the changes `own` by options, and print hints on wrong units."""
    scene = load_scene(path, changes=_settings(options.set) | dict(own or {}))
    print_hints(hints(scene), options)
    return scene


def varied(path: Path, scene: Scene, settings: Sequence[str]) -> Scene:
    """Apply `--set PATH=VALUE` to the scene from `path`."""
    with prefix_errors(path):
        return scene.varied(_settings(settings)) if settings else scene


def _settings(texts: Sequence[str]) -> dict[str, Any]:
    return assignments("--set", texts, "run.step=1e-4 or 'link.*.segments=8'", "PATH=VALUE")


def assignments(option: str, texts: Sequence[str], example: str, form: str = "NAME=VALUE") -> dict[str, Any]:
    """Names and values from an option's NAME=VALUE strings; a value is TOML, or a string without quotes."""
    found: dict[str, Any] = {}
    for text in texts:
        path, equals, value = (part.strip() for part in text.partition("="))
        if re.match(r"[^\"'\[{]*,\s*[\w.*]+=", value):
            raise ArgumentError(f"{option} {text}: two in one; write {option} before each {form}", id="option-value")
        if not equals or not path or len(value.splitlines()) != 1:
            raise ArgumentError(f"{option} {text}: expected {form}, such as {example}", id="option-value")
        try:
            found[path] = tomllib.loads(f"value = {value}")["value"]
        except (ValueError, RecursionError) as error:
            if value[0] in "\"'[{":
                raise ArgumentError(f"{option} {text}: the value is not TOML: {error}", id="option-value") from None
            found[path] = value
    return found


@contextlib.contextmanager
def prefix_errors(path: Path) -> Iterator[None]:
    """Put the file's path before the message of every error."""
    try:
        yield
    except FlexlinkError as error:
        error.args = (f"{path}: {error}",)
        raise


def print_lines(word: str, texts: Iterable[str]) -> None:
    """Print notes or warnings to stderr, one per line, with their ids."""
    for text in texts:
        print(f"{coloured(word)}: {text}{id_of(text)}", file=sys.stderr, flush=True)


def print_path(what: str, path: Path) -> None:
    """Print the path of a result, relative to the current folder if it is inside this folder."""
    print(f"{what}: {shown_path(path)}")


def print_hints(found: Iterable[Diagnostic], options: argparse.Namespace) -> None:
    """Warn of numbers that are likely given in another unit, except with `--quiet-hints`."""
    if not options.quiet_hints:
        print_lines("warning", found)


def print_notes(scene: Scene) -> None:
    """Print notes on a scene: defaults that determine the result, and keys without effect."""
    print_lines("note", (*defaults(scene), *notes(scene)))


def save_plot(figure: Figure, path: Path) -> None:
    """Write a plot to its file."""
    write_or_keep(path, lambda place: figure.savefig(place, dpi=150))
    print_path("plot", path)


def require_scene(path: Path) -> None:
    """Check, before results are computed, that a scene can be written to a file, which is not of another format."""
    if path.suffix in OF_ENGINES:
        text = f"then: flexlink export SCENE.toml --format {OF_ENGINES[path.suffix]}"
        raise ArgumentError(f"{path}: a scene is written as .toml; {text}", id="unknown-format")
    require_writable(path)


def require_writable(path: Path) -> None:
    """Check, before results are computed, that a file can be written: its folder exists and is writable."""
    if not path.parent.is_dir():
        raise ArgumentError(f"{path}: there is no such folder; make it: mkdir -p {path.parent}", id="no-such-folder")
    if path.is_dir():
        raise ArgumentError(f"{path}: is a folder; name a file", id="is-a-folder")
    check_writable(path)


def require_picture(path: Path) -> None:
    """Check, before results are computed, that a plot can be drawn and written."""
    ending(path, (".png", ".svg", ".pdf"), "a picture")
    require_writable(path)
    drawing_module("results.plotting")


def command_line() -> str:
    """The command that runs, as typed in a shell."""
    return shlex.join(["flexlink", *sys.argv[1:]])


def with_ids(texts: tuple[str, ...]) -> list[dict[str, str]]:
    """Diagnostics as objects with id and text."""
    return [{"id": text.id if isinstance(text, Diagnostic) else "", "text": str(text)} for text in texts]
