"""What the exporters share: names that are valid and unique, numbers that read back exactly, indented XML."""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from flexlink.chain.arguments import given
from flexlink.chain.chain import Chain, unique

NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped."""


def valid(name: str) -> str:
    """`name` with U+FFFD for every character that XML cannot hold."""
    return NOT_XML.sub("\ufffd", name)


def xml_joint_names(chain: Chain) -> list[str]:
    """One name per coordinate, in sequential order; "universe" is Pinocchio's own."""
    given("chain", chain, Chain)
    return unique(["universe", *map(valid, chain.joint_names)])[1:]


def xml_link_names(chain: Chain) -> list[str]:
    """Names of the base, of the frame behind each coordinate, and of the tip: n + 2 of them."""
    return unique(["base_link", *(f"{name}_link" for name in xml_joint_names(chain)), "tip"])


def decimals(values: Iterable[float]) -> str:
    """Shortest decimals that read back to the same float64; adding 0.0 turns −0.0 into 0.0."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def text(root: ET.Element) -> str:
    """The document as indented UTF-8 XML, declaration included."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
