"""Files of the arm for other programs: a writer for each format, and readers for files written by flexlink."""

from collections.abc import Callable
from typing import NamedTuple

from flexlink.chain.chain import Chain
from flexlink.formats.mjcf import to_mjcf
from flexlink.formats.sdf import read_sdf, to_sdf
from flexlink.formats.urdf import read_urdf, to_urdf


class Format(NamedTuple):
    """A file format."""

    write: Callable[..., str]  # chain → text
    read: Callable[..., Chain] | None  # text written by `write` → chain; None: MuJoCo reads the file
    ending: str  # suffix of file names
    keyframe: bool = False  # whether `write` also accepts the state `initial`, and a scene as `ties`


FORMATS = {
    "urdf": Format(to_urdf, read_urdf, ".urdf"),
    "mjcf": Format(to_mjcf, None, ".mjcf.xml", keyframe=True),
    "sdf": Format(to_sdf, read_sdf, ".sdf"),
}

__all__ = ["FORMATS", "Format", "read_sdf", "read_urdf", "to_mjcf", "to_sdf", "to_urdf"]
