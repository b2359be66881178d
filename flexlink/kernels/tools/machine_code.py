"""All that kernels need of Numba beyond what it documents, in one place: a new version of Numba is tried here first.

Code on disk, under a key of all kernel sources. What Numba documents, `cache=True`, looks at the file of the function
alone, so that an edit in a helper's file would silently return stale machine code; it raises whatever reading a damaged
file raises; and where its folder cannot be written it falls back to one beside the sources, with code that other
sources may have left there. `code_files` says where it lies.

A file `.bin` has the machine code, with what Numba knows of the function; one of the same name, `.bc`, LLVM's bitcode,
which another function that copies this one needs, when that is compiled. It is read then, if written together with it:
two processes that compile the same function call it by different names. Functions that no Python and no symbol calls
have no machine code, and lie in a folder of their own. Processes that need the same function at the same time compile
it once: the others wait. The package has no bitcode, which would be five times as large: a function that a new one
copies is then compiled once more.

Borrowed arrays. Numba has no documented way to leave out the counting of references.

Code that callers share. Numba copies the code of a callee into that of its caller, to optimise both together, and so
does the caller's caller: a recursion is compiled once more for each of them. Most that are long get nothing from it.
Callers know those by a symbol instead, which says module, name and types, and is the same in every process.

A choice by types. What Numba documents, an overload, compiles one function more for each choice, with a copy of what it
calls.

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

from flexlink.kernels.tools import code_files
from flexlink.kernels.tools.absent import KernelCompiler
from flexlink.kernels.tools.code_files import Cpu, checked, families, make, read, write
from flexlink.kernels.tools.parts import part_of

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
    compiled._cache.folder, compiled._compiler.pipeline_class = PARTS, functools.partial(KernelCompiler, part=True)


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
    compiled._cache.folder, compiled._compiler.pipeline_class = "", KernelCompiler


def choose(call: Callable[..., Any], algorithms: dict[type, Any]) -> None:
    """Let kernels that call `call` call one of the compiled algorithms instead, by the type of the last argument."""

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
    """Those that it is of."""
    return [name for _, name, _ in families(here())]


SHARED = "flexlink."
"""How symbols of shared code begin."""
_SHARED: dict[str, tuple[Any, tuple[Any, ...]]] = {}


def _called(library: Any) -> list[tuple[str, str, tuple[Any, ...]]]:
    """The shared functions that machine code calls: module, name and types of each."""
    symbols = {function.name for function in library._final_module.functions if function.is_declaration}
    called = [_SHARED[symbol] for symbol in sorted(symbols & _SHARED.keys())]
    return [(compiled.__module__, compiled.__name__, types) for compiled, types in called]


def keep_on_disk(compiled: Any) -> None:
    """Let a compiled function look for its machine code on disk first, and leave it there."""
    compiled._cache = cache = DiskCache(compiled)
    compiled._compiler.compile = functools.partial(cache.compile_once, compiled._compiler.compile)


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
        return str(code_files.FOLDER)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function for `signature`, or None."""
        rtsys.initialize(target)
        for content in self._contents(signature, target.codegen().magic_tuple()):
            with contextlib.suppress(Exception):  # whatever is wrong with it
                called, rest = pickle.loads(content)
                for module, name, types in called:  # before the code, which looks for their symbols
                    getattr(importlib.import_module(module), name).compile(types)
                mark, *parts = pickle.loads(rest)
                found = _rebuilt(target, *parts)
                file = self._file(signature, target.codegen().magic_tuple())
                found.library._get_module_for_linking = functools.partial(self._module, found, file, mark)
                return found
        return None

    def _contents(self, signature: Any, cpu: Cpu) -> Iterator[bytes]:
        """What the user's folder, then the package, have for this CPU or a family that it is of."""
        files = [self._file(signature, each) for each in (cpu, *families(cpu))]
        for file in files:
            with contextlib.suppress(OSError, ValueError):
                yield read(file)
        for file in files:
            with contextlib.suppress(KeyError, ValueError):
                yield checked(code_files.shipped(cpu)[file.name])

    def _file(self, signature: Any, cpu: Cpu) -> Path:
        """Where the user's folder has the code for a CPU."""
        return code_files.FOLDER / self.folder / f"{_key(self._function, signature, cpu)}.bin"

    def _module(self, found: Any, file: Path, mark: bytes) -> Any:
        """LLVM's module of code that was on disk, for a function that copies it."""
        if found.library._shared_module is None:
            try:
                bitcode = read(file.with_suffix(".bc"), mark)
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

    def compile_once(self, compile_: Callable[..., Any], arguments: tuple[Any, ...], returned: Any) -> Any:
        """The function, compiled by this process, or by another one that was about it."""
        target = cpu_target.target_context
        with code_files.alone(self._file(arguments, target.codegen().magic_tuple())) as file:
            found = self.load_overload(arguments, target) if file.exists() else None
            if found:
                target.insert_user_function(found.entry_point, found.fndesc, [found.library])
                return found
            found = compile_(arguments, returned)
            if not (found.lifted or found.library.has_dynamic_globals or self._function.__closure__):
                self._save(file, found)  # nothing that only this process knows
            return found

    def _save(self, file: Path, compiled: Any) -> None:
        """Keep a compiled function; where that fails, the process says so, once, and goes on."""
        (name, _, (code, bitcode)), *others = compiled._reduce()
        others[5] = ""  # the sources with all types, as text
        others[7] = ()  # constants of what was copied: parts, which have none
        known = compiled.fndesc.mangled_name, compiled.fndesc.llvm_cpython_wrapper_name
        symbols = {each.name for each in compiled.library._final_module.functions if not each.is_declaration}
        try:
            make(code_files.FOLDER)
            file.parent.mkdir(exist_ok=True)
            mark = write(file.with_suffix(".bc"), bitcode)
            rest = serialize.dumps((mark, name, code, [each for each in known if each in symbols], *others))
            write(file, serialize.dumps((_called(compiled.library), rest)))
        except OSError as error:
            self._tell(error)

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Nothing: it was kept when it was compiled."""

    def flush(self) -> None:
        """Forget nothing: a file that is there is right."""

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


def _rebuilt(target: Any, name: str, code: bytes, symbols: list[str], *others: Any) -> Any:
    """What Numba knows of a function that was on disk."""
    if not code:
        return part_of(target, name, *others)
    target.codegen()._engine._defined_symbols.update(symbols)
    found = CompileResult._rebuild(target, (name, "object", (code, NO_BITCODE)), *others)
    found.library._shared_module = None
    return found


def _key(function: Callable[..., Any], types: Any, cpu: Cpu = ("", "", "")) -> str:
    """Name of the code of a function for arguments of these types, on a CPU as Numba names it, or on any."""
    own = _source(function.__code__.co_filename)
    digest = hashlib.sha256(repr((types, cpu)).encode() + own).hexdigest()[:16]
    return f"{function.__module__}.{function.__qualname__}-{digest}"


@functools.cache
def _source(file: str) -> bytes:
    """The sources of a function that the name of the folder does not hash."""
    source = Path(file)
    return b"" if source.is_relative_to(code_files.HERE) else source.read_bytes()
