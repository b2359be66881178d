"""A file that somebody else wrote, in the engine that reads its format; the format is known by its root element."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, Protocol, cast

from flexlink.chain.arguments import choice
from flexlink.common import safe_xml
from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.files import read_regular
from flexlink.engines import load_here
from flexlink.engines.base import Array, Engine, File, Reader
from flexlink.engines.child_process import IsolatedEngine

ROOTS = {"mujoco": "mjcf", "robot": "urdf", "sdf": "sdf"}
READERS = {"mjcf": ("mujoco",), "urdf": ("pinocchio", "mujoco"), "sdf": ("drake",)}
"""Engines that read a format; the first is taken unless another one is named."""
MOST_JOINTS = 300
"""Unless the scene has more: Pinocchio takes 35 n³ bytes."""


class FileEngine(Engine, Reader, Protocol):
    """An engine with a file of somebody else's."""

    def adopt(self, fields: Mapping[str, Array]) -> None:
        """Take what the file does not say from elsewhere: fields of the record, as in `ReadBack`."""

    def put_right(self) -> None:
        """Leave nothing that acts beside gravity, springs and dampers."""


class Loaded(NamedTuple):
    """A file in its engine."""

    form: str
    engine: FileEngine
    complaints: tuple[str, ...]  # errors that the engine has printed, and read on


def load_file(path: Path, n: int, engine: str | None = None, *, here: bool = False) -> Loaded:
    """Load a file of which `n` joints are expected, in a process of its own, which it may crash, or `here`.

    Raises
    ------
    DataFileError
        The file cannot be read, is no MJCF, URDF or SDF, larger than engines bear, or its engine refuses it.
    ArgumentError
        Another engine than those that read the format.
    EngineError
        The process that reads it ended.
    MissingDependencyError
        The engine is not installed.
    """
    form = _format(path, n)
    name = engine or READERS[form][0]
    choice(f"engine for {form.upper()}", name, dict.fromkeys(READERS[form]))
    file = File(path, form)
    try:
        loaded = cast(FileEngine, load_here(name, file)) if here else IsolatedEngine(name, file)
        loaded.read_back().require_sound()
    except ArgumentError as error:
        raise DataFileError(f"{path}: {error}") from error
    return Loaded(form, loaded, tuple(loaded.stderr_errors) if isinstance(loaded, IsolatedEngine) else ())


def _format(path: Path, n: int) -> str:
    root = safe_xml.parse(read_regular(path, largest=safe_xml.LARGEST, error=DataFileError), str(path))
    if root.tag not in ROOTS:
        raise DataFileError(f"{path}: root is <{root.tag}>; expected <mujoco> (MJCF), <robot> (URDF) or <sdf>")
    hinges = sum(1 for joint in root.iter("joint") if joint.get("type") != "fixed")
    if hinges > max(n, MOST_JOINTS):
        raise DataFileError(f"{path}: {hinges} joints, the scene's arm has {n}; at most {MOST_JOINTS} are read")
    return ROOTS[root.tag]
