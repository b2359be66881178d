"""Terminal output of the command line other than results: compilation progress, and warnings in one line."""

import contextlib
import sys
import threading
import time
import warnings
from collections.abc import Iterator

import numpy as np

from flexlink.common.progress import Line, clock
from flexlink.kernels.tools.compiler import watched


class Compiling(Line):
    """Shows that machine code is being compiled, by a running clock on a terminal, else by one line per process."""

    TEXT = "compiling for this machine; the result is stored, later runs start at once …"

    def __init__(self) -> None:
        super().__init__()
        self._announced, self._seconds = False, 0.0
        self._over = threading.Event()
        self._ticker: threading.Thread | None = None

    def started(self) -> None:
        """Show that a compilation has started."""
        if not self.shown:
            if not self._announced:
                print(self.TEXT, file=sys.stderr, flush=True)
            self._announced = True
            return
        self._since = time.perf_counter()
        self._over = threading.Event()
        self._tick()
        self._ticker = threading.Thread(target=self._tick_on, args=(self._over,), daemon=True)
        self._ticker.start()

    def ended(self) -> None:
        """Clear the line when a compilation has ended; others may follow."""
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
    """Announce compilations; print Python warnings in one line, but not NumPy's: errors report such numbers."""

    def show(message: Warning | str, *_: object) -> None:
        print(f"flexlink: warning: {' '.join(str(message).split())}", file=sys.stderr)

    compiling = Compiling()
    with warnings.catch_warnings(), watched(compiling.started, compiling.ended), np.errstate(all="ignore"):
        warnings.showwarning = show  # type: ignore[assignment]
        yield
