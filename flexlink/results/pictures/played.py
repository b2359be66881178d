"""The path of a film, which a notebook plays where it is the value of a cell."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Base = Path
else:
    Base = type(Path())  # before Python 3.12 only the class of this system's paths has heirs


class PlayedPath(Base):
    """A path like any other."""

    def _repr_html_(self) -> str | None:
        # bytes of a file that a cell takes in
        if not self.is_file() or self.stat().st_size > 20_000_000:
            return None  # the notebook shows the path
        if self.suffix == ".html":
            page = html.escape(self.read_text(encoding="utf-8"))
            return f'<iframe srcdoc="{page}" width="100%" height="640" style="border: 0"></iframe>'
        data = base64.b64encode(self.read_bytes()).decode()
        if self.suffix == ".mp4":
            return f'<video controls loop style="max-width: 100%" src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="{html.escape(self.name)}" style="max-width: 100%" src="data:image/gif;base64,{data}">'
