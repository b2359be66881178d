"""The page of the Python interface: every public name, grouped by purpose."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import ModuleType

import flexlink as fl
from docs.generators.rest import directive, heading

GROUPS = tomllib.loads((Path(__file__).parent / "api.toml").read_text(encoding="utf-8"))["group"]

INTRO = """\
``import flexlink as fl`` provides all names below; rarer ones are in modules, for example ``fl.fits``. Arrays are
NumPy float64 arrays. Units are SI and radians unless a name ends in ``_deg`` or ``_hz``. Symbols, signs and frames:
:doc:`notation`. Functions of a state take ``q``, ``qd``, … of shape ``(n,)``, or of several states, ``(b, n)``.

The examples use these objects:

.. literalinclude:: ../../../tests/support/prepared.py
   :language: python
   :start-at: import numpy
"""


def page(_: Path) -> str:
    """Return the groups of names; each name has its own page."""
    parts = [heading("Python"), INTRO]
    for group in GROUPS:
        parts.append(heading(group["title"], 1))
        parts.append(_list([path for name in group["names"] for path in _paths(name)]))
    return "\n".join(parts)


def _paths(name: str) -> list[str]:
    """Public paths of a name; for a module, the paths of its names."""
    thing = getattr(fl, name)
    if not isinstance(thing, ModuleType):
        return [f"flexlink.{name}"]
    return [f"flexlink.{name}.{one}" for one in thing.__all__ if one not in fl.__all__]


def path_of(name: str) -> str | None:
    """Public path of a name, or None."""
    paths = [path for each in fl.__all__ for path in _paths(each)]
    return next((path for path in paths if path.rpartition(".")[2] == name), None)


def _list(names: list[str]) -> str:
    return directive("autosummary", body="\n".join(names), toctree="api", nosignatures="")
