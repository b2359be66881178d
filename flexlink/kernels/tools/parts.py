"""Functions that are only copied: what LLVM holds of them.

Most functions are never called by their address: callers copy them. To make machine code of those, and to optimise them
fully before they are copied, takes a seventh of all compiling.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult


class Part(JITCodeLibrary):
    """Of a function that is only copied: no machine code, and only the passes that make it short."""

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
        """Where constants of called functions are put, which a part is not."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing."""

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """No object code."""
        return self.name, "object", (b"", self._get_module_for_linking().as_bitcode())


def part_of(
    target: Any, name: str, descriptor: Any, environment: Any, signature: Any, mode: Any, lifted: Any, annotation: str,
    reload_init: Any, environments: Any,
) -> CompileResult:  # fmt: skip
    """What Numba knows of a function that is only copied, from what it kept of it."""
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
