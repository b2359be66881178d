"""Colours and markers of all figures, as data: one name, colour and marker an engine, whoever draws it.

Okabe and Ito's palette (2008), which stays apart for the common kinds of colour blindness.
"""

from __future__ import annotations

from typing import NamedTuple

INK, PAPER = "#1c2024", "#fefefe"  # text and ground of the files; a page replaces both by its own
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
GREY, PALE = "#8a8f94", "#d8dcdf"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
MARKERS = ("o", "s", "^", "D", "v", "P")


class Look(NamedTuple):
    """How a program is called and drawn."""

    name: str
    colour: str
    marker: str


ENGINES = {
    "native": Look("flexlink", BLUE, "o"),
    "pinocchio": Look("Pinocchio", VERMILION, "s"),
    "mujoco": Look("MuJoCo", PURPLE, "D"),
    "drake": Look("Drake", ORANGE, "v"),
    "exudyn": Look("Exudyn", SKY, "P"),
    "solvers": Look("SciPy, CVODE", GREEN, "^"),
    "mpmath": Look("50 digits", INK, "X"),
}
"""Name of an engine in stored results → its look."""


def look_of(engine: str) -> Look | None:
    """The look of an engine by its stored name, its own name or its package's; None of what is no engine."""
    aliases = {"flexlink": "native", "pin": "pinocchio", "scipy": "solvers", "cvode": "solvers", "sundials": "solvers"}
    name = engine.lower()
    return ENGINES.get(aliases.get(name, name))


def engine_name(engine: str) -> str:
    """The name that figures and tables give an engine."""
    look = look_of(engine)
    return look.name if look else engine
