"""The same arm in the files that other engines load; every format is one function of a chain."""

from flexlink.formats.mjcf import to_mjcf
from flexlink.formats.sdf import to_sdf
from flexlink.formats.urdf import to_urdf

FORMATS = {"urdf": (to_urdf, ".urdf"), "mjcf": (to_mjcf, ".mjcf.xml"), "sdf": (to_sdf, ".sdf")}
"""Format name: the function that writes it, and the ending of its files."""

__all__ = ["FORMATS", "to_mjcf", "to_sdf", "to_urdf"]
