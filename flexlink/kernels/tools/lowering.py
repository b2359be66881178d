"""Numba's translation of kernels to LLVM code, with less code for records.

A record of sixty arrays consists of four hundred machine words. Numba puts a record together from the words that a
function receives, word by word, stores it, loads all of it wherever it is used, and takes it apart again for every
call. LLVM would remove nearly all of this, in a seventh of the compile time. Here, a variable that is assigned once
stays out of memory, a part of a tuple is the value from which the tuple was made, and tuples of which only parts are
used are not made. The function that Python calls unpacks all arrays of one type by the same code.
"""

from __future__ import annotations

import collections
import functools
from typing import Any

from llvmlite.ir import Constant, Function, FunctionType, IntType, IRBuilder, Undefined
from llvmlite.ir.instructions import ExtractValue, InsertValue, PhiInstr
from llvmlite.ir.types import Aggregate
from numba.core import cgutils, ir, types
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
from numba.core.callwrapper import PyCallWrapper
from numba.core.compiler_machinery import register_pass
from numba.core.lowering import Lower
from numba.core.pythonapi import NativeValue
from numba.core.typed_passes import NativeLowering


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

    def create_cpython_wrapper(self, release_gil: bool = False) -> None:
        """Make the function that Python calls."""
        fndesc, module = self.fndesc, self.context.create_module("wrapper")
        kind = self.call_conv.get_function_type(fndesc.restype, fndesc.argtypes)
        callee = Function(module, kind, fndesc.llvm_func_name)
        Wrapper(self.context, module, callee, fndesc, self.env, self.call_helper, release_gil).build()
        self.library.add_ir_module(module)


@register_pass(mutates_CFG=True, analysis_only=False)
class LowerKernel(NativeLowering):
    """Numba's pass with this translation."""

    _name = "flexlink_lower_kernel"

    @property
    def lowering_class(self) -> Any:
        """Class for the translation."""
        return KernelLower


class Wrapper(PyCallWrapper):
    """The function that Python calls; Numba's has a copy of the code that unpacks an array for each array."""

    def build(self) -> None:
        """Write the function."""
        self.unpackers: dict[types.Type, Function] = {}
        pyobj = self.context.get_argument_type(types.pyobject)
        wrapper = Function(self.module, FunctionType(pyobj, [pyobj] * 3), self.fndesc.llvm_cpython_wrapper_name)
        api = self.context.get_python_api(Builder(wrapper.append_basic_block("entry")))
        self.of_one, api.to_native_value = api.to_native_value, functools.partial(self._unpacked, api)
        self.build_wrapper(api, api.builder, *wrapper.args)
        shorten(wrapper)

    def _unpacked(self, api: Any, kind: types.Type, obj: Any) -> NativeValue:
        """Value of an argument."""
        if not _is_record(kind):
            return self.of_one(kind, obj)
        place = cgutils.alloca_once(api.builder, self.context.get_value_type(kind))
        failed = self._unpack(api, kind, obj, place)
        return NativeValue(_loaded(api.builder, place), is_error=failed)

    def _unpack(self, api: Any, kind: types.Type, obj: Any, place: Any) -> Any:
        """Write the value of an object to a place; returns whether this fails."""
        if isinstance(kind, types.Array):
            return api.builder.call(self._unpacker(kind), [obj, place])
        if not isinstance(kind, types.BaseTuple):
            native = self.of_one(kind, obj)
            api.builder.store(native.value, place)
            return native.is_error
        failed = cgutils.false_bit
        for k, part in enumerate(kind):
            within = cgutils.gep_inbounds(api.builder, place, 0, k)
            failed = api.builder.or_(failed, self._unpack(api, part, api.tuple_getitem(obj, k), within))
        return failed

    def _unpacker(self, kind: types.Type) -> Function:
        """A function (object, place) that does the same for arrays of a type."""
        if kind not in self.unpackers:
            pyobj, place = (
                self.context.get_argument_type(types.pyobject),
                self.context.get_value_type(kind).as_pointer(),
            )
            unpacker = Function(self.module, FunctionType(IntType(1), [pyobj, place]), f"unpack.{len(self.unpackers)}")
            unpacker.linkage = "internal"
            unpacker.attributes.add("noinline")
            builder = IRBuilder(unpacker.append_basic_block("entry"))
            native = self.context.get_python_api(builder).to_native_value(kind, unpacker.args[0])
            builder.store(native.value, unpacker.args[1])
            builder.ret(native.is_error)
            self.unpackers[kind] = unpacker
        return self.unpackers[kind]


def _is_record(kind: types.Type) -> bool:
    """Whether a type consists of arrays, numbers and None, also in tuples."""
    if isinstance(kind, types.BaseTuple):
        return all(map(_is_record, kind))
    return isinstance(kind, types.Array | types.Number | types.Boolean | types.NoneType)


def _loaded(builder: Builder, place: Any) -> Any:
    """The value at a place, of which only the words that are used are loaded."""
    kind = place.type.pointee
    if not isinstance(kind, Aggregate):
        return builder.load(place)
    value = Constant(kind, Undefined)
    for k in range(len(kind)):
        value = builder.insert_value(value, _loaded(builder, cgutils.gep_inbounds(builder, place, 0, k)), k)
    return value


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
