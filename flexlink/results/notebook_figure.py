"""A figure that a notebook shows once, as the value of its cell, whatever backend is set."""

from __future__ import annotations

import io

from matplotlib.figure import Figure


class NotebookFigure(Figure):  # type: ignore[misc]  # matplotlib has types that mypy is not asked to read
    """Not known to pyplot, which would draw it again at the end of the cell."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
