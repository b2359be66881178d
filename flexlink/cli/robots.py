"""The command `flexlink robots`."""

import argparse
from pathlib import Path

from flexlink.cli.shared import require_writable, varied
from flexlink.common.output import write_text
from flexlink.robots.collection import import_known, known_arm, known_arms


def run_command(options: argparse.Namespace) -> int:
    """Print name, joints, mass and file of every arm; write all scenes, or none, on request."""
    targets = {name: options.out / f"{name}.toml" for name in known_arms()} if options.out else {}
    for target in targets.values():
        require_writable(target)
    arms = {name: import_known(name) for name in known_arms()}
    scenes = {name: varied(Path(name), arm.scene, options.set) for name, arm in arms.items()}
    print(f"{'name':<27} joints  mass [kg]  file under robots/ in example-robot-data")
    for name, arm in arms.items():
        moving = sum(part.body.mass for part in arm.path.parts)
        parts = known_arm(name).path.parts  # from the folder `robots` on, it does not depend on the installation
        below = Path(*parts[len(parts) - parts[::-1].index("robots") :] if "robots" in parts else parts)
        print(f"{name:<27} {len(arm.path.parts):6d} {moving:10.4g}  {below}")
    for name, target in targets.items():
        write_text(target, scenes[name].to_toml())
    return 0
