"""What the command line shows while it works: one line on the terminal, redrawn in place."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
import warnings
from collections.abc import Iterator

from flexlink.kernels.tools.compiler import watched

REDRAWN = 0.1  # at least so long a line stays [s]


class Line:
    """One line of stderr that is redrawn; silent where stderr is no terminal."""

    def __init__(self) -> None:
        self.shown = sys.stderr.isatty()
        self._drawn = 0  # letters that are there

    @property
    def width(self) -> int:
        """Letters that fit; the last column is left free, since some terminals start a new line there."""
        try:
            return max(os.get_terminal_size(sys.stderr.fileno()).columns, 2) - 1
        except OSError:
            return 79

    def draw(self, text: str) -> None:
        """Show `text`, as much of it as fits, in place of what was there."""
        if self.shown:
            text = text[: self.width]
            print(f"\r{text:<{self._drawn}}", end="", file=sys.stderr, flush=True)
            self._drawn = len(text)

    def clear(self) -> None:
        """Leave an empty line to who writes next."""
        if self._drawn:
            self.draw("")
            print("\r", end="", file=sys.stderr, flush=True)


class Progress(Line):
    """How far a run is, for how long it has been running, and how long it will take; `done` was done before."""

    def __init__(self, name: str, done: float = 0.0) -> None:
        super().__init__()
        self._name, self._done, self._started, self._next = name, done, time.perf_counter(), 0.0

    def __call__(self, fraction: float) -> None:
        """Show that `fraction` of the work is done."""
        now = time.perf_counter()
        if now >= self._next or fraction == 1:
            self._next = now + REDRAWN
            self.draw(progress_text(self._name, fraction, now - self._started, self.width, self._done))


def progress_text(name: str, fraction: float, elapsed: float, width: int, done: float = 0.0) -> str:
    """The line of a run that has gone from `done` to `fraction` of its work in `elapsed` s, at most `width` letters."""
    left = f", {clock(elapsed * (1 - fraction) / (fraction - done))} left" if fraction > done else ""
    tail = f"{fraction:4.0%} {clock(elapsed)}{left}"
    room = width - len(tail) - 1
    if len(name) > room // 2:
        name = name[: max(room // 2 - 1, 0)] + "…"
    cells = min(room - len(name) - 3, 30)
    if cells < 4:
        return f"{name} {tail}"[:width]
    filled = int(cells * fraction)
    return f"{name} [{'█' * filled}{'·' * (cells - filled)}] {tail}"


def clock(seconds: float) -> str:
    """A time as a clock shows it: 0:07, 12:34, 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Compiling(Line):
    """Says that machine code is being made, when that starts, and on a terminal for how long."""

    TEXT = "compiling the solver for this machine (once, up to a minute) …"

    def __init__(self) -> None:
        super().__init__()
        self._said, self._seconds = False, 0.0
        self._over = threading.Event()
        self._ticker: threading.Thread | None = None

    def started(self) -> None:
        """Something is about to be compiled."""
        if not self.shown:
            if not self._said:
                print(self.TEXT, file=sys.stderr, flush=True)
            self._said = True
            return
        self._since = time.perf_counter()
        self._over = threading.Event()
        self._tick()
        self._ticker = threading.Thread(target=self._tick_on, args=(self._over,), daemon=True)
        self._ticker.start()

    def ended(self) -> None:
        """It is there; further pieces may follow."""
        if self._ticker is not None:
            self._over.set()
            self._ticker.join()
            self._ticker = None
            self._seconds += time.perf_counter() - self._since
            self.clear()

    def _tick(self) -> None:
        self.draw(f"compiling for this machine, once: {clock(self._seconds + time.perf_counter() - self._since)}")

    def _tick_on(self, over: threading.Event) -> None:
        while not over.wait(0.5):
            self._tick()


@contextlib.contextmanager
def announced() -> Iterator[None]:
    """Say when machine code is being made, and put every warning into one line."""

    def show(message: Warning | str, *_: object) -> None:
        print(f"flexlink: warning: {' '.join(str(message).split())}", file=sys.stderr)

    compiling = Compiling()
    with warnings.catch_warnings(), watched(compiling.started, compiling.ended):
        warnings.showwarning = show  # type: ignore[assignment]
        yield
