"""Names of other projects that pages link to, stored as text: no build waits for a network.

A file `inventories/NAME.txt` holds the project's address in its first line, then a line for each name: its role, the
name, and its page. Sphinx reads them in its own packed form, which is written into a temporary folder.
"""

from __future__ import annotations

import tempfile
import zlib
from pathlib import Path

HEAD = """\
# Sphinx inventory version 2
# Project: {name}
# Version: -
# The remainder of this file is compressed using zlib.
"""


def mapping(folder: Path) -> dict[str, tuple[str, str]]:
    """Setting `intersphinx_mapping` of all stored inventories."""
    packed = Path(tempfile.mkdtemp(prefix="inventories"))
    found = {}
    for path in sorted(folder.glob("*.txt")):
        address, *names = path.read_text(encoding="utf-8").splitlines()
        lines = [f"{name} {role} 1 {page} -\n" for role, name, page in map(str.split, names)]
        file = packed / f"{path.stem}.inv"
        file.write_bytes(HEAD.format(name=path.stem).encode() + zlib.compress("".join(lines).encode()))
        found[path.stem] = (address, str(file))
    return found
