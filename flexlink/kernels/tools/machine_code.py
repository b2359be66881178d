"""All that kernels need of Numba beyond what it documents, in one place: a new version of Numba is tried here first.

Code on disk, under a key of all kernel sources. What Numba documents, `cache=True`, looks at the file of the function
alone, so that an edit in a helper's file would silently return stale machine code; it raises whatever reading a damaged
file raises; and where its folder cannot be written it falls back to one beside the sources, with code that other
sources may have left there. Here the name of the folder hashes every kernel file, the layout of
their records among them, and the versions that compile them. A user's NUMBA_CACHE_DIR says where that folder lies.

A file `.bin` has the machine code, with what Numba knows of the function; one of the same name, `.bc`, LLVM's bitcode,
which another function that copies this one needs, when that is compiled. It is read then, if written together with it:
two processes that compile the same function call it by different names. Functions that no Python and no symbol calls
lie in a folder of their own.

Borrowed arrays. Numba has no documented way to leave out the counting of references.

Code of the package. A wheel carries code for families of CPUs, x86-64-v3 and v4, one built from source that for the CPU
that it was built on, in a folder of the same name. It is looked up where a user's own folder has none. Code of several
families works together: all calls are alike. No bitcode is with it, which would be three times as large: a function
that a new one copies is then compiled once more.

Code that callers share. Numba copies the code of a callee into that of its caller, to optimise both together, and so
does the caller's caller: a recursion is compiled once more for each of them. Most that are long get nothing from it.
Callers know those by a symbol instead, which says module, name and types, and is the same in every process.

Calls from a loop in Python. A call looks at the types of all arguments, array by array, to find its code: 4 to 10 µs.
To find the code itself, for calls that do not look, takes 0.7 ms, unless it was found before: the fingerprint by which
Numba's own calls remember types tells.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import hashlib
import importlib
import os
import pickle
import re
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import llvmlite
import llvmlite.binding
import numba
from numba._dispatcher import compute_fingerprint
from numba.core import serialize
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target

from flexlink.common.output import write_whole

HERE = Path(__file__).parent.parent
BORROWS: dict[str, Any] = {"_nrt": False}
"""Option of functions that make no arrays, only borrow those of their caller: references to them are not counted, which
costs about 10 ns per array and call (two atomic instructions), as much as a joint."""

NO_C: dict[str, Any] = {"no_cfunc_wrapper": True}  # no entry for callers in C, which there are none of
ONLY_KERNELS: dict[str, Any] = {"no_cpython_wrapper": True, **NO_C}
"""Option of functions that Python does not call: the code that takes its objects apart, array by array, is as long as a
recursion itself."""


def direct(compiled: Any, *arguments: Any, types: bytes = b"") -> Callable[..., Any]:
    """The code of a kernel for arguments of these types, compiled; it looks at no types, so none but these may come.

    Who knows that other calls with the same `types`, such as `types_of` a part of the arguments, have the same in all
    other arguments, too, need not have them looked at: 10 to 30 µs.
    """
    if numba.config.DISABLE_JIT:
        return cast("Callable[..., Any]", compiled)
    key = compiled, types or compute_fingerprint(arguments)
    if key not in _FOUND:
        _FOUND[key] = compiled.compile(tuple(compiled.typeof_pyval(argument) for argument in arguments))
    return _FOUND[key]


def types_of(*arguments: Any) -> bytes:
    """What distinguishes the types of arguments from all others."""
    return b"" if numba.config.DISABLE_JIT else bytes(compute_fingerprint(arguments))


_FOUND: dict[tuple[Any, bytes], Callable[..., Any]] = {}


def refuse_python(compiled: Any) -> None:
    """Let a function that was compiled with `ONLY_KERNELS` answer a call from Python with an error, not a crash."""

    def add_overload(result: Any) -> None:  # for kernels; not among those that Python's calls are looked up in
        compiled.overloads[tuple(result.signature.args)] = result

    def refuse(*arguments: Any, **keywords: Any) -> None:
        raise TypeError(f"{compiled.__name__}: only kernels can call it; as an `entry` Python can, too")

    compiled.add_overload, compiled._compile_for_args = add_overload, refuse
    compiled._cache.folder = PARTS


def share(compiled: Any) -> None:
    """Let the code of kernels call a function that was compiled by its symbol, and hold no copy of it."""
    own = compiled.add_overload

    def add_overload(result: Any) -> None:
        own(result)
        context, types = result.target_context, tuple(result.signature.args)
        symbol = f"{SHARED}{_key(compiled.py_func, types)}"
        if _SHARED.setdefault(symbol, (compiled, types))[0] is not compiled:
            return  # a function of the same name, defined anew
        llvmlite.binding.add_symbol(symbol, result.library.get_pointer_to_function(result.fndesc.mangled_name))
        known = copy.copy(result.fndesc)
        known.mangled_name = symbol
        context.remove_user_function(result.entry_point)
        context.insert_user_function(result.entry_point, known)

    compiled.add_overload = add_overload
    compiled._cache.folder = ""


SHARED = "flexlink."
"""How symbols of shared code begin."""
_SHARED: dict[str, tuple[Any, tuple[Any, ...]]] = {}


def _called(library: Any) -> list[tuple[str, str, tuple[Any, ...]]]:
    """The shared functions that machine code calls: module, name and types of each."""
    symbols = {function.name for function in library._final_module.functions if function.is_declaration}
    called = [_SHARED[symbol] for symbol in sorted(symbols & _SHARED.keys())]
    return [(compiled.__module__, compiled.__name__, types) for compiled, types in called]


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
}
"""Families of CPUs, the best first, and what their members have (System V ABI, x86-64 psABI, table 3.1)."""


def families(cpu: tuple[str, str, str]) -> list[tuple[str, str, str]]:
    """Those that a CPU is of, as Numba names targets: triple, name, features."""
    triple, _, features = cpu
    has = {feature[1:] for feature in features.split(",") if feature[:1] == "+"}
    return [(triple, name, "") for name, needed in FAMILIES.items() if has.issuperset(needed.split())]


def families_here() -> list[str]:
    """Those that this machine's CPU is of."""
    return [name for _, name, _ in families(cpu_target.target_context.codegen().magic_tuple())]


_FOLDER = cache_folder()  # now, before the sources can change under a running process
_SHIPPED = HERE.parent / "machine_code" / _FOLDER.name  # the code that the package carries
with contextlib.suppress(OSError):
    os.utime(_FOLDER)  # used


def keep_on_disk(compiled: Any) -> None:
    """Let a compiled function look for its machine code on disk first, and leave it there."""
    compiled._cache = DiskCache(compiled)


PARTS = "parts"
"""Folder of code that is only copied by other code."""
NO_BITCODE = llvmlite.binding.parse_assembly("").as_bitcode()


class DiskCache:
    """Machine code of one function in the place of numba's cache: files of each signature, with their checksums.

    A file that is missing, torn or damaged is as good as none: the code is compiled anew.
    """

    told = False  # that code cannot be kept
    folder = ""

    def __init__(self, compiled: Any) -> None:
        self._compiled, self._function = compiled, compiled.py_func

    @property
    def cache_path(self) -> str:
        """Where the files lie."""
        return str(_FOLDER)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function for `signature`, or None."""
        target.refresh()
        for file in self._files(signature, target.codegen().magic_tuple()):
            with contextlib.suppress(Exception):  # whatever is wrong with the file, or with where it should lie
                called, rest = pickle.loads(_read(file))
                for module, name, types in called:  # before the code, which looks for their symbols
                    getattr(importlib.import_module(module), name).compile(types)
                symbols, mark, name, code, *others = pickle.loads(rest)
                target.codegen()._engine._defined_symbols.update(symbols)
                found = CompileResult._rebuild(target, (name, "object", (code, NO_BITCODE)), *others)
                found.library._shared_module = None
                found.library._get_module_for_linking = functools.partial(self._module, found, file, mark)
                return found
        return None

    def _module(self, found: Any, file: Path, mark: bytes) -> Any:
        """LLVM's module of code that was on disk, for a function that copies it."""
        if found.library._shared_module is None:
            try:
                bitcode = _read(file.with_suffix(".bc"), mark)
            except (OSError, ValueError):
                found.library._shared_module = self._module_of_sources(found)
            else:
                found.library._shared_module = llvmlite.binding.parse_bitcode(bitcode)
        return found.library._shared_module

    def _module_of_sources(self, found: Any) -> Any:
        """The same, compiled anew, under the name by which the function is known."""
        anew = self._compiled._compiler._compile_core(tuple(found.signature.args), None)
        module = llvmlite.binding.parse_bitcode(anew.library._get_module_for_linking().as_bitcode())
        module.get_function(anew.fndesc.mangled_name).name = found.fndesc.mangled_name
        return module

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep a compiled function; where that fails, the process says so, once, and goes on."""
        if compiled.lifted or compiled.library.has_dynamic_globals or self._function.__closure__:
            return  # holds what only this process knows
        (name, _, (code, bitcode)), *others = compiled._reduce()
        others[ANNOTATION] = ""
        module = compiled.library._get_module_for_linking()
        symbols = [each.name for each in (*module.functions, *module.global_variables) if not each.is_declaration]
        try:
            file = next(self._files(signature, compiled.codegen.magic_tuple()))
            _make(_FOLDER)
            file.parent.mkdir(exist_ok=True)
            mark = _write(file.with_suffix(".bc"), bitcode)
            rest = serialize.dumps((symbols, mark, name, code, *others))
            _write(file, serialize.dumps((_called(compiled.library), rest)))
        except OSError as error:
            self._tell(error)

    def flush(self) -> None:
        """Forget nothing: a file that is there is right."""

    def _files(self, signature: Any, cpu: tuple[str, str, str]) -> Iterator[Path]:
        """Where the code of this CPU is kept, and others that serve."""
        yield _FOLDER / self.folder / f"{_key(self._function, signature, cpu)}.bin"
        if _SHIPPED.is_dir():
            for each in (cpu, *families(cpu)):
                yield _SHIPPED / f"{_key(self._function, signature, each)}.bin"

    @classmethod
    def _tell(cls, why: OSError) -> None:
        if not cls.told:
            cls.told = True
            warnings.warn(
                f"compiled code cannot be cached, so every process compiles again: {why}; set NUMBA_CACHE_DIR to a "
                "writable folder",
                RuntimeWarning,
                stacklevel=2,
            )


def _key(function: Callable[..., Any], types: Any, cpu: tuple[str, str, str] = ("", "", "")) -> str:
    """Name of the code of a function for arguments of these types, on a CPU as Numba names it, or on any."""
    own = _source(function.__code__.co_filename)
    digest = hashlib.sha256(repr((types, cpu)).encode() + own).hexdigest()[:16]
    return f"{function.__module__}.{function.__qualname__}-{digest}"


@functools.cache
def _source(file: str) -> bytes:
    """The sources of a function that the name of the folder does not hash."""
    source = Path(file)
    return b"" if source.is_relative_to(HERE) else source.read_bytes()


ANNOTATION = 5  # place in what Numba keeps of a function, behind its code: the sources with all types, as text


def _read(file: Path, mark: bytes = b"") -> bytes:
    content, size = file.read_bytes(), hashlib.sha256().digest_size
    if hashlib.sha256(content[size:]).digest() != content[:size] or not content.startswith(mark):
        raise ValueError(f"{file}: damaged, or not the one with that checksum")
    return content[size:]


def _write(file: Path, content: bytes) -> bytes:
    checksum = hashlib.sha256(content).digest()
    write_whole(file, lambda place: place.write_bytes(checksum + content))
    return checksum


def _make(folder: Path) -> None:
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
