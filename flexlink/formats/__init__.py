"""The same arm as files for other programs: one writer and one reader for each format."""

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
    """A file format."""

    write: Callable[..., str]  # chain → text
    read: Callable[..., Chain]  # text, written by `write` → chain
    ending: str  # of file names
    keyframe: bool = False  # whether `write` also takes the state `initial`


FORMATS = {
    "urdf": Format(to_urdf, read_urdf, ".urdf"),
    "mjcf": Format(to_mjcf, read_mjcf, ".mjcf.xml", keyframe=True),
    "sdf": Format(to_sdf, read_sdf, ".sdf"),
}

__all__ = ["FORMATS", "Format", "read_mjcf", "read_sdf", "read_urdf", "to_mjcf", "to_sdf", "to_urdf"]
