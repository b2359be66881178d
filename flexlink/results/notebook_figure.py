"""A figure that a notebook shows once, as the value of its cell, with any backend of matplotlib."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TypeVar, cast

import matplotlib as mpl
from matplotlib.figure import Figure

Draw = TypeVar("Draw", bound=Callable[..., object])


def literal(draw: Draw) -> Draw:
    """Let a function that draws show every `$` in a name as a `$`, not as the start of mathematics."""
    return cast(Draw, mpl.rc_context({"text.parse_math": False})(draw))


class NotebookFigure(Figure):  # type: ignore[misc]  # mypy does not read matplotlib's types
    """A figure that pyplot does not manage, since pyplot would draw it again at the end of the cell."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
