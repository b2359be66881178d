"""LLVM code of functions that are only inlined into others.

Most functions are never called by their address, but inlined by their callers. Generating machine code for them, and
optimizing them fully before they are inlined, would take a seventh of the compile time.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult


class Part(JITCodeLibrary):
    """Code library of a function that is only inlined: no machine code, and only the passes that shorten it."""

    def _optimize_final_module(self) -> None:
        codegen = self._codegen
        passes, builder = codegen._module_pass_manager(
            loop_vectorize=codegen._loopvect, slp_vectorize=False, opt=codegen._opt_level, cost="cheap"
        )
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """Library for constants of called functions, which a part does not contain."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing."""

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """Return the bitcode, without object code."""
        return self.name, "object", (b"", self._get_module_for_linking().as_bitcode())


def part_of(
    target: Any, name: str, descriptor: Any, environment: Any, signature: Any, mode: Any, lifted: Any, annotation: str,
    reload_init: Any, environments: Any,
) -> CompileResult:  # fmt: skip
    """Numba's record of a function that is only inlined, restored from disk."""
    library = Part(target.codegen(), name)
    library._finalized = True
    return CompileResult(
        typing_context=target.typing_context,
        target_context=target,
        entry_point=target.get_executable(library, descriptor, environment),
        typing_error=None,
        type_annotation=annotation,
        signature=signature,
        objectmode=mode,
        lifted=lifted,
        fndesc=descriptor,
        library=library,
        call_helper=None,
        environment=environment,
        metadata=None,
        reload_init=reload_init,
        referenced_envs=environments,
    )
