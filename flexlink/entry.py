"""Imported before everything that takes time: `flexlink` and `python -m flexlink` answer signals from here on."""

import sys
from pathlib import Path

from flexlink.interruption import quit_at_once

if any(Path(name).stem in {"-m", "flexlink"} for name in sys.argv[:1]):  # "-m" while Python looks for the module to run
    quit_at_once()
