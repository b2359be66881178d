"""Base classes of results: their arrays are read-only, even in copies and pickles, and can be saved in files."""

import dataclasses
import io
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, Self

import numpy as np

from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.output import write_whole
from flexlink.common.wording import did_you_mean
from flexlink.data.documents import read_regular, require_path


class Result:
    """Base class of results, which are frozen dataclasses; it makes their arrays read-only."""

    def __post_init__(self) -> None:
        fields = vars(self)
        for name, value in fields.items():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                fields[name] = read_only(value)

    @classmethod
    def of_read_only(cls, **fields: Any) -> Self:
        """The result with all these fields, whose arrays are read-only already; takes a fifth of the time."""
        result = object.__new__(cls)
        object.__setattr__(result, "__dict__", fields)
        return result

    if not TYPE_CHECKING:  # so that mypy still finds wrong names

        def __getattr__(self, name: str) -> NoReturn:
            if name.startswith("_"):  # copies, NumPy and notebooks ask for many of these
                raise AttributeError(name)
            if (own := getattr(type(self), name, None)) is not None:  # a property that has failed: show its error
                return own.__get__(self)
            public = {each: getattr(type(self), each) for each in dir(type(self)) if each[0] != "_"}
            fields = [field.name for field in dataclasses.fields(self) if field.repr]
            fields += [each for each, what in public.items() if isinstance(what, property)]
            near = did_you_mean(name, [*fields, *public]) or f"; its fields are {', '.join(fields)}"
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{near}")

    def __array__(self, *_: object, **__: object) -> NoReturn:
        """Refuse to be an array, as `J @ qd` asks for."""
        of = [name for name, value in vars(self).items() if isinstance(value, np.ndarray)]
        kind = type(self).__name__
        raise ArgumentError(f"a {kind} is no array; its arrays are .{', .'.join(of)}", id="wrong-type")

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
        """Write all fields into an .npz archive, or raise an OutputError; `load` restores them bit for bit."""
        path = archive_path(path)
        fields = {name: np.array(part, str) if type(part) is tuple else part for name, part in vars(self).items()}
        write_whole(path, lambda temporary: write_archive(temporary, fields))
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file written by `save`; a DataFileError if it is missing, or contains something else."""
        arrays = read_archive(path)
        fields = dataclasses.fields(cls)  # type: ignore[arg-type]
        needed = {field.name for field in fields if field.default is field.default_factory is dataclasses.MISSING}
        if not needed <= arrays.keys() <= {field.name for field in fields}:
            why = f"{path}: contains no {cls.__name__}; expected a file written by {cls.__name__}.save"
            raise DataFileError(why, id="not-a-result")
        return cls(**{name: _field(array) for name, array in arrays.items()})


def _field(array: np.ndarray[Any, Any]) -> Any:
    if array.ndim == 0:
        return array.item()
    return tuple(array.tolist()) if array.dtype.kind == "U" else array


def archive_path(path: str | Path) -> Path:
    """Return `path`, whose name must end in .npz."""
    path = require_path("path", path)
    if path.suffix != ".npz":
        raise ArgumentError(f"{str(path)!r}: unknown format; expected a name that ends in .npz", id="unknown-format")
    return path


def write_archive(path: Path, values: dict[str, Any]) -> None:
    """Write arrays, numbers and tuples of strings into an archive, compressed unless it would look like a bomb."""
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **values)
    if _is_bomb(sum(np.asarray(value).nbytes for value in values.values()), path.stat().st_size):
        with path.open("wb") as file:
            np.savez(file, allow_pickle=False, **values)


def read_archive(path: str | Path) -> dict[str, np.ndarray[Any, Any]]:
    """Return all arrays of an .npz archive by name; refuses files that are damaged, or unfold to far more bytes."""
    path = archive_path(path)
    data = read_regular(path, largest=10_000_000_000, error=DataFileError)
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
        parts = archive.infolist()
        if not _is_bomb(sum(part.file_size for part in parts), len(data)):
            return {part.filename.removesuffix(".npy"): _array(archive, part) for part in parts}
    except Exception as error:  # any: a stranger's bytes steer zipfile, zlib and NumPy's parser of headers
        huge, damaged = "declares more numbers than fit into memory", "damaged, or not an archive of arrays"
        why = huge if isinstance(error, MemoryError | OverflowError) else damaged
        raise DataFileError(f"{path}: {why}; expected an .npz file", id="not-a-result") from None
    wanted = "expected a file written by save"
    raise DataFileError(f"{path}: unfolds to far more bytes than any result of its size; {wanted}", id="file-too-large")


def _is_bomb(unfolded: int, size: int) -> bool:
    """Whether an archive of a size [bytes] takes memory out of proportion when it is unfolded."""
    return unfolded > 200_000_000 + 20 * size


def _array(archive: zipfile.ZipFile, part: zipfile.ZipInfo) -> np.ndarray[Any, Any]:
    """Read one array, and 1 byte more: `zipfile` compares the checksum only at the end of the data."""
    with archive.open(part) as stream:
        array: np.ndarray[Any, Any] = np.lib.format.read_array(stream, allow_pickle=False)
        if stream.read(1) or array.size > part.file_size:
            raise ValueError("the header declares other numbers than follow")
    return array
