"""Child processes that do not outlive what started them."""

from __future__ import annotations

import os
from multiprocessing.connection import Connection, wait
from threading import Thread


def exit_when_closed(pipe: Connection | int) -> None:
    """End this process as soon as the other end of a pipe is closed, whatever this process is doing in Python.

    The system closes it when its owner ends, however that ends.

    Parameters
    ----------
    pipe
        The end that this process holds, or its file descriptor; nothing is ever sent through it.
    """
    Thread(target=lambda: (wait([pipe]), os._exit(1)), daemon=True).start()
