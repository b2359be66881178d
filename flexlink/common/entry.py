"""Imported before any slow import, so that `flexlink` and `python -m flexlink` respond to signals from then on."""

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

from flexlink.common.interruption import quit_at_once


def is_command(arguments: Sequence[str], words: Sequence[str]) -> bool:
    """Whether a process with these `sys.argv` and `sys.orig_argv` is the command line rather than a user's program.

    While Python looks for the module to run, which imports this package, `sys.argv[0]` is "-m".
    """
    program = Path(arguments[0]).stem if arguments else ""
    return program == "flexlink" or (program == "-m" and ("-m", "flexlink") in itertools.pairwise(words))


if is_command(sys.argv, sys.orig_argv):
    quit_at_once()
