"""Files of machine code: the user's cache folder, and the code shipped with the package.

The name of a folder is a hash of all kernel sources, including the layout of their records, and of the compiler
versions. The environment variable NUMBA_CACHE_DIR sets the parent folder.

A package contains an archive of all files for each family of CPUs (x86-64, v3, v4); in a package built from source the
files are for the CPU of the build. The files for a CPU are copied to the user's folder when one is first missing there.
The archive is a twentieth of the size of its files, which mostly contain the same type names; separate archives of the
families would take a quarter more. Code of different families can be mixed, since calling conventions are equal.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import lzma
import os
import re
import shutil
import sys
import tarfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

import llvmlite
import numba

from flexlink.common.output import write_whole

Cpu = tuple[str, str, str]
"""A CPU in Numba's terms for targets: triple, name, features."""
HERE = Path(__file__).parent.parent
KEPT = 8  # number of most recently used folders of other sources and versions to keep, up to 17 MB each


def sources() -> list[Path]:
    """Every file that affects the compiled code."""
    return sorted(HERE.rglob("*.py"))


def state() -> str:
    """Hash of sources and versions, the same on every machine."""
    digest = hashlib.sha256(f"{sys.implementation.cache_tag} {numba.__version__} {llvmlite.__version__}".encode())
    for source in sources():
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """User's cache folder of compiled kernels, with one sub-folder per state of sources and versions."""
    root = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    if not root and sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA")
    try:
        place = Path(root or Path.home() / ".cache").absolute()
    except RuntimeError:  # a user without home directory
        place = Path(os.devnull)
    return place / "flexlink" / state()


FAMILIES = {
    "x86-64-v4": "avx512f avx512bw avx512cd avx512dq avx512vl avx2 bmi bmi2 f16c fma lzcnt movbe",
    "x86-64-v3": "avx2 bmi bmi2 f16c fma lzcnt movbe",
    "x86-64": "",
}
"""Families of CPUs, the best first, with their required features (System V ABI, x86-64 psABI, table 3.1). The last one
has no fused multiply-add, so its results differ from the other families' in the last digits."""


def families(cpu: Cpu) -> list[Cpu]:
    """Families to which a CPU belongs."""
    triple, _, features = cpu
    has = {feature[1:] for feature in features.split(",") if feature[:1] == "+"}
    of = FAMILIES if triple.startswith("x86_64") else {}
    return [(triple, name, "") for name, needed in of.items() if has.issuperset(needed.split())]


FOLDER = cache_folder()  # computed at import, before the sources can change under a running process
SHIPPED = HERE.parent / "machine_code" / FOLDER.name  # code shipped with the package
ARCHIVE = "code.tar.xz"
with contextlib.suppress(OSError):
    os.utime(FOLDER)  # mark as used


def folder_for(cpu: Cpu) -> str:
    """Name of the folder in an archive with the code for a CPU or a family."""
    return hashlib.sha256(repr(cpu).encode()).hexdigest()[:16]


def pack(code: Path, archive: Path, cpu: Cpu) -> None:
    """Add the machine code files of a folder to an archive, without files that only compilation needs.

    The filter settings suit this data: the archive is 6 % smaller than with the defaults.
    """
    own = folder_for(cpu)
    files = {key: content for key, content in unpacked(archive).items() if key[1] != own}
    files |= {(file.name, own): file.read_bytes() for file in code.glob("*.bin")}
    densely = {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": 2**26, "lc": 4, "pb": 0}
    with lzma.open(archive, "w", filters=[densely]) as out, tarfile.open(fileobj=out, mode="w") as packed:
        for (name, folder), content in sorted(files.items()):  # by name: code of one function for several CPUs is alike
            member = tarfile.TarInfo(f"{folder}/{name}")
            member.size = len(content)
            packed.addfile(member, io.BytesIO(content))


def unpacked(archive: Path) -> dict[tuple[str, str], bytes]:
    """Content of each file in an archive by its name and folder; empty if the archive is missing or damaged."""
    with contextlib.suppress(OSError, tarfile.TarError), tarfile.open(archive) as packed:
        paths = [(Path(member.name), cast(IO[bytes], packed.extractfile(member)).read()) for member in packed]
        return {(path.name, path.parent.name): content for path, content in paths}
    return {}


@functools.cache
def shipped(cpu: Cpu) -> dict[str, bytes]:
    """Return the files shipped for a CPU, and copy them to the user's folder for later processes."""
    packed = unpacked(SHIPPED / ARCHIVE)
    for own in map(folder_for, (cpu, *families(cpu))):
        files = {name: content for (name, folder), content in packed.items() if folder == own}
        if files:
            with contextlib.suppress(OSError):
                make(FOLDER)
                for name, content in files.items():
                    write_whole(FOLDER / name, functools.partial(_fill, content=content))
            return files
    return {}


def _fill(place: Path, content: bytes) -> None:
    place.write_bytes(content)


@contextlib.contextmanager
def alone(file: Path) -> Iterator[Path]:
    """Lock a file: wait for another process that compiles it, and keep others from compiling it meanwhile."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):  # Windows; a folder without write permission
            import fcntl  # noqa: PLC0415

            make(FOLDER)
            file.parent.mkdir(exist_ok=True)
            beside = file.with_suffix(".lock")
            lock = stack.enter_context(beside.open("w"))
            stack.callback(beside.unlink, missing_ok=True)
            until = time.monotonic() + 600.0  # [s], more than any function takes to compile
            while time.monotonic() < until and not _locked(lock, fcntl):
                time.sleep(0.02)
        yield file


def _locked(lock: Any, fcntl: Any) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def checked(content: bytes, mark: bytes = b"") -> bytes:
    """Return the content that follows a valid checksum, which must equal `mark` if that is given."""
    size = hashlib.sha256().digest_size
    if hashlib.sha256(content[size:]).digest() != content[:size] or not content.startswith(mark):
        raise ValueError("the file is damaged, or its checksum differs from the expected one")
    return content[size:]


def read(file: Path, mark: bytes = b"") -> bytes:
    """Content of a file after its checksum."""
    return checked(file.read_bytes(), mark)


def write(file: Path, content: bytes) -> bytes:
    """Write a file with a checksum; return the checksum."""
    checksum = hashlib.sha256(content).digest()
    write_whole(file, functools.partial(_fill, content=checksum + content))
    return checksum


def make(folder: Path) -> None:
    """Make a new folder, and remove the least recently used one if there are too many.

    Removing a folder is safe at any time: a process that uses it recompiles missing functions.
    """
    if folder.is_dir():
        return
    folder.mkdir(parents=True, exist_ok=True)
    others = [other for other in folder.parent.iterdir() if re.fullmatch("[0-9a-f]{16}", other.name)]
    for old in sorted(others, key=_last_use)[: -KEPT - 1]:
        shutil.rmtree(old, ignore_errors=True)


def _last_use(folder: Path) -> float:
    try:
        return folder.lstat().st_mtime
    except OSError:  # removed by another process
        return 0.0
