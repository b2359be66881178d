"""Pages whose code runs during the build, so their outputs and figures are never typed in.

A fenced block of ``sh``, ``python`` or ``toml`` is followed by one of these comments, which the build replaces:

    <!-- output -->                       printed text of the block
    <!-- table -->                        printed table or text in Markdown
    <!-- picture: FILE | caption -->      figure or film written by the block

With ``folded`` before it, as in ``<!-- folded picture: … -->``, the result comes first, and the code is folded below
it; ``<!-- folded -->`` alone folds code without a result. The blocks of a page run in order, in one folder with
a copy of `models/`, and Python blocks share their variables. A block of ``toml`` that begins with ``# file: NAME``
writes that file; any other must be a part of a scene. Commands of ``sh`` run, except those that `not_run.toml` lists
with a reason. Numbers of the text that are results are read from the program by

    <!-- check: STATEMENTS -->          Python with the variables of the page, in which every `assert` must hold

which the reader does not see. There `states(f"lowers it by {share:.0f} %")` requires that the page contains this text,
and `values(case, quantity)` are numbers of the stored study. `tests/books/test_pages.py` runs all blocks and checks.
Without running code, a build puts a note in place of each result.
"""

from __future__ import annotations

import contextlib
import fnmatch
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import flexlink
from docs.generators import study
from flexlink.cli.main import main
from flexlink.common.errors import ALSO, SceneError
from flexlink.describe.scene_file import load_scene

ROOT = Path(__file__).parents[1]
NOT_RUN = ROOT / "docs" / "not_run.toml"
FOLDER = "FLEXLINK_PAGES"
"""Environment variable with the folder in which the code of pages runs; without it no code runs."""
BLOCK = re.compile(
    r"^```(sh|python|toml)\n(.*?)^```\n(?:\n?<!-- (folded|(?:folded )?(?:output|table|picture: [^>]*?)) -->\n)?",
    re.DOTALL | re.MULTILINE,
)
PART = re.compile(rf"{BLOCK.pattern}|^<!-- check:\s(.*?)\s-->\n", re.DOTALL | re.MULTILINE)


class SnippetError(Exception):
    """A block of a page failed; the message names the page and the command."""


@dataclass
class Page:
    """Blocks of one page, run in order in a separate folder."""

    name: str
    folder: Path
    text: str = ""
    names: dict[str, Any] = field(default_factory=dict)

    def run(self, kind: str, code: str) -> str:
        """Run one block and return its printed text."""
        if kind == "toml":
            return self._write(code)
        printed = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(printed):
            if kind == "python":
                exec(compile(code, self.name, "exec"), self.names)
            else:
                for line in code.replace("\\\n", " ").splitlines():
                    self._command(line)
        return printed.getvalue()

    def _write(self, text: str) -> str:
        named = re.match(r"# file: (\S+)\n", text)
        if named:
            (self.folder / named[1]).write_text(text, encoding="utf-8")
        elif wrong := [each for each in _mistakes(text, self.folder / "part.toml") if not INCOMPLETE.search(each)]:
            raise SnippetError(f"{self.name}: {'; '.join(wrong)}")
        return ""

    def check(self, code: str) -> None:
        """Run the assertions of a comment."""
        self.names |= {"fl": flexlink, "states": self.states, "values": study.values}
        try:
            self.run("python", code)
        except AssertionError as error:
            raise SnippetError(f"{self.name}: {' '.join(code.split())}: {error}") from error

    def states(self, sentence: str) -> None:
        """Assert that the page contains this part of a sentence."""
        assert sentence in plain(self.text), f"the page does not state {sentence!r}"

    def _command(self, line: str) -> None:
        words = [name for word in shlex.split(line, comments=True) for name in _files(word) or [word]]
        if words[:1] == ["flexlink"]:
            try:
                code = main(words[1:])
            except SystemExit as end:  # --version and --help
                code = int(end.code or 0)
            expected = 1 if line.rstrip().endswith("# exit code 1") else 0
            if code != expected:
                raise SnippetError(f"{self.name}: {line}: exit code {code}")
        elif words and not not_run(line) and (words[0] != "cc" or shutil.which("cc")):
            path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
            places = {"PATH": path, "PYTHONPATH": str(ROOT)}
            run = subprocess.run(line, shell=True, cwd=self.folder, env=os.environ | places, check=False)
            if run.returncode:
                raise SnippetError(
                    f"{self.name}: {line}: exit code {run.returncode}; docs/not_run.toml does not list it"
                )


def _files(word: str) -> list[str]:
    """Files that match a word of a command, such as *.db."""
    return sorted(map(str, Path().glob(word))) if "*" in word else []


def plain(text: str) -> str:
    """Return the text of a page without blocks and checks, in one line."""
    return " ".join(PART.sub("", text).split())


def not_run(line: str) -> bool:
    """Whether a command is listed, with a reason, among those that do not run."""
    listed = tomllib.loads(NOT_RUN.read_text(encoding="utf-8"))
    command = " ".join(shlex.split(line, comments=True))
    return any(fnmatch.fnmatchcase(command, pattern) for several in listed.values() for pattern in several)


INCOMPLETE = re.compile(r": missing; |not defined; defined are none; define ")
"""Mistakes of a file that is a part of a scene."""


def _mistakes(text: str, path: Path) -> list[str]:
    path.write_text(text, encoding="utf-8")
    try:
        load_scene(path)
    except SceneError as error:
        return str(error).split(ALSO)
    return []


def blocks(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield kind, code and comment of every block that could run."""
    for found in BLOCK.finditer(text):
        yield found[1], found[2], found[3] or ""


def prepare(folder: Path) -> None:
    """Copy the scenes and files that pages use into a folder."""
    for name in ("models", "docs/steel_strips.toml"):
        place = folder / name
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, place)


def filled(name: str, text: str, folder: Path, pictures: Path) -> str:
    """Return the text of a page with its outputs and figures filled in."""
    page = Page(name, folder, text)

    def with_result(found: re.Match[str]) -> str:
        if found[4]:
            page.check(found[4])
            return ""
        kind, code, comment = found[1], found[2], found[3] or ""
        printed = page.run(kind, code)
        block, wanted = f"```{kind}\n{code}```\n", comment.removeprefix("folded").strip()
        if not comment:
            return block
        result = f"{printed.rstrip()}\n" if wanted else ""
        if wanted == "output":
            result = f"```text\n{result}```\n"
        elif wanted.startswith("picture:"):
            result = _figure(name, folder, pictures, wanted.removeprefix("picture:"))
        if wanted == comment:
            return f"{block}\n{result}"
        return f"{result}\n:::{{dropdown}} The {'file' if kind == 'toml' else 'code'}\n{block}:::\n"

    return PART.sub(with_result, text)


UNRUN = "*The complete site shows a result here: run `python -m docs`.*"
"""Text in place of results if no code runs."""


def unrun(text: str) -> str:
    """Return the text of a page with a note in place of every output and figure."""

    def with_line(found: re.Match[str]) -> str:
        if found[4]:
            return ""
        block = f"```{found[1]}\n{found[2]}```\n"
        return f"{block}\n{UNRUN}\n" if (found[3] or "folded") != "folded" else block

    return PART.sub(with_line, text)


def _figure(name: str, folder: Path, pictures: Path, wanted: str) -> str:
    """Copy a file from a page's folder to the site's pictures, and return a figure with its caption."""
    file, _, caption = (part.strip() for part in wanted.partition("|"))
    pictures.mkdir(parents=True, exist_ok=True)
    stored = pictures / f"{Path(name).name}_{Path(file).name}"
    shutil.copy(folder / file, stored)
    shown = os.path.relpath(stored, (ROOT / "docs" / name).parent)
    return f":::{{figure}} {shown}\n:alt: {caption}\n{caption}\n:::\n"


def setup(app: Any) -> dict[str, bool]:
    """Connect the extension to Sphinx."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _read(app: Any, name: str, source: list[str]) -> None:
    if FOLDER not in os.environ or not any(comment for _, _, comment in blocks(source[0])):
        source[0] = unrun(source[0])
    else:
        folder = Path(os.environ[FOLDER]) / name.replace("/", "_")
        folder.mkdir(parents=True, exist_ok=True)
        prepare(folder)
        source[0] = filled(name, source[0], folder, Path(app.srcdir) / "pictures")
