"""Read third-party XML with the standard library's parser, and refuse harmful constructs.

A DOCTYPE, and so every entity, is refused where it begins, before anything is expanded or fetched. The size of
the text, and the number and depth of elements, are limited, which also limits memory.
"""

import re
from collections.abc import Mapping
from xml.etree import ElementTree as ET
from xml.parsers import expat

from flexlink.common.errors import DataFileError
from flexlink.common.wording import truncated

LARGEST = 5_000_000  # bytes; a robot with a thousand links has half a megabyte
MOST_ELEMENTS = 200_000  # and attributes; together they take about 100 MB of memory
LARGEST_NUMBER = 1e9  # SI; more than any value of a robot, and small enough that derived values fit into float64
DEEPEST = 1000  # levels of nested elements; MuJoCo reads 500


def parse(text: str | bytes, what: str, *, namespaces: bool = True) -> ET.Element:
    """Return the root of an XML document called `what`, without comments and processing instructions.

    Bytes contain a declaration of their encoding (default UTF-8). With `namespaces`, `p:name` is read as `{namespace of
    p}name`. If not, names stay as written, prefixes need no declaration, and white space before the declaration of XML
    is skipped, as robot files of other programs need.
    """
    try:
        data = text if isinstance(text, bytes) else text.encode()
        if len(data) > LARGEST:
            raise DataFileError(f"{what}: {len(data)} bytes; at most {LARGEST} are read", id="file-too-large")
        if not namespaces and data.lstrip().startswith(b"<?xml"):
            data = data.lstrip()
        parser = expat.ParserCreate(None if isinstance(text, bytes) else "utf-8", "}" if namespaces else None)
        builder = _Elements(what, parser)
        parser.StartDoctypeDeclHandler, parser.CharacterDataHandler = builder.doctype, builder.data
        parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
        parser.Parse(data, True)
        return builder.close()
    except (expat.ExpatError, ValueError, LookupError) as error:  # ValueError: surrogates, encodings that expat lacks
        if isinstance(error, DataFileError):
            raise
        scene = "; a scene (.toml) is written as URDF by flexlink export" if what.endswith(".toml") else ""
        reason = " ".join(str(error).split())
        if reason.startswith("mismatched tag") and builder.opened:
            tag, line = builder.opened[-1]
            scene = scene or f"; <{tag}>, opened in line {line}, is not closed before"
        scene = scene or "; the file ends before all its elements do; is it complete?" * reason.startswith("no element")
        raise DataFileError(f"{what}: not XML: {reason}{scene}", id="not-xml") from None


def numbers_of(text: str) -> list[float] | None:
    """The decimal numbers in a text, separated by spaces; None if it contains anything else. Overflow gives infinity.

    Python's `float` also accepts `1_0`, `nan` and digits of any script, which other programs refuse.
    """
    words = text.split()
    number = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)  # matches in one way, so in linear time
    return [float(word) for word in words] if all(map(number.fullmatch, words)) else None


def numbers_in(text: str, about: str, count: int = 1, largest: float = LARGEST_NUMBER) -> list[float]:
    """Return this many numbers of a text, whose place is `about`."""
    values = numbers_of(text)
    if values is None or len(values) != count:
        wanted = "a finite number" if count == 1 else f"{count} finite numbers separated by blanks"
        raise DataFileError(f"{about} = {truncated(text)}: expected {wanted}", id="number-in-file")
    if max(map(abs, values)) > largest:
        raise DataFileError(f"{about} = {truncated(text)}: must be at most {largest:g} (SI units)", id="number-in-file")
    return values


class _Elements(ET.TreeBuilder):
    """Builder that keeps only elements, and limits their number and depth."""

    def __init__(self, what: str, parser: expat.XMLParserType) -> None:
        super().__init__()
        self.what, self.parser, self.count = what, parser, 0
        self.opened: list[tuple[str, int]] = []

    def doctype(self, name: str, *_: object) -> None:
        text = f"{self.what}: contains <!DOCTYPE {name[:60]}>; remove it and all entities"
        raise DataFileError(text, id="xml-entities")

    def start(self, tag: str, attributes: Mapping[str, str], /) -> ET.Element:
        self.count += 1 + len(attributes)
        self.opened.append((tag, self.parser.CurrentLineNumber))
        if self.count > MOST_ELEMENTS:
            raise DataFileError(f"{self.what}: more than {MOST_ELEMENTS} elements and attributes", id="file-too-large")
        if len(self.opened) > DEEPEST:
            text = f"{self.what}: elements are nested deeper than {DEEPEST}, at <{tag[:60]}>"
            raise DataFileError(text, id="xml-too-deep")
        return super().start(_full(tag), {_full(key): value for key, value in attributes.items()})

    def end(self, tag: str, /) -> ET.Element:
        self.opened.pop()
        return super().end(_full(tag))


def _full(name: str) -> str:
    """Return a name as ElementTree writes it, with its namespace in braces."""
    return f"{{{name}" if "}" in name else name
