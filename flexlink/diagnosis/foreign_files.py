"""Load foreign files, which flexlink did not write, with the engine for their format."""

from __future__ import annotations

import math
from pathlib import Path
from typing import cast
from xml.etree import ElementTree as ET

from flexlink.chain.arguments import require_one_of
from flexlink.common import safe_xml
from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.output import read_regular
from flexlink.common.types import Array
from flexlink.engines import load_here
from flexlink.engines.base import FileEngine, ForeignFile
from flexlink.engines.child_process import IsolatedEngine

READERS = {"mjcf": ("mujoco",), "urdf": ("pinocchio", "mujoco"), "sdf": ("drake",)}
"""Engines for each format, the default first."""


def load_file(
    path: Path, n: int, engine: str | None = None, *, base: Array | None = None, here: bool = False
) -> tuple[str, FileEngine, tuple[str, ...]]:
    """Load a file with about `n` joints in a child process, since the engine may crash, or in this process (`here`).

    Return its format, its engine, and the errors that the engine printed without stopping.

    `base` is the rotation of a floating base at zero angles; the base in the file must float as well.

    Raises
    ------
    DataFileError
        The file cannot be read, is not MJCF, URDF or SDF, is too large, or the engine refuses it.
    ArgumentError
        The engine does not support this format.
    EngineError
        The child process ended.
    MissingDependencyError
        The engine is not installed.
    """
    format = _format(path, n)
    name = engine or READERS[format][0]
    require_one_of(f"engine for {format.upper()}", name, dict.fromkeys(READERS[format]))
    file = ForeignFile(path.absolute(), format, base)  # the child process may have another working directory
    try:
        loaded = cast(FileEngine, load_here(name, file)) if here else IsolatedEngine(name, file)
        loaded.read_back().require_sound()
    except ArgumentError as error:
        raise DataFileError(f"{path}: {error}") from error
    return format, loaded, tuple(loaded.stderr_errors) if isinstance(loaded, IsolatedEngine) else ()


def _format(path: Path, n: int) -> str:
    root = safe_xml.parse(read_regular(path, largest=safe_xml.LARGEST, error=DataFileError), str(path))
    roots = {"mujoco": "mjcf", "robot": "urdf", "sdf": "sdf"}
    if root.tag not in roots:
        raise DataFileError(
            f"{path}: root is <{root.tag}>; expected <mujoco> (MJCF), <robot> (URDF) or <sdf>",
            id="unknown-root-element",
        )
    if (unfolded := _unfolded(root)) > safe_xml.MOST_ELEMENTS:
        raise DataFileError(
            f"{path}: {unfolded:.3g} elements, with their counts; at most {safe_xml.MOST_ELEMENTS} are read",
            id="file-too-large",
        )
    hinges, most = sum(1 for joint in root.iter("joint") if joint.get("type") != "fixed"), max(n, 300)
    if hinges > most:  # for n joints Pinocchio needs 35 n³ bytes
        raise DataFileError(
            f"{path}: {hinges} joints, but the scene's arm has {n}; at most {most} are allowed", id="too-many-joints"
        )
    return roots[root.tag]


def _unfolded(root: ET.Element) -> float:
    """Number of elements after MuJoCo has repeated those with a `count`."""
    total, left = 0.0, [(root, 1.0)]
    while left:
        element, times = left.pop()
        times *= math.prod(safe_xml.numbers_of(element.get("count", "")) or [1.0])
        total += times
        left += [(below, times) for below in element]
    return total
