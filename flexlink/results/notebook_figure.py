"""A figure that a notebook shows once, as the value of its cell, with any backend of matplotlib."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


class NotebookFigure(Figure):  # type: ignore[misc]  # mypy does not read matplotlib's types
    """A figure that pyplot does not manage, since pyplot would draw it again at the end of the cell."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
