"""LLVM code of kernels: less of it for records, and no machine code of functions that are only inlined into others.

A record of sixty arrays consists of four hundred machine words. Numba puts a record together from the words that a
function receives, word by word, stores it, loads all of it wherever it is used, and takes it apart again for every
call. LLVM would remove nearly all of this, in a seventh of the compile time. Here, a variable that is assigned once
stays out of memory, a part of a tuple is the value from which the tuple was made, and tuples of which only parts are
used are not made.

Most functions are never called by their address, but inlined by their callers. Generating machine code for them, and
optimizing them fully before they are inlined, would take another seventh.
"""

from __future__ import annotations

import collections
from typing import Any

from llvmlite.ir import Function, IRBuilder
from llvmlite.ir.instructions import ExtractValue, InsertValue, PhiInstr
from numba.core import ir
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering


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


class Builder(IRBuilder):
    """Writer of LLVM code that takes a part of a tuple from the instructions that put the tuple together."""

    def extract_value(self, agg: Any, idx: Any, name: str = "") -> Any:
        """Part of a tuple, without an instruction if its value is known."""
        indices = [*idx] if isinstance(idx, list | tuple) else [idx]
        while indices and isinstance(agg, InsertValue) and len(agg.indices) == 1:
            if agg.indices[0] == indices[0]:
                agg, indices = agg.value, indices[1:]
            else:
                agg = agg.aggregate
        return super().extract_value(agg, indices, name) if indices else agg


class KernelLower(Lower):
    """Translation of one function."""

    def setup_function(self, fndesc: Any) -> None:
        """Begin the function."""
        super().setup_function(fndesc)
        self.builder = Builder(self.entry_block)
        self.call_helper = self.call_conv.init_call_helper(self.builder)

    def _find_singly_assigned_variable(self) -> None:
        """Also find variables that are assigned once, before all blocks that use them; Numba finds those of a block.

        Where references are counted, a variable may be deleted twice: Numba then relies on a zero in memory.
        """
        super()._find_singly_assigned_variable()
        if self.context.enable_nrt:
            return
        blocks, assigned, used = self.func_ir.blocks, collections.defaultdict(list), collections.defaultdict(list)
        used_in = compute_use_defs(blocks).usemap
        for label, block in blocks.items():
            for each in block.find_insts(ir.Assign):
                assigned[each.target.name].append(label)
            for name in used_in[label] | {each.value for each in block.find_insts(ir.Del)}:
                used[name].append(label)
        dominators, excluded = compute_cfg_from_blocks(blocks).dominators(), must_use_alloca(blocks)
        for name, (first, *others) in assigned.items():
            before = all(first in dominators.get(use, ()) and first <= use for use in used[name])
            if not others and before and name not in excluded:
                self._singly_assigned_vars.add(name)

    def post_lower(self) -> None:
        """End the function."""
        super().post_lower()
        shorten(self.function)


@register_pass(mutates_CFG=True, analysis_only=False)
class LowerKernel(NativeLowering):
    """Numba's pass with this translation."""

    _name = "flexlink_lower_kernel"

    @property
    def lowering_class(self) -> Any:
        """Class for the translation."""
        return KernelLower


def shorten(function: Function) -> None:
    """Remove instructions that make tuples, or take parts of tuples, which are not used."""
    used = collections.Counter(
        id(value) for block in function.blocks for each in block.instructions for value in _operands(each)
    )
    for block in reversed(function.blocks):
        kept = []
        for each in reversed(block.instructions):
            if isinstance(each, InsertValue | ExtractValue) and not used[id(each)]:
                used.subtract(map(id, each.operands))
            else:
                kept.append(each)
        block.instructions[:] = kept[::-1]


def _operands(instruction: Any) -> Any:
    if isinstance(instruction, PhiInstr):
        return (value for value, _ in instruction.incomings)
    return instruction.operands
