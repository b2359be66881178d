"""A figure with what the page says about it, the data that it is drawn from, and the files that it becomes."""

from __future__ import annotations

import dataclasses
import io
import re
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from flexlink.common.output import write_text, write_whole
from flexlink.pages.chapter import Shown
from flexlink.pages.inline import inline
from flexlink.pages.style import RC


@dataclasses.dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Attributes
    ----------
    name
        Name of its files, without ending.
    title
        What it shows, in a few words; also what those are told who cannot see it.
    figure
        What is drawn.
    caption
        How to read it.
    csv
        What it is drawn from.
    """

    name: str
    title: str
    figure: Figure
    caption: str
    csv: str

    def save_png(self, path: Path) -> None:
        """Write a PNG of 160 dots an inch."""

        def write(file: Path) -> None:
            self.figure.savefig(file, format="png", dpi=160, metadata={"Software": None})

        with mpl.rc_context(RC):
            write_whole(path, write)

    def save(self, folder: Path, definitions: dict[str, str]) -> str:
        """Write the PNG, SVG and CSV files; returns the SVG for the page, as `inline` does."""
        self.save_png(folder / f"{self.name}.png")
        self.figure.set_layout_engine("none")  # the layout is found by now; finding it again takes as long as drawing
        buffer = io.StringIO()
        with mpl.rc_context(RC):
            self.figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        write_text(folder / f"{self.name}.svg", buffer.getvalue())
        write_text(folder / f"{self.name}.csv", self.csv)
        return inline(buffer.getvalue(), self.title, definitions)

    def shown(self, folder: Path, definitions: dict[str, str]) -> Shown:
        """Write the files as `save`; returns what the page shows."""
        drawing = self.save(folder, definitions)
        files = tuple(f"{self.name}.{ending}" for ending in ("csv", "png", "svg"))
        return Shown(self.name, self.id, self.title, drawing, self.caption, files)

    @property
    def id(self) -> str:
        """The name as an element of a page may be called."""
        return re.sub(r"[^\w.-]", "_", self.name)
