"""Progress of a fit: parts that are done (initial guesses, ends of profiles), and iterations of the present part."""

from __future__ import annotations

import sys

from flexlink.common.progress import Progress


class Shown:
    """Lines of text on stderr, and below them a progress bar on a terminal."""

    def __init__(self) -> None:
        self.bar = Progress("fit")

    def __call__(self, line: str) -> None:
        """Print a line in place of the bar."""
        self.bar.clear()
        print(line, file=sys.stderr, flush=True)


class Watch:
    """Counts iterations and parts of a fit, and draws them with `bar` if there is one."""

    def __init__(self, parts: int = 1, bar: Progress | None = None) -> None:
        self.parts, self.bar = parts, bar
        self.name, self.done, self.iterations = "", 0, 0

    def begin(self, name: str) -> None:
        """Begin a part."""
        self.name, self.iterations = name, 0

    def iterated(self) -> None:
        """Count an iteration."""
        self.iterations += 1
        self._draw()

    def end(self) -> None:
        """Count a part as done."""
        self.done += 1
        self._draw()

    def _draw(self) -> None:
        if self.bar is not None:
            self.bar(self.done / self.parts, f"{self.name}, iteration {self.iterations}")
