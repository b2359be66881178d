"""Where machine code lies on disk: the user's folder of it, and the code that the package carries.

The name of a folder hashes every kernel file, the layout of their records among them, and the versions that compile
them. A user's NUMBA_CACHE_DIR says where that folder lies.

A package carries one archive of all files for each family of CPUs, x86-64, v3 and v4, one that is built from source for
the CPU that it was built on. It is unpacked into the user's folder when something is first missing there. Packed
together files are a fifteenth as large: most of them is names of types, the same in all. Code of several families works
together: all calls are alike.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
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
"""A CPU as Numba names targets: triple, name, features."""
HERE = Path(__file__).parent.parent
KEPT = 8  # folders of other sources and versions, up to 17 MB each, that stay: the last used


def sources() -> list[Path]:
    """Every file whose change makes kept machine code that of other sources."""
    return sorted(HERE.rglob("*.py"))


def state() -> str:
    """Name of the state of sources and versions, the same on every machine."""
    digest = hashlib.sha256(f"{sys.implementation.cache_tag} {numba.__version__} {llvmlite.__version__}".encode())
    for source in sources():
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where compiled kernels are kept: the user's cache folder, one sub-folder per state of sources and versions."""
    root = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    if not root and sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA")
    try:
        place = Path(root or Path.home() / ".cache").absolute()
    except RuntimeError:  # a user without a home
        place = Path(os.devnull)
    return place / "flexlink" / state()


FAMILIES = {
    "x86-64-v4": "avx512f avx512bw avx512cd avx512dq avx512vl avx2 bmi bmi2 f16c fma lzcnt movbe",
    "x86-64-v3": "avx2 bmi bmi2 f16c fma lzcnt movbe",
    "x86-64": "",
}
"""Families of CPUs, the best first, and what their members have (System V ABI, x86-64 psABI, table 3.1). The last one
rounds a·b + c twice, so that its results differ from those of the others in their last digits."""


def families(cpu: Cpu) -> list[Cpu]:
    """Those that a CPU is of."""
    triple, _, features = cpu
    has = {feature[1:] for feature in features.split(",") if feature[:1] == "+"}
    of = FAMILIES if triple.startswith("x86_64") else {}
    return [(triple, name, "") for name, needed in of.items() if has.issuperset(needed.split())]


FOLDER = cache_folder()  # now, before the sources can change under a running process
SHIPPED = HERE.parent / "machine_code" / FOLDER.name  # the code that the package carries
with contextlib.suppress(OSError):
    os.utime(FOLDER)  # used


def archive_name(cpu: Cpu) -> str:
    """Name of the archive of all code for a CPU or a family."""
    return f"{hashlib.sha256(repr(cpu).encode()).hexdigest()[:16]}.tar.xz"


def pack(code: Path, archive: Path) -> None:
    """Put the files of machine code in a folder into an archive, without what only compiling needs.

    Its filter finds what files at its two ends share, and takes bytes for text: 6 % smaller than by default.
    """
    densely = {"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "dict_size": 2**26, "lc": 4, "pb": 0}
    with lzma.open(archive, "w", filters=[densely]) as content, tarfile.open(fileobj=content, mode="w") as packed:
        for file in sorted(code.glob("*.bin")):
            packed.add(file, file.name)


@functools.cache
def shipped(cpu: Cpu) -> dict[str, bytes]:
    """The files that the package carries for a CPU; they are put into the user's folder, too, for later processes."""
    for each in (cpu, *families(cpu)):
        with contextlib.suppress(OSError, tarfile.TarError), tarfile.open(SHIPPED / archive_name(each)) as packed:
            files = {member.name: cast(IO[bytes], packed.extractfile(member)).read() for member in packed}
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
    """Wait while another process makes this file, and let none begin to meanwhile: both would compile the same."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):  # Windows; a folder that is not writable
            import fcntl  # noqa: PLC0415

            make(FOLDER)
            file.parent.mkdir(exist_ok=True)
            beside = file.with_suffix(".lock")
            lock = stack.enter_context(beside.open("w"))
            stack.callback(beside.unlink, missing_ok=True)
            until = time.monotonic() + 600.0  # [s], longer than any function takes
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
    """Content behind its checksum, which is `mark` where that is known."""
    size = hashlib.sha256().digest_size
    if hashlib.sha256(content[size:]).digest() != content[:size] or not content.startswith(mark):
        raise ValueError("damaged, or not that with this checksum")
    return content[size:]


def read(file: Path, mark: bytes = b"") -> bytes:
    """Content of a file behind its checksum."""
    return checked(file.read_bytes(), mark)


def write(file: Path, content: bytes) -> bytes:
    """Write a file with its checksum, which is returned."""
    checksum = hashlib.sha256(content).digest()
    write_whole(file, functools.partial(_fill, content=checksum + content))
    return checksum


def make(folder: Path) -> None:
    """A new folder takes the place of the one that was not used for longest.

    To remove one is safe at any time: a process that still uses it compiles anew what it does not find.
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
    except OSError:  # another process has just removed it
        return 0.0
