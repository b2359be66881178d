"""Progress of long computations, shown in one terminal line that is redrawn in place."""

import os
import sys
import time


class Line:
    """One line on stderr that is redrawn in place; nothing is shown if stderr is not a terminal."""

    def __init__(self) -> None:
        self.shown = sys.stderr.isatty()
        self._drawn = 0  # number of characters on the line

    @property
    def width(self) -> int:
        """Number of characters that fit; the last column is left free because some terminals wrap there."""
        try:
            columns = os.get_terminal_size(sys.stderr.fileno()).columns
        except OSError:
            columns = 0
        return max(columns or 80, 2) - 1  # a terminal of unknown size reports 0 columns

    def draw(self, text: str) -> None:
        """Replace the line by as much of `text` as fits."""
        if self.shown:
            text = text[: self.width]
            print(f"\r{text:<{self._drawn}}", end="", file=sys.stderr, flush=True)
            self._drawn = len(text)

    def clear(self) -> None:
        """Clear the line for the next output."""
        if self._drawn:
            self.draw("")
            print("\r", end="", file=sys.stderr, flush=True)


class Progress(Line):
    """Progress bar with fraction done, elapsed and remaining time; `done` is the fraction done in earlier sessions.

    If the work consists of `parts`, which are called `what`, it also shows how many of them are done per second.
    """

    def __init__(
        self, name: str, done: float = 0.0, *, redraw_after: float = 0.1, parts: int = 0, what: str = ""
    ) -> None:
        super().__init__()
        self._name, self._done, self._started, self._next = name, done, time.perf_counter(), 0.0
        self._parts, self._what = parts, what
        self._redraw_after = redraw_after  # shortest time between redraws [s]

    def report(self, line: str) -> None:
        """Print a line on stderr in place of the bar."""
        self.clear()
        print(line, file=sys.stderr, flush=True)

    def __call__(self, fraction: float, name: str = "") -> None:
        """Show that `fraction` of the work is done, and the `name` of the next part."""
        self._name = name or self._name
        now = time.perf_counter()
        if now >= self._next or fraction == 1:
            self._next = now + self._redraw_after
            elapsed = now - self._started
            rate = rate_text((fraction - self._done) * self._parts, elapsed, self._what) if self._parts else ""
            self.draw(progress_text(self._name, fraction, elapsed, self.width, self._done, rate))


def rate_text(count: float, elapsed: float, what: str) -> str:
    """Parts per second, such as 5,120 members/s or 0.25 members/s; empty if none is done."""
    rate = count / elapsed if elapsed > 0 else 0.0
    return f"{rate:,.0f} {what}/s" if rate >= 10 else f"{rate:.2g} {what}/s" if rate > 0 else ""


def progress_text(name: str, fraction: float, elapsed: float, width: int, done: float = 0.0, rate: str = "") -> str:
    """The progress line of a run that went from `done` to `fraction` in `elapsed` s, at most `width` characters."""
    left = f", {clock(elapsed * (1 - fraction) / (fraction - done))} left" if fraction > done else ""
    tail = f"{fraction:4.0%} {clock(elapsed)}{left}{', ' if rate else ''}{rate}"
    room = width - len(tail) - 1
    if len(name) > room // 2:
        name = name[: max(room // 2 - 1, 0)] + "…"
    cells = min(room - len(name) - 3, 30)
    if cells < 4:
        return f"{name} {tail}"[:width]
    filled = int(cells * fraction)
    return f"{name} [{'█' * filled}{'·' * (cells - filled)}] {tail}"


def clock(seconds: float) -> str:
    """A duration in clock format: 0:07, 12:34, 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
