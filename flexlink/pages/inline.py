"""A figure's SVG as it stands in the page: the page's ink and ground, and nothing written twice.

matplotlib names letters, markers and clips by what they are, so that one name means one thing in all figures: the
page holds each of them once. What is left is written as short as the eye allows, to a tenth of a point.
"""

from __future__ import annotations

import html
import re
from itertools import groupby

from flexlink.pages.colours import BLUE, INK, PAPER

USE = re.compile(r'(<use href="[^"]*"(?: [xy]="[^"]*")*)( style="[^"]*")?/>')


def inline(svg: str, title: str, definitions: dict[str, str]) -> str:
    """The `svg` element for a page; what other figures may use, too, joins `definitions`."""
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = svg.replace("xlink:href", "href").replace("DejaVuSans", "D")
    for colour, own in ((INK, "currentColor"), (PAPER, "var(--ground)"), (BLUE, "var(--blue)")):
        svg = svg.replace(colour, own)
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
    """Numbers to a tenth; lines that follow each other without their letters."""
    tenths = re.sub(r"(\.\d)\d+", r"\1", numbers)
    return tenths.strip() if re.search("[CQ]", tenths) else re.sub(r"\s*L ", " ", tenths).strip()


def _shared(found: re.Match[str], definitions: dict[str, str]) -> str:
    definitions[found[1] or found[2]] = re.sub(r"\n\s*", " ", found[0])
    return ""


def _same_style_once(uses: re.Match[str]) -> str:
    """Neighbours of one style in a group that has it."""
    pairs = USE.findall(uses[0])
    groups = ((style, "".join(f"{use}/>" for use, _ in same)) for style, same in groupby(pairs, lambda pair: pair[1]))
    return "".join(f"<g{style}>{same}</g>" if style else same for style, same in groups)
