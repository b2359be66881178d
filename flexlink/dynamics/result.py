"""Base of the records that functions return: arrays are read-only, in copies and pickles too; files of them."""

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
    """Base of frozen dataclasses."""

    def __post_init__(self) -> None:
        fields = vars(self)
        for name, value in fields.items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                fields[name] = read_only(value)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are built anew: their arrays, too, are read-only."""
        return type(self), tuple(vars(self)[field.name] for field in dataclasses.fields(self))  # type: ignore[arg-type]


def read_only(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """A view that cannot be written through."""
    array = array.view()
    array.setflags(write=False)  # three times as fast as `flags.writeable = False`
    return array


class SavedResult(Result):
    """A result of arrays, numbers and tuples of texts, which a file can hold."""

    def save(self, path: str | Path) -> Path:
        """Write all fields into an .npz archive, whole or not at all; `load` reads it back, equal to the bit.

        Raises
        ------
        ArgumentError
            The name does not end in .npz.
        OutputError
            It cannot be written.
        """
        path = archive_path(path)
        write_whole(path, lambda place: write_archive(place, vars(self)))
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` has written.

        Raises
        ------
        ArgumentError
            The name does not end in .npz.
        DataFileError
            The file is missing, or holds something else.
        """
        arrays = read_archive(path)
        if arrays.keys() != {field.name for field in dataclasses.fields(cls)}:  # type: ignore[arg-type]
            raise DataFileError(
                f"{path}: holds no {cls.__name__}; expected a file written by its save", id="not-a-result"
            )
        return cls(**{name: _field(array) for name, array in arrays.items()})


def _field(array: np.ndarray[Any, Any]) -> Any:
    if array.ndim == 0:
        return array.item()
    return tuple(array.tolist()) if array.dtype.kind == "U" else array


def archive_path(path: str | Path) -> Path:
    """`path`, of which the name ends in .npz.

    Raises
    ------
    ArgumentError
        It does not, or is no path.
    """
    path = require_path("path", path)
    if path.suffix != ".npz":
        raise ArgumentError(f"{str(path)!r}: unknown format; expected a name that ends in .npz", id="unknown-format")
    return path


def write_archive(path: Path, values: dict[str, Any]) -> None:
    """Write arrays, numbers and tuples of texts into a compressed archive."""
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **values)


def read_archive(path: str | Path) -> dict[str, np.ndarray[Any, Any]]:
    """All arrays of an .npz archive, by name.

    Raises
    ------
    ArgumentError
        The name does not end in .npz.
    DataFileError
        The file is missing or not such an archive.
    """
    path = archive_path(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            return dict(archive)
    except OSError as error:
        raise DataFileError(f"{path}: cannot be read: {error.strerror or error}", id="cannot-read") from None
    except (MemoryError, OverflowError):
        raise DataFileError(
            f"{path}: claims more numbers than fit into memory; expected an .npz file", id="not-a-result"
        ) from None
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile):
        raise DataFileError(f"{path}: not an archive of arrays; expected an .npz file", id="not-a-result") from None
