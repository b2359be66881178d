"""A file that somebody else wrote, in the engine that reads its format; the format is known by its root element."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol, cast

from flexlink.chain.arguments import choice
from flexlink.common import safe_xml
from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.reading import read_regular
from flexlink.engines import adapter_class
from flexlink.engines.base import Array, Engine, Reader

ROOTS = {"mujoco": "mjcf", "robot": "urdf"}
READERS = {"mjcf": ("mujoco",), "urdf": ("pinocchio", "mujoco")}
"""Engines that read a format; the first is taken unless another one is named."""
MOST_JOINTS = 300
"""Unless the scene has more: Pinocchio takes 35 n³ bytes."""


class FileEngine(Engine, Reader, Protocol):
    """An engine with a file of somebody else's."""

    def adopt(self, **fields: Array) -> None:
        """Take what the file does not say from elsewhere: fields of the record, as in `ReadBack`."""

    def put_right(self) -> None:
        """Leave nothing that acts beside gravity, springs and dampers."""


def load_file(path: Path, n: int, engine: str | None = None) -> tuple[str, FileEngine]:
    """Format of a file, and the engine that has loaded it; `n` joints are expected.

    Raises
    ------
    DataFileError
        The file cannot be read, is no MJCF or URDF, larger than engines bear, or its engine refuses it.
    ArgumentError
        Another engine than those that read the format.
    MissingDependencyError
        The engine is not installed.
    """
    form = _format(path, n)
    name = engine or READERS[form][0]
    choice(f"engine for {form.upper()}", name, dict.fromkeys(READERS[form]))
    reader = cast(Any, adapter_class(name))
    try:
        loaded = cast(FileEngine, reader.from_file(path, form))
        loaded.read_back().require_sound()
    except ArgumentError as error:
        raise DataFileError(f"{path}: {error}") from error
    return form, loaded


def _format(path: Path, n: int) -> str:
    root = safe_xml.parse(read_regular(path, largest=safe_xml.LARGEST, error=DataFileError), str(path))
    if root.tag not in ROOTS:
        raise DataFileError(f"{path}: root is <{root.tag}>; expected <mujoco> (MJCF) or <robot> (URDF)")
    hinges = sum(1 for joint in root.iter("joint") if joint.get("type") != "fixed")
    if hinges > max(n, MOST_JOINTS):
        raise DataFileError(f"{path}: {hinges} joints, the scene's arm has {n}; at most {MOST_JOINTS} are read")
    return ROOTS[root.tag]
