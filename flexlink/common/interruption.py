"""Ctrl-C (SIGINT) and SIGTERM, answered when nothing is lost by it: at once, or after what is there is kept.

`deferred()` is for whoever holds results: inside it the signals are only noted. `quit_at_once()` is for the command
line while it holds none: one line, no traceback, and no waiting for a compiler that swallows exceptions.
Signals that a program answers in its own way, or ignores (as under `nohup`), are left to it.
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]  # `signal` without names for numbers, which cost 20 µs a run
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

SIGNALS = {int(signal.SIGINT): signal.default_int_handler, int(signal.SIGTERM): signal.SIG_DFL}  # Python's answers
LAST = 3  # the signal of one kind that no longer waits


class Stop:
    """Whether the process was asked to stop, and by which signal first.

    Attributes
    ----------
    signal
        Number of the signal, or None.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._counts = dict.fromkeys(SIGNALS, 0)

    @property
    def asked(self) -> bool:
        """Whether a signal has come."""
        return self.signal is not None

    def _note(self, number: int, _: FrameType | None) -> None:
        self.signal = self.signal or number
        self._counts[number] += 1
        if self._counts[number] == LAST - 1:
            _say("saving the results; one more signal quits without them")
        if self._counts[number] >= LAST:
            raise StoppedError(number, f"{word(number)} at once")


class StoppedError(KeyboardInterrupt):
    """A signal that ended work of which nothing is left; `signal` is its number."""

    def __init__(self, number: int, text: str) -> None:
        super().__init__(text)
        self.signal = number


_active: Stop | None = None  # of the outermost `deferred()`
_finished = False  # whether the command line has kept all there is to keep


@contextlib.contextmanager
def deferred() -> Iterator[Stop]:
    """Let SIGINT and SIGTERM only be noted, in the `Stop` that the block is given.

    Who finds `stop.asked` finishes what is there and raises an error that holds it, such as `InterruptedRunError`. A
    signal that the body answered by no exception is sent again on leaving, so that none is swallowed. The second signal
    of a kind says that a third one does not wait: it raises `StoppedError`, a KeyboardInterrupt, on the spot.

    Handlers belong to the main thread: elsewhere nothing is deferred. Within another `deferred()`, and in threads that
    run beside it, `stop` is the outermost one's.
    """
    global _active  # noqa: PLW0603  signal handlers belong to the process, too
    if _active is not None or threading.current_thread() is not threading.main_thread():
        yield _active or Stop()
        return
    stop = Stop()
    handlers = {number: _signal.getsignal(number) for number in SIGNALS if _is_ours(number)}
    try:
        _active = stop
        for number in handlers:
            _signal.signal(number, stop._note)
        yield stop
    finally:
        _active = None
        for number, handler in handlers.items():
            _signal.signal(number, handler)
    if stop.signal is not None:
        signal.raise_signal(stop.signal)


def quit_at_once() -> None:
    """From now on a signal outside of `deferred()` ends the process: one line on stderr, exit code 128 + its number."""
    for number in SIGNALS:
        if _is_ours(number):
            signal.signal(number, _quit)


def finish() -> None:
    """All is kept, and the process is about to end: what `quit_at_once` would answer is not answered any more."""
    global _finished  # noqa: PLW0603
    _finished = True
    for number in SIGNALS:
        if signal.getsignal(number) is _quit:
            signal.signal(number, signal.SIG_IGN)  # at its end Python would put back the default, which kills


def word(number: int) -> str:
    """What a signal does to a run, in a message."""
    return "terminated" if number == signal.SIGTERM else "interrupted"


def _is_ours(number: int) -> bool:
    """Whether a signal has the answer that Python starts with, or the one of `quit_at_once`."""
    return _signal.getsignal(number) in (SIGNALS[number], _quit)


def _quit(number: int, _: FrameType | None) -> None:
    """By `os._exit`: an exception would be swallowed where Python calls back from C, as in a compiler."""
    if _finished:
        return
    with contextlib.suppress(Exception):  # what was printed so far; it fails where this signal cut in
        sys.stdout.flush()
    _say(word(number) + ("; no samples yet" if "simulate" in sys.argv[1:2] else ""))
    os._exit(128 + number)


def _say(text: str) -> None:
    """One line on stderr, past Python's buffers, which a signal may have cut into."""
    with contextlib.suppress(OSError):
        os.write(2, f"{chr(10) if os.isatty(2) else ''}flexlink: {text}\n".encode())
