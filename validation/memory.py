"""Peak memory of this process."""

from __future__ import annotations

import re
import resource
import sys
from pathlib import Path

STATUS = Path("/proc/self/status")


def peak_megabytes() -> float:
    """Peak resident memory of this process [MB].

    On Linux it is read from /proc, because getrusage also counts the memory of the process that started this one.
    """
    status = STATUS.read_text(encoding="ascii") if STATUS.exists() else ""
    if own := re.search(r"^VmHWM:\s*(\d+) kB", status, re.MULTILINE):
        return int(own[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10)
