"""The page of the Python interface: every public name, by what it is for."""

from __future__ import annotations

import tomllib
from pathlib import Path
from types import ModuleType

import flexlink as fl
from docs.generators.rest import directive, heading

GROUPS = tomllib.loads((Path(__file__).parent / "api.toml").read_text(encoding="utf-8"))["group"]

INTRO = """\
``import flexlink as fl`` gives all of these, rarer ones by their modules, such as ``fl.fits``. Arrays are NumPy's,
float64; SI units and radians, unless a name ends in ``_deg`` or ``_hz``; symbols, signs and frames are those of
:doc:`notation`. Functions of a state take ``q``, ``qd``, … of shape ``(n,)``, or of many states, ``(b, n)``.

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
        parts.append(_list([path for name in group["names"] for path in _paths(name)]))
    return "\n".join(parts)


def _paths(name: str) -> list[str]:
    """Where a public name is found; of a module, where all of its own are."""
    thing = getattr(fl, name)
    if not isinstance(thing, ModuleType):
        return [f"flexlink.{name}"]
    return [f"flexlink.{name}.{one}" for one in thing.__all__ if one not in fl.__all__]


def path_of(name: str) -> str | None:
    """Where a name is public; None where it is not."""
    places = [path for each in fl.__all__ for path in _paths(each)]
    return next((path for path in places if path.rpartition(".")[2] == name), None)


def _list(names: list[str]) -> str:
    return directive("autosummary", body="\n".join(names), toctree="api", nosignatures="")
