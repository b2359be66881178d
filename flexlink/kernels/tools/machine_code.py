"""Everything that kernels use of Numba's undocumented interfaces, in one place: test new versions of Numba here first.

Code on disk: the folder's name is a hash of all sources. The documented option `cache=True` checks only the file of the
function itself, so an edit of another file would silently return stale machine code. Numba does not catch exceptions
from reading a damaged file. If the folder is not writable, Numba uses a folder beside the sources, which may contain
code of other sources. `code_files` describes the folders.

A file `.bin` contains the machine code and Numba's record of the function. The `.bc` file of the same name contains
LLVM bitcode, needed to compile another function that inlines this one. The bitcode is used only if it was written
together with the `.bin`, since processes that compile the same function give it different names. Functions that are
only inlined have no machine code and a separate folder. If several processes need a function at the same time, one
compiles it and the others wait. The package ships no bitcode, which would be five times as large. A shipped function is
therefore compiled once more if new code inlines it.

Borrowed arrays (`BORROWS`): Numba has no documented way to omit counting references to a caller's arrays.

Shared code: Numba inlines the code of a callee into its caller, to optimize both together, and both into the caller's
caller, so a recursion is compiled again for each of them. Most long functions gain nothing from this. Their callers
call them by a symbol instead, which consists of module, name and types, and is the same in every process.

Selection by type: an overload, the documented way, adds a compiled function per selection, with a copy of the callee.

Calls from a loop in Python: to find its code, a call examines the types of all arguments, array by array, in 4 to
10 µs. Looking up the code once, for calls without this check, takes 0.7 ms; later lookups use the fingerprint by which
Numba remembers types.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import hashlib
import importlib
import pickle
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import llvmlite.binding
import numba
from numba._dispatcher import compute_fingerprint
from numba.core import serialize, types
from numba.core.compiler import CompileResult
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.np.numpy_support import as_dtype as as_dtype  # noqa: PLC0414  for `compiler`

from flexlink.kernels.tools import code_files
from flexlink.kernels.tools.absent import KernelCompiler
from flexlink.kernels.tools.code_files import Cpu, checked, families, make, read, write
from flexlink.kernels.tools.parts import part_of

BORROWS: dict[str, Any] = {"_nrt": False}
"""Option for functions that allocate no arrays: references to the caller's arrays are not counted, which saves about
10 ns per array and call (two atomic instructions), as much as a joint costs."""

NO_C: dict[str, Any] = {"no_cfunc_wrapper": True}  # no C callback wrapper
ONLY_KERNELS: dict[str, Any] = {"no_cpython_wrapper": True, **NO_C}
"""Options for functions that Python does not call: no wrapper that unpacks the arguments array by array, which is as
long as a recursion."""


def direct(compiled: Any, *arguments: Any, types: bytes = b"") -> Callable[..., Any]:
    """The compiled code of a kernel for the types of these arguments; calls with other types are not detected.

    `types`, for example `types_of` some of the arguments, must identify the types of all arguments, which the caller
    guarantees; this saves 10 to 30 µs.
    """
    if numba.config.DISABLE_JIT:
        return cast("Callable[..., Any]", compiled)
    key = compiled, types or compute_fingerprint(arguments)
    if key not in _FOUND:
        _FOUND[key] = compiled.compile(tuple(compiled.typeof_pyval(argument) for argument in arguments))
    return _FOUND[key]


def types_of(*arguments: Any) -> bytes:
    """Fingerprint that identifies the types of arguments."""
    return b"" if numba.config.DISABLE_JIT else bytes(compute_fingerprint(arguments))


def size_of(kind: Any) -> int:
    """Number of bytes of a value of a Numba type in memory."""
    target = cpu_target.target_context
    return int(target.get_abi_sizeof(target.get_value_type(kind)))


_FOUND: dict[tuple[Any, bytes], Callable[..., Any]] = {}


def refuse_python(compiled: Any) -> None:
    """Make a function compiled with `ONLY_KERNELS` raise an error when called from Python, instead of crashing."""

    def add_overload(result: Any) -> None:  # for kernels only; not found by calls from Python
        compiled.overloads[tuple(result.signature.args)] = result

    def refuse(*arguments: Any, **keywords: Any) -> None:
        raise TypeError(f"{compiled.__name__}: only kernels can call it; make it an `entry` to call it from Python")

    compiled.add_overload, compiled._compile_for_args = add_overload, refuse
    compiled._cache.folder, compiled._compiler.pipeline_class = PARTS, functools.partial(KernelCompiler, part=True)


def share(compiled: Any) -> None:
    """Make compiled kernels call a compiled function by its symbol instead of inlining a copy."""
    own = compiled.add_overload

    def add_overload(result: Any) -> None:
        own(result)
        context, types = result.target_context, tuple(result.signature.args)
        symbol = f"{SHARED}{_key(compiled.py_func, types)}"
        if _SHARED.setdefault(symbol, (compiled, types))[0] is not compiled:
            return  # a function of the same name that was redefined
        llvmlite.binding.add_symbol(symbol, result.library.get_pointer_to_function(result.fndesc.mangled_name))
        known = copy.copy(result.fndesc)
        known.mangled_name = symbol
        context.remove_user_function(result.entry_point)
        context.insert_user_function(result.entry_point, known)

    compiled.add_overload = add_overload
    compiled._cache.folder, compiled._compiler.pipeline_class = "", KernelCompiler


def choose(call: Callable[..., Any], algorithms: dict[type, Any]) -> None:
    """In kernels, replace calls of `call` by calls of one algorithm, selected by the type of the last argument."""

    class Chosen(AbstractTemplate):
        key = call

        def generic(self, arguments: Any, keywords: Any) -> Any:
            chosen = types.Dispatcher(algorithms[arguments[-1].instance_class])
            signature = chosen.get_call_type(self.context, arguments, keywords)
            self.compiled = chosen.get_overload(signature)
            return signature

        def get_impl_key(self, signature: Any) -> Any:
            return self.compiled

    infer_global(call, types.Function(Chosen))


def here() -> Cpu:
    """This machine's CPU."""
    cpu: Cpu = cpu_target.target_context.codegen().magic_tuple()
    return cpu


def families_here() -> list[str]:
    """Names of the families to which this CPU belongs."""
    return [name for _, name, _ in families(here())]


SHARED = "flexlink."
"""Prefix of the symbols of shared code."""
_SHARED: dict[str, tuple[Any, tuple[Any, ...]]] = {}


def _called(library: Any) -> list[tuple[str, str, tuple[Any, ...]]]:
    """Return module, name and types of every shared function that machine code calls."""
    symbols = {function.name for function in library._final_module.functions if function.is_declaration}
    called = [_SHARED[symbol] for symbol in sorted(symbols & _SHARED.keys())]
    return [(compiled.__module__, compiled.__name__, types) for compiled, types in called]


def keep_on_disk(compiled: Any) -> None:
    """Make a compiled function load its machine code from disk if possible, and save it there."""
    compiled._cache = cache = DiskCache(compiled)
    compiled._compiler.compile = functools.partial(cache.compile_once, compiled._compiler.compile)


PARTS = "parts"
"""Folder for code that is only inlined by other code."""
NO_BITCODE = llvmlite.binding.parse_assembly("").as_bitcode()


class DiskCache:
    """Replacement for Numba's cache of one function: one file per signature; a missing or damaged file is ignored."""

    warned = False  # whether the user was warned that code cannot be saved
    folder = ""

    def __init__(self, compiled: Any) -> None:
        self._compiled, self._function = compiled, compiled.py_func

    @property
    def cache_path(self) -> str:
        """Folder of the cached files."""
        return str(code_files.FOLDER)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function for `signature`, or None."""
        rtsys.initialize(target)
        for content in self._contents(signature, target.codegen().magic_tuple()):
            with contextlib.suppress(Exception):  # a damaged file may raise anything
                called, rest = pickle.loads(content)
                for module, name, types in called:  # before the code that needs their symbols
                    getattr(importlib.import_module(module), name).compile(types)
                mark, *parts = pickle.loads(rest)
                found = _rebuilt(target, *parts)
                file = self._file(signature, target.codegen().magic_tuple())
                found.library._get_module_for_linking = functools.partial(self._module, found, file, mark)
                return found
        return None

    def _contents(self, signature: Any, cpu: Cpu) -> Iterator[bytes]:
        """Yield file contents from the user's folder, then from the package, for this CPU or its families."""
        files = [self._file(signature, each) for each in (cpu, *families(cpu))]
        for file in files:
            with contextlib.suppress(OSError, ValueError):
                yield read(file)
        for file in files:
            with contextlib.suppress(KeyError, ValueError):
                yield checked(code_files.shipped(cpu)[file.name])

    def _file(self, signature: Any, cpu: Cpu) -> Path:
        """File in the user's folder with the code for a CPU."""
        return code_files.FOLDER / self.folder / f"{_key(self._function, signature, cpu)}.bin"

    def _module(self, found: Any, file: Path, mark: bytes) -> Any:
        """LLVM module of code loaded from disk, for a function that inlines it."""
        if found.library._shared_module is None:
            try:
                bitcode = read(file.with_suffix(".bc"), mark)
            except (OSError, ValueError):
                found.library._shared_module = self._module_of_sources(found)
            else:
                found.library._shared_module = llvmlite.binding.parse_bitcode(bitcode)
        return found.library._shared_module

    def _module_of_sources(self, found: Any) -> Any:
        """The same module compiled again from the sources, under the name by which the function is known."""
        anew = self._compiled._compiler._compile_core(tuple(found.signature.args), None)
        module = llvmlite.binding.parse_bitcode(anew.library._get_module_for_linking().as_bitcode())
        module.get_function(anew.fndesc.mangled_name).name = found.fndesc.mangled_name
        return module

    def compile_once(self, compile_: Callable[..., Any], arguments: tuple[Any, ...], returned: Any) -> Any:
        """The function, compiled by this process or by another one that has begun to compile it."""
        target = cpu_target.target_context
        with code_files.alone(self._file(arguments, target.codegen().magic_tuple())) as file:
            found = self.load_overload(arguments, target) if file.exists() else None
            if found:
                target.insert_user_function(found.entry_point, found.fndesc, [found.library])
                return found
            found = compile_(arguments, returned)
            if not (found.lifted or found.library.has_dynamic_globals or self._function.__closure__):
                self._save(file, found)  # contains nothing specific to this process
            return found

    def _save(self, file: Path, compiled: Any) -> None:
        """Save a compiled function; if that fails, warn once and continue."""
        (name, _, (code, bitcode)), *others = compiled._reduce()
        others[5] = ""  # the typed sources as text
        others[7] = ()  # constants of inlined code: parts, which have none
        known = compiled.fndesc.mangled_name, compiled.fndesc.llvm_cpython_wrapper_name
        symbols = {each.name for each in compiled.library._final_module.functions if not each.is_declaration}
        try:
            make(code_files.FOLDER)
            file.parent.mkdir(exist_ok=True)
            mark = write(file.with_suffix(".bc"), bitcode)
            rest = serialize.dumps((mark, name, code, [each for each in known if each in symbols], *others))
            write(file, serialize.dumps((_called(compiled.library), rest)))
        except OSError as error:
            self._warn(error)

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Do nothing: the code was saved when it was compiled."""

    def flush(self) -> None:
        """Do nothing: existing files are valid."""

    @classmethod
    def _warn(cls, why: OSError) -> None:
        if not cls.warned:
            cls.warned = True
            warnings.warn(
                f"compiled code cannot be cached, so every process compiles again: {why}; set NUMBA_CACHE_DIR to a "
                "writable folder",
                RuntimeWarning,
                stacklevel=2,
            )


def _rebuilt(target: Any, name: str, code: bytes, symbols: list[str], *others: Any) -> Any:
    """Numba's record of a function that was loaded from disk."""
    if not code:
        return part_of(target, name, *others)
    target.codegen()._engine._defined_symbols.update(symbols)
    found = CompileResult._rebuild(target, (name, "object", (code, NO_BITCODE)), *others)
    found.library._shared_module = None
    return found


def _key(function: Callable[..., Any], types: Any, cpu: Cpu = ("", "", "")) -> str:
    """Name of the code of a function for arguments of these types, on a CPU as named by Numba, or on any CPU."""
    own = _source(function.__code__.co_filename)
    digest = hashlib.sha256(repr((types, cpu)).encode() + own).hexdigest()[:16]
    return f"{function.__module__}.{function.__qualname__}-{digest}"


@functools.cache
def _source(file: str) -> bytes:
    """Source file of a function if it is not part of the folder's hash, otherwise nothing."""
    source = Path(file)
    return b"" if source.is_relative_to(code_files.HERE) else source.read_bytes()
