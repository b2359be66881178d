"""Child processes that do not outlive their parent."""

from __future__ import annotations

import os
from multiprocessing.connection import Connection, wait
from threading import Thread


def exit_when_closed(pipe: Connection | int) -> None:
    """End this process as soon as the other end of a pipe is closed, whatever Python code it is running.

    The operating system closes that end when its owner ends, for whatever reason.

    Parameters
    ----------
    pipe
        This process's end of the pipe, or its file descriptor; nothing is ever sent through it.
    """
    Thread(target=lambda: (wait([pipe]), os._exit(1)), daemon=True).start()
