"""The same arm in the files that other engines load; every format is one function of a chain."""

from collections.abc import Callable
from typing import NamedTuple

from flexlink.formats.mjcf import to_mjcf
from flexlink.formats.sdf import to_sdf
from flexlink.formats.urdf import to_urdf


class Format(NamedTuple):
    """One format of files."""

    write: Callable[..., str]  # of a chain
    ending: str  # of its files' names
    keyframe: bool = False  # whether `write` takes the state `initial`, too


FORMATS = {
    "urdf": Format(to_urdf, ".urdf"),
    "mjcf": Format(to_mjcf, ".mjcf.xml", keyframe=True),
    "sdf": Format(to_sdf, ".sdf"),
}

__all__ = ["FORMATS", "Format", "to_mjcf", "to_sdf", "to_urdf"]
