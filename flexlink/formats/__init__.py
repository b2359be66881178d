"""The same arm in the files that other engines load; every format is one function of a chain."""

from collections.abc import Callable
from typing import NamedTuple

from flexlink.chain.chain import Chain
from flexlink.formats.mjcf import to_mjcf
from flexlink.formats.mjcf_reading import read_mjcf
from flexlink.formats.sdf import to_sdf
from flexlink.formats.sdf_reading import read_sdf
from flexlink.formats.urdf import to_urdf
from flexlink.formats.urdf_reading import read_urdf


class Format(NamedTuple):
    """One format of files."""

    write: Callable[..., str]  # of a chain
    read: Callable[..., Chain]  # of a text that `write` has written
    ending: str  # of its files' names
    keyframe: bool = False  # whether `write` takes the state `initial`, too


FORMATS = {
    "urdf": Format(to_urdf, read_urdf, ".urdf"),
    "mjcf": Format(to_mjcf, read_mjcf, ".mjcf.xml", keyframe=True),
    "sdf": Format(to_sdf, read_sdf, ".sdf"),
}

__all__ = ["FORMATS", "Format", "read_mjcf", "read_sdf", "read_urdf", "to_mjcf", "to_sdf", "to_urdf"]
