"""A figure with its caption, its data, and its files."""

import dataclasses
import html
import io
import re
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexlink.common.output import write_text, write_whole
from flexlink.common.types import Array
from flexlink.pages.colours import BLUE, INK, PAPER
from flexlink.pages.style import RC, legend_over, tidy_logs
from flexlink.pages.tables import columns_csv
from flexlink.pages.verdict import Shown


@dataclasses.dataclass(frozen=True)
class Picture:
    """A figure of a report."""

    name: str  # name of the files of the figure, without extension
    title: str  # short description; also the text for screen readers
    figure: Figure  # the matplotlib figure
    caption: str  # explanation of the figure
    csv: str  # data of the figure

    def save_png(self, path: Path) -> None:
        """Write a PNG with 160 dots per inch."""
        dots, figure = 160.0, self.figure
        with mpl.rc_context(RC):
            for axes in figure.axes:
                tidy_logs(axes)
            engine = figure.get_layout_engine()
            if engine is not None and figure.axes:  # once; an engine would make `savefig` draw everything twice
                original, figure.dpi = figure.dpi, dots
                engine.execute(figure)
                figure.dpi = original
                figure.set_layout_engine(None)
            write_whole(path, lambda file: figure.savefig(file, format="png", dpi=dots, metadata={"Software": None}))

    def shown(self, folder: Path, definitions: dict[str, str]) -> Shown:
        """Write the PNG, SVG and CSV files; return the figure for the page, whose SVG is that of `inline`."""
        self.save_png(folder / f"{self.name}.png")
        buffer = io.StringIO()
        with mpl.rc_context(RC):
            self.figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
        write_text(folder / f"{self.name}.svg", buffer.getvalue())
        write_text(folder / f"{self.name}.csv", self.csv)
        drawing, id = inline(buffer.getvalue(), self.title, definitions), re.sub(r"[^\w.-]", "_", self.name)
        files = tuple(f"{self.name}.{ending}" for ending in ("csv", "png", "svg"))
        return Shown(self.name, id, self.title, drawing, self.caption, files)


def picture_of(
    name: str, title: str, caption: str, axes: Sequence[Axes], across: str, columns: Mapping[str, Array], *,
    each: bool = False,
) -> Picture:  # fmt: skip
    """Picture of panels above each other; one legend, or one for `each`; short columns of the CSV file end in nan."""
    axes[-1].set_xlabel(across)
    for panel in axes if each else axes[:1]:
        legend_over(panel, figure=None if each else panel.figure)
    csv = columns_csv({head: column.astype(float) for head, column in columns.items()})
    return Picture(name, title, axes[0].figure, caption, csv)


USE = re.compile(r'(<use href="[^"]*"(?: [xy]="[^"]*")*)( style="[^"]*")?/>')


def inline(svg: str, title: str, definitions: dict[str, str]) -> str:
    """Return the `svg` element in the page's colours; shared definitions are added to `definitions`.

    matplotlib names letters, markers and clip paths by their content, so equal names have equal definitions in all
    figures, and the page contains each only once. Coordinates are cut to 0.1 pt, which is invisible.
    """
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = svg.replace("xlink:href", "href").replace("DejaVuSans", "D")
    for colour, page_colour in ((INK, "currentColor"), (PAPER, "var(--ground)"), (BLUE, "var(--blue)")):
        svg = svg.replace(colour, page_colour)
    svg = re.sub(r' transform="translate\((\S+) 0\)"/>', r' x="\1"/>', svg)
    svg = re.sub(r'(?<= d=")[^"]*|(?<= [xy]=")[^"]*', lambda part: _short(part[0]), svg)
    definition = re.compile(r'<path id="(\w[\w-]*)"[^>]*/>|<clipPath id="(\w+)">.*?</clipPath>', re.DOTALL)
    svg = definition.sub(lambda found: _shared(found, definitions), svg)
    svg = re.sub(r'<g id="[^"]*"', "<g", svg)
    svg = re.sub(r"<defs>.*?</defs>", "", re.sub(r"\n\s*", "", svg))
    svg = re.sub(rf"(?:{USE.pattern}){{2,}}", _same_style_once, svg)
    head = rf'<svg \1 role="img" aria-label="{html.escape(title)}" class="drawing">'
    return re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', head, svg, count=1)


def _short(numbers: str) -> str:
    """Cut coordinates to 0.1 pt, and omit the letters of repeated line commands."""
    tenths = re.sub(r"(\.\d)\d+", r"\1", numbers)
    return tenths.strip() if re.search("[CQ]", tenths) else re.sub(r"\s*L ", " ", tenths).strip()


def _shared(found: re.Match[str], definitions: dict[str, str]) -> str:
    definitions[found[1] or found[2]] = re.sub(r"\n\s*", " ", found[0])
    return ""


def _same_style_once(uses: re.Match[str]) -> str:
    """Put adjacent `use` elements with the same style into one group."""
    pairs = USE.findall(uses[0])
    groups = ((style, "".join(f"{use}/>" for use, _ in same)) for style, same in groupby(pairs, lambda pair: pair[1]))
    return "".join(f"<g{style}>{same}</g>" if style else same for style, same in groups)
