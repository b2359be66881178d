"""Link targets of other projects, stored as text so that no build waits for a network.

The first line of a file `inventories/NAME.txt` is the project's address. Each further line has the role, the name and
the page of one target. `mapping` writes them to a temporary folder in Sphinx's packed format.
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
    """Return the setting `intersphinx_mapping` for all stored inventories."""
    packed = Path(tempfile.mkdtemp(prefix="inventories"))
    found = {}
    for path in sorted(folder.glob("*.txt")):
        address, *names = path.read_text(encoding="utf-8").splitlines()
        lines = [f"{name} {role} 1 {page} -\n" for role, name, page in map(str.split, names)]
        file = packed / f"{path.stem}.inv"
        file.write_bytes(HEAD.format(name=path.stem).encode() + zlib.compress("".join(lines).encode()))
        found[path.stem] = (address, str(file))
    return found
