"""The decorators of all kernels: compiled by numba, cached on disk under a key of all kernel sources.

Numba's own cache looks at the file of the function alone: an edit in a helper's file would silently return
stale machine code. The folder name therefore hashes every kernel file, and `chain.py`, which lays out
their records. A user's NUMBA_CACHE_DIR is respected.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

HERE = Path(__file__).parent


def cache_folder() -> Path:
    """Where compiled kernels are kept: the user's cache folder, one sub-folder per state of the sources."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        return Path(os.environ["NUMBA_CACHE_DIR"])
    digest = hashlib.sha256()
    for source in [*sorted(HERE.glob("*.py")), HERE.parent / "chain.py"]:
        digest.update(source.read_bytes())
    root = os.environ.get("XDG_CACHE_HOME") or (os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else None)
    return Path(root or Path.home() / ".cache") / "flexlink" / digest.hexdigest()[:16]


_FOLDER = cache_folder()


def kernel(function: Callable[..., Any]) -> Any:
    """Compile `function` on its first call and keep the machine code on disk.

    `error_model="numpy"` makes a division by zero inf or nan instead of a branch to raise: no check in kernels.
    """
    return _compile(function)


INLINED = {"_nrt": False, "forceinline": True, "error_model": "numpy", "fastmath": {"contract"}}  # of overloads


def recursion(function: Callable[..., Any]) -> Any:
    """A kernel that makes no arrays, only borrows those of its caller: it does not count references to them.

    Counting costs about 10 ns per array and call (two atomic instructions), as much as a joint.
    """
    return _compile(function, _nrt=False)


def inlined(function: Callable[..., Any]) -> Any:
    """A formula: makes no arrays, and is expanded where it is called, so that loops can become vector instructions."""
    return _compile(function, _nrt=False, forceinline=True)


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_FOLDER)
    try:
        # `contract` lets a·b + c be one instruction with one rounding; nothing is reordered.
        return numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"}, **options)(function)
    finally:
        numba.config.CACHE_DIR = before


def is_warm() -> bool:
    """Whether machine code for the present sources is already on disk."""
    return any(_FOLDER.rglob("*.nbc")) if _FOLDER.is_dir() else False
