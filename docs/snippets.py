"""Pages whose commands and Python run while they are read: what they print, and what they draw, is never typed in.

A fenced block of ``sh``, ``python`` or ``toml`` is followed by one of these comments, which the build replaces:

    <!-- output -->                       what the block printed
    <!-- table -->                        what the block printed, a table or text in Markdown
    <!-- picture: FILE | caption -->      the picture or film that it wrote

With ``folded`` before it, as in ``<!-- folded picture: … -->``, the result comes first, and the code is folded below
it; ``<!-- folded -->`` alone folds code without a result. All blocks of a page run in its order, in one folder, which
holds `models/`, and Python blocks share their names. A block of ``toml`` whose first line is ``# file: NAME`` writes
that file. `tests/test_pages.py` runs all blocks of all pages. A build that runs none says so in place of each result.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flexlink.cli.main import main

ROOT = Path(__file__).parents[1]
FOLDER = "FLEXLINK_PAGES"
"""Variable of the environment: where the code of pages runs; without it the build runs none."""
BLOCK = re.compile(
    r"^```(sh|python|toml)\n(.*?)^```\n(?:\n?<!-- (folded|(?:folded )?(?:output|table|picture: [^>]*?)) -->\n)?",
    re.DOTALL | re.MULTILINE,
)


class SnippetError(Exception):
    """A block of a page that does not run; the message says which."""


@dataclass
class Page:
    """The blocks of one page, run one after the other in a folder of their own."""

    name: str
    folder: Path
    names: dict[str, Any] = field(default_factory=dict)

    def run(self, kind: str, code: str) -> str:
        """What one block prints."""
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
        return ""

    def _command(self, line: str) -> None:
        words = shlex.split(line, comments=True)
        if words[:1] == ["flexlink"]:
            try:
                code = main(words[1:])
            except SystemExit as end:  # of --version and --help
                code = int(end.code or 0)
            expected = 1 if line.rstrip().endswith("# exit code 1") else 0
            if code != expected:
                raise SnippetError(f"{self.name}: {line}: exit code {code}")


def blocks(text: str) -> Iterator[tuple[str, str, str]]:
    """Kind, code and comment of every block that could run."""
    for found in BLOCK.finditer(text):
        yield found[1], found[2], found[3] or ""


def prepare(folder: Path) -> None:
    """Put what pages take for granted into a folder: scenes, and files to read."""
    for name in ("models", "docs/steel_strips.toml"):
        place = folder / name
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, place)


def filled(name: str, text: str, folder: Path, pictures: Path) -> str:
    """The text of a page with its outputs and pictures put in."""
    page = Page(name, folder)

    def with_result(found: re.Match[str]) -> str:
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

    return BLOCK.sub(with_result, text)


UNRUN = "*What this shows stands on the whole site: `python -m docs`.*"
"""In place of results where no code runs."""


def unrun(text: str) -> str:
    """The text of a page with a line in place of every output and picture."""

    def with_line(found: re.Match[str]) -> str:
        block = f"```{found[1]}\n{found[2]}```\n"
        return f"{block}\n{UNRUN}\n" if (found[3] or "folded") != "folded" else block

    return BLOCK.sub(with_line, text)


def _figure(name: str, folder: Path, pictures: Path, wanted: str) -> str:
    """A file of a page's folder, kept with the site's pictures, and its caption."""
    file, _, caption = (part.strip() for part in wanted.partition("|"))
    pictures.mkdir(parents=True, exist_ok=True)
    stored = pictures / f"{Path(name).name}_{Path(file).name}"
    shutil.copy(folder / file, stored)
    shown = os.path.relpath(stored, (ROOT / "docs" / name).parent)
    return f":::{{figure}} {shown}\n:alt: {caption}\n{caption}\n:::\n"


def setup(app: Any) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _read(app: Any, name: str, source: list[str]) -> None:
    if FOLDER not in os.environ:
        source[0] = unrun(source[0])
    elif any(comment for _, _, comment in blocks(source[0])):
        folder = Path(os.environ[FOLDER]) / name.replace("/", "_")
        folder.mkdir(parents=True, exist_ok=True)
        prepare(folder)
        source[0] = filled(name, source[0], folder, Path(app.srcdir) / "pictures")
