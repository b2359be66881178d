"""`flexlink robots`: the arms of example-robot-data that `flexlink import` takes by name."""

from __future__ import annotations

import argparse
from pathlib import Path

from flexlink.cli.shared import require_place, varied
from flexlink.common.output import write_text
from flexlink.robots.collection import import_known, known_arms


def list_robots(options: argparse.Namespace) -> int:
    """Print every arm's name, joints, mass, links that bend and file; write their scenes where it is asked for."""
    print(f"{'name':<27} joints  mass [kg]  file")
    for name, arm in known_arms().items():
        imported = import_known(name)
        moving = sum(part.body.mass for part in imported.path.parts)
        print(f"{name:<27} {len(imported.path.parts):6d} {moving:10.4g}  {arm.path}")
        if options.out is not None:
            target = options.out / f"{name}.toml"
            require_place(target)
            write_text(target, varied(Path(name), imported.scene, options.set).to_toml())
    return 0
