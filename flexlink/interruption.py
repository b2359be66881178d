"""stub until merge"""

import contextlib
import signal
import threading
from collections.abc import Iterator


class Stop:
    asked = False


@contextlib.contextmanager
def deferred() -> Iterator[Stop]:
    """Stub."""
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def ask(*_: object) -> None:
        stop.asked = True

    old = {s: signal.signal(s, ask) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for s, h in old.items():
            signal.signal(s, h)
