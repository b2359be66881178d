"""Names, colours and markers of all figures, by Okabe and Ito (2008), for all common kinds of colour vision."""

from typing import NamedTuple

INK, PAPER = "#1c2024", "#fefefe"  # text and background colours in files; a page replaces them by its colours
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
GREY, PALE = "#8a8f94", "#d8dcdf"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
MARKERS = ("o", "s", "^", "D", "v", "P")


class Look(NamedTuple):
    """Name, colour and marker of a program."""

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
"""Name, colour and marker of each engine; the keys are names in stored results."""


def look_of(engine: str) -> Look | None:
    """Look of an engine, found by its stored name, its own name or its package name; None for other names."""
    aliases = {"flexlink": "native", "pin": "pinocchio", "scipy": "solvers", "cvode": "solvers", "sundials": "solvers"}
    name = engine.lower()
    return ENGINES.get(aliases.get(name, name))


def engine_name(engine: str) -> str:
    """Name of an engine in figures and tables."""
    look = look_of(engine)
    return look.name if look else engine
