"""`flexlink export`: the chains of scenes as files of other engines."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexlink.chain.lumping import lump
from flexlink.cli.shared import about, require_place, varied_scene
from flexlink.common.errors import ArgumentError
from flexlink.common.output import write_text
from flexlink.formats import FORMATS
from flexlink.motion.start import initial_state


def export_scenes(options: argparse.Namespace) -> int:
    """Write the chains of scenes, all or none of them; where a format holds it, with the initial state."""
    texts: dict[Path, str] = {}
    for path in options.scenes:
        scene = varied_scene(path, options.set)
        for name in dict.fromkeys(options.format or FORMATS):
            format = FORMATS[name]
            target = options.out / (path.stem + format.ending)
            if target in texts:
                raise ArgumentError(f"{path}: a scene before it is written to {target}, too; export one at a time")
            with about(path):
                chain = lump(scene)
                state = {"initial": initial_state(scene, chain)} if format.keyframe else {}
                texts[target] = format.write(chain, **state)
    for path, text in texts.items():
        require_place(path)
        write_text(path, text)
        print(path)
    return 0
