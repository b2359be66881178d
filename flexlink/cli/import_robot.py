"""The command `flexlink import`."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexlink.cli import shared
from flexlink.common.errors import ArgumentError
from flexlink.common.output import write_text
from flexlink.data.documents import shown_path
from flexlink.describe.plausibility.hints import hints
from flexlink.describe.spec import decode
from flexlink.robots.collection import KnownArm, known_arm
from flexlink.robots.flexible import FlexibleLink
from flexlink.robots.importing import import_urdf
from flexlink.robots.kinematic_tree import Robot, finite
from flexlink.robots.robot_file import read_robot


def run_command(options: argparse.Namespace) -> int:
    """Import a robot, print what was done, and write the scene on request."""
    source = Path(options.robot)
    by_name = source.name == options.robot and not (source.suffix or source.is_file())
    known = known_arm(options.robot) if by_name else KnownArm(file=options.robot)
    robot = read_robot(known.path if by_name else source)
    arguments = _arguments(robot, known, options)
    with shared.prefix_errors(source):
        imported = import_urdf(robot, **arguments)
    scene, paths = shared.varied(source, imported.scene, options.set), [text.partition("=")[0] for text in options.set]
    doubts = tuple(each for each in imported.warnings if not any(path in each for path in paths))
    options.document = {
        "scene": scene.to_toml(), "notes": shared.with_ids(imported.notes), "warnings": shared.with_ids(doubts),
    }  # fmt: skip
    print(imported)
    shared.print_lines("warning", doubts)
    made = ("material.", "section.")  # equivalent beams of links that are made flexible
    shared.print_hints([hint for hint in hints(scene) if not hint.startswith(made)], options)
    if options.out is None:
        print("no file written; add -o FILE.toml to write the scene")
    else:
        write_text(options.out, scene.to_toml())
        print(shown_path(options.out))
    return 0


def _arguments(robot: Robot, known: KnownArm, options: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `import_urdf`, from a known arm, overridden by the command's options."""
    flexible = shared.assignments("--flexible", options.flexible, "'forearm={ frequency_hz = 12 }'")
    return {
        "base": known.base if options.base is None else options.base,
        "tip": known.tip if options.tip is None else options.tip,
        "free_base": options.free_base,
        "posture": known.posture | _positions(robot, "--posture", options.posture),
        "locked": known.locked | _positions(robot, "--locked", options.locked),
        "flexible": known.flexible | {k: decode(v, FlexibleLink, f"flexible.{k}") for k, v in flexible.items()},
        "armature": shared.assignments("--armature", options.armature, "elbow=0.1"),
    }


def _positions(robot: Robot, option: str, texts: Sequence[str]) -> dict[str, float]:
    """Positions by joint [rad, m], converted from option values in degrees and metres."""
    positions = {}
    for name, value in shared.assignments(option, texts, "elbow=90").items():
        number = finite(value)
        if number is None:
            text = f"{option} {name}={value}: expected a finite number [deg; m for a slide]"
            raise ArgumentError(text, id="option-value")
        joint = robot.joints.get(name)
        in_metres = joint is not None and joint.moves and not joint.turns
        positions[name] = number if in_metres else math.radians(number)
    return positions
