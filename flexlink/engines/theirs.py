"""A file that somebody else wrote, in the engine that reads its format; the format is known by its root element."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol, cast
from xml.etree import ElementTree as ET

from flexlink.chain.arguments import choice
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.engines import engine_class
from flexlink.engines.base import Array, Engine

ROOTS = {"mujoco": "mjcf", "robot": "urdf", "sdf": "sdf"}
READERS = {"mjcf": ("mujoco",), "urdf": ("pinocchio", "mujoco"), "sdf": ("drake",)}
"""Engines that read a format; the first is taken unless another one is named."""
MOST_BYTES, MOST_JOINTS = 50_000_000, 2_000
"""Beyond them some engines take minutes or crash."""


class FileEngine(Engine, Protocol):
    """An engine with a file of somebody else's."""

    def adopt(self, **fields: Array) -> None:
        """Take what the file does not say from elsewhere: fields of the record, as in `ReadBack`."""

    def put_right(self) -> None:
        """Leave nothing that acts beside gravity, springs and dampers."""


def load_file(path: Path, engine: str | None = None) -> tuple[str, FileEngine]:
    """Format of a file, and the engine that has loaded it.

    Raises
    ------
    ArgumentError
        The file is no MJCF, URDF or SDF, larger than engines bear, or its engine refuses it.
    MissingDependencyError
        The engine is not installed.
    OSError
        The file cannot be read.
    """
    try:
        form = _format(path)
        name = engine or READERS[form][0]
        choice(f"engine for {form.upper()}", name, dict.fromkeys(READERS[form]))
        loaded = cast(FileEngine, cast(Any, engine_class(name)).from_file(path))
        loaded.read_back().require_finite()
    except FlexlinkError as error:
        error.args = (f"{path}: {error}",)
        raise
    return form, loaded


class _Plain(ET.TreeBuilder):
    """Elements only: a document type, and with it every entity, is refused before anything is expanded."""

    def doctype(self, name: str, *_: str | None) -> None:
        raise ArgumentError(f"<!DOCTYPE {name}>: robot files have none")


def _format(path: Path) -> str:
    if (size := path.stat().st_size) > MOST_BYTES:
        raise ArgumentError(f"{size} bytes; at most {MOST_BYTES} are read")
    try:
        root = ET.parse(path, ET.XMLParser(target=_Plain())).getroot()
    except ET.ParseError as error:
        raise ArgumentError(f"not XML: {error}") from None
    except (ValueError, LookupError) as error:
        if isinstance(error, FlexlinkError):
            raise
        raise ArgumentError(f"not XML: {error}") from None
    if root.tag not in ROOTS:
        raise ArgumentError(f"root element <{root.tag}>: expected <mujoco> (MJCF), <robot> (URDF) or <sdf> (SDF)")
    if (joints := sum(1 for _ in root.iter("joint"))) > MOST_JOINTS:
        raise ArgumentError(f"{joints} joints; at most {MOST_JOINTS} are read")
    return ROOTS[root.tag]
