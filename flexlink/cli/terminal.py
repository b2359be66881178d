"""What the command line shows beside its results: compilation, and warnings in one line."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from flexlink.common.progress import Line, clock
from flexlink.kernels.tools.code_files import cache_folder
from flexlink.kernels.tools.compiler import watched


class Compiling(Line):
    """Says that machine code is being made: once a cache folder, and on a terminal whenever and for how long.

    Parameters
    ----------
    folder
        Says where the code is kept; asked when something is compiled.
    """

    TEXT = "compiling the solver for this machine (once, up to a minute; other kinds of runs add to it) …"

    def __init__(self, folder: Callable[[], Path] = cache_folder) -> None:
        super().__init__()
        self._folder, self._seconds = folder, 0.0
        self._unkept = False
        self._over = threading.Event()
        self._ticker: threading.Thread | None = None

    def started(self) -> None:
        """Something is about to be compiled."""
        if not self.shown:
            if not self._was_said():
                print(self.TEXT, file=sys.stderr, flush=True)
            return
        self._since = time.perf_counter()
        self._over = threading.Event()
        self._tick()
        self._ticker = threading.Thread(target=self._tick_on, args=(self._over,), daemon=True)
        self._ticker.start()

    def _was_said(self) -> bool:
        """Whether some process has said so for this folder; from now on it has."""
        folder = self._folder()
        said = folder / "announced"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            said.touch(exist_ok=False)
        except FileExistsError:
            return True
        except OSError:  # where nothing can be kept, every process compiles, and says so once
            before, self._unkept = self._unkept, True
            return before
        return False

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
    """Say when machine code is being made, put every warning into one line, and none of NumPy's.

    Numbers beyond float64 are refused where they arise.
    """

    def show(message: Warning | str, *_: object) -> None:
        print(f"flexlink: warning: {' '.join(str(message).split())}", file=sys.stderr)

    compiling = Compiling()
    with warnings.catch_warnings(), watched(compiling.started, compiling.ended), np.errstate(all="ignore"):
        warnings.showwarning = show  # type: ignore[assignment]
        yield
