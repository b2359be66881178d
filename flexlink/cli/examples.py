"""The command `flexlink examples`."""

import argparse
import fnmatch
import textwrap
import tomllib
from pathlib import Path, PurePosixPath

from flexlink.cli.shared import print_path
from flexlink.common.errors import ArgumentError
from flexlink.common.output import make_folder, write_text
from flexlink.common.wording import did_you_mean, truncated


def run_command(options: argparse.Namespace) -> int:
    """List all files, or copy the named ones into `examples/` and `models/` of a folder; replace no other file."""
    files = bundled()
    if not options.names:
        print(_listed(files))
        return 0
    texts = {path: files[path].read_text(encoding="utf-8") for path in _wanted(options.names, files)}
    for path, text in texts.items():
        there = options.out / path
        if there.exists() and (not there.is_file() or there.read_text(encoding="utf-8", errors="replace") != text):
            why = f"{there}: exists, with other content; move it, or name another folder by --out"
            raise ArgumentError(why, id="file-exists")
    for path, text in texts.items():
        there = options.out / path
        make_folder(there.parent)
        write_text(there, text)
        print_path("copied", there)
    return 0


def bundled() -> dict[str, Path]:
    """Files of the list, by their paths in a checkout; a wheel has copies of them, made when it is built."""
    package = Path(__file__).parents[1]
    copies = package / "bundled"
    root = copies if copies.is_dir() else package.parent
    patterns = ("examples/*.py", "examples/*.urdf", "models/*.toml", "models/*/*.toml")
    return {path.relative_to(root).as_posix(): path for each in patterns for path in sorted(root.glob(each))}


def _wanted(names: list[str], files: dict[str, Path]) -> list[str]:
    """Paths of the named files, and of the files that these quote, in the order of the list."""
    wanted: set[str] = set()
    for name in names:
        found = {path for path in files if name == "all" or _is_named(path, name.rstrip("/"))}
        if not found:
            known = [*dict.fromkeys(PurePosixPath(path).stem for path in files), *files]
            text = f"name = {truncated(name)}: no such script, scene or folder{did_you_mean(name, known)}"
            raise ArgumentError(f"{text}; `flexlink examples` lists them", id="unknown-name")
        wanted |= found
    while more := {path for path in files if any(_reads(files[one], path) for one in wanted)} - wanted:
        wanted |= more
    return [path for path in files if path in wanted]


def _is_named(path: str, name: str) -> bool:
    """Whether a name is the path of a file, its last part with or without ending, or a folder above it."""
    pure = PurePosixPath(path)
    return name in {path, pure.name, pure.stem, *(each.as_posix() for each in pure.parents)} - {"."}


def _reads(file: Path, path: str) -> bool:
    """Whether a file quotes the last part of a path, alone or behind a folder."""
    text, name = file.read_text(encoding="utf-8"), PurePosixPath(path).name
    return f'"{name}"' in text or f'/{name}"' in text


def _listed(files: dict[str, Path]) -> str:
    """One line per file with its title; only the names of robots, which are many."""
    robots = fnmatch.filter(files, "models/robots/*")
    lines = [f"{path:<36} {_title(file)}".rstrip() for path, file in files.items() if path not in robots]
    names = textwrap.fill(", ".join(PurePosixPath(path).stem for path in robots), 100)
    return "\n".join([*lines, "", f"models/robots/ ({len(robots)} arms and robots)", textwrap.indent(names, "  ")])


def _title(file: Path) -> str:
    """Title of a script, or what a scene, sweep or fit problem is about."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        return text.removeprefix('"""').partition("\n")[0]
    return "" if file.suffix == ".urdf" else str(tomllib.loads(text).get("about", ""))
