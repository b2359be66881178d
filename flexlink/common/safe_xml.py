"""XML that somebody else wrote, through the standard library's parser, with what could harm refused.

A document type, and with it every entity, is refused where it begins, before anything is expanded or fetched. Size,
number and depth of the elements are limited, so that memory is, too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.etree import ElementTree as ET

from flexlink.common.errors import DataFileError

LARGEST = 5_000_000  # bytes; a robot of a thousand links has half a megabyte
MOST_ELEMENTS = 200_000  # attributes counted, too; together some 100 MB
DEEPEST = 1000  # nested elements; MuJoCo reads 500


def parse(text: str | bytes, what: str) -> ET.Element:
    """The root of an XML document.

    Parameters
    ----------
    text
        The document; bytes say their encoding themselves (UTF-8 unless declared).
    what
        Name of the document, such as its path, for messages.

    Returns
    -------
    Element
        The root; comments and processing instructions are left out.

    Raises
    ------
    DataFileError
        The text is no XML, larger or deeper than a robot's file is, or has a DOCTYPE. One line.
    """
    try:
        data = text if isinstance(text, bytes) else text.encode()
        if len(data) > LARGEST:
            raise DataFileError(f"{what}: {len(data)} bytes; at most {LARGEST} are read", id="file-too-large")
        builder = _Elements(what)
        parser = ET.XMLParser(target=builder, encoding=None if isinstance(text, bytes) else "utf-8")
        parser.feed(data)
        return parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:  # ValueError: surrogates, encodings that expat lacks
        if isinstance(error, DataFileError):
            raise
        raise DataFileError(f"{what}: not XML: {' '.join(str(error).split())}", id="not-xml") from None


def numbers_of(text: str) -> list[float] | None:
    """The decimal numbers of a text, blanks between, beyond float64 infinite; None where anything else stands.

    Python's own `float` also takes `1_0`, `nan` and digits of any script, which other programs refuse.
    """
    words = text.split()
    number = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)  # no digit in two ways: linear time
    return [float(word) for word in words] if all(map(number.fullmatch, words)) else None


class _Elements(ET.TreeBuilder):
    """Elements only, not too many and not too deep."""

    def __init__(self, what: str) -> None:
        super().__init__()
        self.what, self.count, self.depth = what, 0, 0

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise DataFileError(
            f"{self.what}: contains <!DOCTYPE {name[:60]}>; remove it, and all entities", id="xml-entities"
        )

    def start(self, tag: str, attributes: Mapping[str, str], /) -> ET.Element:
        self.count += 1 + len(attributes)
        self.depth += 1
        if self.count > MOST_ELEMENTS:
            raise DataFileError(f"{self.what}: more than {MOST_ELEMENTS} elements and attributes", id="file-too-large")
        if self.depth > DEEPEST:
            raise DataFileError(
                f"{self.what}: elements are nested deeper than {DEEPEST}, at <{tag[:60]}>", id="xml-too-deep"
            )
        return super().start(tag, dict(attributes))

    def end(self, tag: str, /) -> ET.Element:
        self.depth -= 1
        return super().end(tag)
