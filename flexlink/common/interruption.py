"""Handle Ctrl-C (SIGINT) and SIGTERM: stop at once, or after results are saved; imported before any slow import.

Code with results to save runs inside `deferred()`, where the signals are only recorded. The command line calls
`quit_at_once()` while it has no results; a signal then ends the process with one line and no traceback, even inside a
compiler that swallows exceptions. Signals that a program handles itself, or ignores (as under `nohup`), are unchanged.
"""

import _signal  # type: ignore[import-not-found]  # faster than `signal`, whose enums cost 20 µs per run
import contextlib
import itertools
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

SIGNALS = {int(signal.SIGINT): signal.default_int_handler, int(signal.SIGTERM): signal.SIG_DFL}  # Python's handlers
LAST = 3  # the third signal of one kind quits at once


class Stop:
    """Whether the process was asked to stop, and the number of the first `signal` that did so, or None."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._counts = dict.fromkeys(SIGNALS, 0)

    @property
    def requested(self) -> bool:
        """Whether a signal has arrived."""
        return self.signal is not None

    def _note(self, number: int, _: FrameType | None) -> None:
        self.signal = self.signal or number
        self._counts[number] += 1
        if self._counts[number] == LAST - 1:
            _print_line("saving the results; one more signal quits without them")
        if self._counts[number] >= LAST:
            raise StoppedError(number, f"{word(number)} at once")


class StoppedError(KeyboardInterrupt):
    """A signal ended the program before results were saved; `signal` is its number."""

    def __init__(self, number: int, text: str) -> None:
        super().__init__(text)
        self.signal = number


_active: Stop | None = None  # the `Stop` of the outermost `deferred()`
_finished = False  # whether the command line has saved all results


class _Deferred:
    """Context of `deferred`; a class, since a generator takes twice as long to enter and leave."""

    def __enter__(self) -> Stop:
        global _active  # noqa: PLW0603  signal handlers also belong to the process
        self._stop = _active or Stop()
        self._outermost = _active is None and threading.current_thread() is threading.main_thread()
        if self._outermost:
            self._handlers = {number: _signal.getsignal(number) for number in SIGNALS if _is_ours(number)}
            try:
                _active = self._stop
                for number in self._handlers:
                    _signal.signal(number, self._stop._note)
            except BaseException:  # a signal that arrives just before its handler
                self.__exit__(BaseException)
                raise
        return self._stop

    def __exit__(self, kind: object, *_: object) -> None:
        global _active  # noqa: PLW0603
        if not self._outermost:
            return
        _active = None
        for number, handler in self._handlers.items():
            _signal.signal(number, handler)
        if kind is None and self._stop.signal is not None:
            signal.raise_signal(self._stop.signal)


def deferred() -> _Deferred:
    """Only record SIGINT and SIGTERM, in the `Stop` that the block receives.

    The body checks `stop.requested`, finishes its current work and raises an error that contains the results, such as
    `InterruptedRunError`. If the body does not raise an exception, a recorded signal is sent again after the block, so
    it is not lost. A second signal of a kind prints a warning; the third raises `StoppedError` (a KeyboardInterrupt).

    Only the main thread can set signal handlers, so nothing is deferred in other threads. Within another `deferred()`,
    and in threads that run at the same time, `stop` is the object of the outermost block.
    """
    return _Deferred()


def quit_at_once() -> None:
    """Let any later signal outside `deferred()` end the process, with one line on stderr and exit code 128 + signal."""
    for number in SIGNALS:
        if _is_ours(number):
            signal.signal(number, _quit)


def finish() -> None:
    """Ignore further signals, because all results are saved and the process is about to end."""
    global _finished  # noqa: PLW0603
    _finished = True
    for number in SIGNALS:
        if signal.getsignal(number) is _quit:
            signal.signal(number, signal.SIG_IGN)  # while exiting, Python restores the default, which ends the process


def word(number: int) -> str:
    """The effect of a signal on a run, for messages."""
    return "terminated" if number == signal.SIGTERM else "interrupted"


def _is_ours(number: int) -> bool:
    """Whether the handler of a signal is Python's default or the one set by `quit_at_once`."""
    return _signal.getsignal(number) in (SIGNALS[number], _quit)


def _quit(number: int, _: FrameType | None) -> None:
    """End the process with `os._exit`, because callbacks from C, such as a compiler's, swallow exceptions."""
    if _finished:
        return
    with contextlib.suppress(Exception):  # flush earlier output; fails if the signal interrupted a write
        sys.stdout.flush()
    _print_line(word(number) + ("; no samples yet" if "simulate" in sys.argv[1:2] else ""))
    os._exit(128 + number)


def _print_line(text: str) -> None:
    """Write one line to stderr, bypassing Python's buffers, which the signal may have interrupted."""
    with contextlib.suppress(OSError):
        os.write(2, f"{chr(10) if os.isatty(2) else ''}flexlink: {text}\n".encode())


def is_command(arguments: Sequence[str], words: Sequence[str]) -> bool:
    """Whether this is the command line, not a user's program; while Python finds the module, `argv[0]` is "-m"."""
    program = Path(arguments[0]).stem if arguments else ""
    return program == "flexlink" or (program == "-m" and ("-m", "flexlink") in itertools.pairwise(words))


if is_command(sys.argv, sys.orig_argv):
    quit_at_once()
