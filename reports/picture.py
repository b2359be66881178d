"""A figure with what the page says about it, and the files it becomes."""

from __future__ import annotations

import dataclasses
import io
import re
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from flexlink.output import write_text, write_whole
from reports.style import BLUE, INK, PAPER, RC

PNG_DPI = 160


@dataclasses.dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Attributes
    ----------
    name
        Name of its files, without ending.
    figure
        What is drawn.
    caption
        What it shows and how to read it; also the text for those who cannot see it.
    """

    name: str
    figure: Figure
    caption: str

    def save_png(self, path: Path) -> None:
        """Write a PNG of `PNG_DPI` dots an inch."""

        def write(file: Path) -> None:
            self.figure.savefig(file, format="png", dpi=PNG_DPI, metadata={"Software": None})

        with mpl.rc_context(RC):
            write_whole(path, write)

    def save(self, folder: Path) -> str:
        """Write the PNG and the SVG file; returns the SVG for the page, with the page's own ink and ground."""
        self.save_png(folder / f"{self.name}.png")
        self.figure.set_layout_engine("none")  # the layout is found by now; finding it again takes as long as drawing
        buffer = io.StringIO()
        with mpl.rc_context(RC):
            self.figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        svg = buffer.getvalue()
        write_text(folder / f"{self.name}.svg", svg)
        return self._for_page(svg)

    def _for_page(self, svg: str) -> str:
        """Only the element; `id`s made unique among all figures of a page; ink, ground and blue left to the page."""
        svg = svg[svg.index("<svg") :]
        svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
        svg = re.sub(r'\b(id="|xlink:href="#|url\(#)', rf"\g<1>{self.name}-", svg)
        svg = re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', r'<svg \1 role="img" focusable="false">', svg, count=1)
        for colour, name in ((INK, "currentColor"), (PAPER, "var(--ground)"), (BLUE, "var(--blue)")):
            svg = svg.replace(colour, name)
        return svg.replace("xlink:href", "href")
