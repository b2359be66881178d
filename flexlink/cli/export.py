"""`flexlink export`: the chains of scenes as files of other engines."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexlink.chain.lumping import lump
from flexlink.cli.shared import about, require_place, varied_scene
from flexlink.common.errors import ArgumentError
from flexlink.common.output import write_text
from flexlink.formats import FORMATS


def export_scenes(options: argparse.Namespace) -> int:
    """Write the chains of scenes, all or none of them."""
    texts: dict[Path, str] = {}
    for path in options.scenes:
        scene = varied_scene(path, options.set)
        for name in dict.fromkeys(options.format or FORMATS):
            convert, ending = FORMATS[name]
            target = options.out / (path.stem + ending)
            if target in texts:
                raise ArgumentError(f"{path}: a scene before it is written to {target}, too; export one at a time")
            with about(path):
                texts[target] = convert(lump(scene))
    for path, text in texts.items():
        require_place(path)
        write_text(path, text)
        print(path)
    return 0
