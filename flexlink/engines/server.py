"""The process of an `IsolatedEngine`: it loads an engine and answers until nobody is there to ask.

    python -m flexlink.engines.server FILE_DESCRIPTOR SECONDS

The system's own timer ends it if an answer takes longer than it may: code that hangs, or holds Python's lock, cannot
keep it alive. Ctrl-C ends it at once, in whatever code it is.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from multiprocessing.connection import Connection
from typing import Any

from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.engines import load_here


def serve(pipe: Connection, seconds: float) -> None:
    """Answer questions (seconds, name, arguments, named) with values, or with the errors that they raise."""
    engine: Any = None
    name = ""
    signal.setitimer(signal.ITIMER_REAL, seconds)  # from here to the first answer
    while True:
        try:
            seconds, question, arguments, named = pipe.recv()
        except EOFError:
            return
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            if question == "load":
                name = arguments[0]
                engine = load_here(*arguments)
                answer: object = engine.version, engine.n
            else:
                answer = getattr(engine, question)(*arguments, **named)
        except FlexlinkError as error:
            answer = error
        except Exception as error:
            told = " ".join(str(error).split())
            answer = EngineError(f"{name}, asked to {question.replace('_', ' ')}: {type(error).__name__}: {told}")
        pipe.send(answer)
        signal.setitimer(signal.ITIMER_REAL, 0)


def _end_with_parent() -> None:
    """Standard input ends when the process that asks does."""
    sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    serve(Connection(int(sys.argv[1])), float(sys.argv[2]))
