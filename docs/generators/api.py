"""The page of the Python interface: every public name, by what it is for."""

from __future__ import annotations

import tomllib
from pathlib import Path

import flexlink as fl
from docs.generators.rest import directive, heading
from flexlink import errors

GROUPS = tomllib.loads((Path(__file__).parent / "api.toml").read_text(encoding="utf-8"))["group"]

INTRO = """\
``import flexlink as fl`` gives all of these. Arrays are NumPy's, float64; SI units and radians, unless a name ends
in ``_deg`` or ``_hz``; symbols, signs and frames are those of :doc:`notation`. Functions of a state take ``q``,
``qd``, … of shape ``(n,)``, or of many states, ``(b, n)``.

What the examples find at hand is made so:

.. literalinclude:: ../../../tests/prepared.py
   :language: python
   :start-at: import numpy
"""


def page(_: Path) -> str:
    """Groups of names, each with a page of its own."""
    parts = [heading("Python"), INTRO]
    for group in GROUPS:
        parts.append(heading(group["title"], 1))
        parts.append(_list([f"flexlink.{name}" for name in _own_pages(group["names"])]))
        if "errors" in group["names"]:
            parts.append(_list([f"flexlink.errors.{name}" for name in errors.__all__ if name not in fl.__all__]))
    return "\n".join(parts)


def _own_pages(names: list[str]) -> list[str]:
    return [name for name in names if name != "errors"]


def _list(names: list[str]) -> str:
    return directive("autosummary", body="\n".join(names), toctree="api", nosignatures="")
