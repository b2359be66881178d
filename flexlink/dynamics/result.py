"""Base classes of results: their arrays are read-only, even in copies and pickles, and can be saved in files."""

from __future__ import annotations

import dataclasses
import zipfile
from pathlib import Path
from typing import Any, Self

import numpy as np

from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.output import write_whole
from flexlink.data.documents import require_path


class Result:
    """Base class of results, which are frozen dataclasses; it makes their arrays read-only."""

    def __post_init__(self) -> None:
        fields = vars(self)
        for name, value in fields.items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                fields[name] = read_only(value)

    def __reduce__(self) -> tuple[Any, ...]:
        """Make copies and pickles call the constructor, so that their arrays are read-only as well."""
        return type(self), tuple(vars(self)[field.name] for field in dataclasses.fields(self))  # type: ignore[arg-type]


def read_only(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return a read-only view."""
    array = array.view()
    array.setflags(write=False)  # three times as fast as `flags.writeable = False`
    return array


class SavedResult(Result):
    """A result that consists of arrays, numbers and tuples of strings, and can be saved in a file."""

    def save(self, path: str | Path) -> Path:
        """Write all fields into an .npz archive, atomically; `load` restores them bit for bit.

        Raises
        ------
        ArgumentError
            The name does not end in .npz.
        OutputError
            The file cannot be written.
        """
        path = archive_path(path)
        write_whole(path, lambda temporary: write_archive(temporary, vars(self)))
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file written by `save`.

        Raises
        ------
        ArgumentError
            The name does not end in .npz.
        DataFileError
            The file is missing, or contains something else.
        """
        arrays = read_archive(path)
        fields = dataclasses.fields(cls)  # type: ignore[arg-type]
        needed = {field.name for field in fields if field.default is dataclasses.MISSING}
        if not needed <= arrays.keys() <= {field.name for field in fields}:
            raise DataFileError(
                f"{path}: contains no {cls.__name__}; expected a file written by {cls.__name__}.save", id="not-a-result"
            )
        return cls(**{name: _field(array) for name, array in arrays.items()})


def _field(array: np.ndarray[Any, Any]) -> Any:
    if array.ndim == 0:
        return array.item()
    return tuple(array.tolist()) if array.dtype.kind == "U" else array


def archive_path(path: str | Path) -> Path:
    """Return `path`, whose name must end in .npz.

    Raises
    ------
    ArgumentError
        The name does not end in .npz, or `path` is not a path.
    """
    path = require_path("path", path)
    if path.suffix != ".npz":
        raise ArgumentError(f"{str(path)!r}: unknown format; expected a name that ends in .npz", id="unknown-format")
    return path


def write_archive(path: Path, values: dict[str, Any]) -> None:
    """Write arrays, numbers and tuples of strings into a compressed archive."""
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **values)


def read_archive(path: str | Path) -> dict[str, np.ndarray[Any, Any]]:
    """Return all arrays of an .npz archive by name.

    Raises
    ------
    ArgumentError
        The name does not end in .npz.
    DataFileError
        The file is missing or not an .npz archive.
    """
    path = archive_path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            return dict(archive)
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read: {error.strerror or error}", id="cannot-read") from None
    except (MemoryError, OverflowError):
        raise DataFileError(
            f"{path}: declares more numbers than fit into memory; expected an .npz file", id="not-a-result"
        ) from None
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile):
        raise DataFileError(f"{path}: not an archive of arrays; expected an .npz file", id="not-a-result") from None
