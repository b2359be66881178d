"""Imported before everything that takes time: `flexlink` and `python -m flexlink` answer signals from here on."""

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

from flexlink.common.interruption import quit_at_once


def is_command(arguments: Sequence[str], words: Sequence[str]) -> bool:
    """Whether a process with these `sys.argv` and `sys.orig_argv` is the command line, and not a user of the library.

    Python says "-m" in the place of the program while it looks for the module to run, which imports this package.
    """
    program = Path(arguments[0]).stem if arguments else ""
    return program == "flexlink" or (program == "-m" and ("-m", "flexlink") in itertools.pairwise(words))


if is_command(sys.argv, sys.orig_argv):
    quit_at_once()
