"""Remove code for absent parts: `if record.part is not None` is decided at compile time, by the type of the record.

Numba removes such a branch only if an argument itself is None. This pass also handles parts of arguments that are named
tuples, and arguments that are not None. The kernels of a plain chain then contain no code for branches, prismatic
joints and force elements, and the kernels of other chains contain no run-time tests of `None`.
"""

import operator
from typing import Any

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.typed_passes import NativeLowering
from numba.core.untyped_passes import IRProcessing

from flexlink.kernels.tools.parts import LowerKernel, Part


@register_pass(mutates_CFG=False, analysis_only=False)
class DecideAbsent(FunctionPass):
    """Replace `x is None` and `x is not None` by a constant where the arguments determine the type of x."""

    _name = "flexlink_decide_absent"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Rewrite all such expressions; Numba then removes the dead branches."""
        changed = False
        for block in state.func_ir.blocks.values():
            for each in block.body:
                value = each.value if isinstance(each, ir.Assign) else None
                if isinstance(value, ir.Expr) and value.op == "binop" and value.fn in (operator.is_, operator.is_not):
                    found = [_type_of(state.func_ir, state.args, side) for side in (value.lhs, value.rhs)]
                    if None not in found and types.none in found:
                        same = found[0] == found[1]
                        constant = ir.Const(same == (value.fn is operator.is_), loc=each.loc)
                        definitions = state.func_ir._definitions[each.target.name]
                        definitions[definitions.index(value)] = each.value = constant
                        changed = True
        return changed


def _type_of(func_ir: Any, arguments: Any, variable: Any) -> Any:
    """Return the type of a variable that is an argument, a part of an argument, or None; otherwise return None."""
    value = guard(get_definition, func_ir, variable)
    if isinstance(value, ir.Const) and value.value is None:
        return types.none
    if isinstance(value, ir.Arg):
        found = arguments[value.index]
        return None if isinstance(found, types.Optional | types.Omitted) else found
    if isinstance(value, ir.Expr) and value.op == "getattr":
        whole = _type_of(func_ir, arguments, value.value)
        if isinstance(whole, types.BaseNamedTuple) and value.attr in whole.fields:
            return whole[whole.fields.index(value.attr)]
    if isinstance(value, ir.Expr) and value.op == "static_getitem":  # one of a, b, c = x.a, x.b, x.c
        items = guard(get_definition, func_ir, value.value)
        while isinstance(items, ir.Expr) and items.op == "exhaust_iter":
            items = guard(get_definition, func_ir, items.value)
        if isinstance(items, ir.Expr) and items.op == "build_tuple":
            return _type_of(func_ir, arguments, items.items[value.index])
    if isinstance(value, ir.Expr) and value.op in ("getitem", "static_getitem"):
        whole = _type_of(func_ir, arguments, value.value)
        return whole.dtype if isinstance(whole, types.UniTuple | types.NamedUniTuple) else None
    return None


UNUSED = {
    "WithLifting", "InlineClosureLikes", "InlineInlinables", "InlineOverloads", "FindLiterallyCalls", "LiteralUnroll",
}  # fmt: skip
"""Passes for parts of Python that kernels do not use: `with`, functions in functions, literal arguments."""


class KernelCompiler(CompilerBase):
    """Numba's compiler with this pass; for a function that is only inlined it makes a `Part`."""

    def __init__(self, *arguments: Any, part: bool = False) -> None:
        super().__init__(*arguments)
        self.part = part

    def define_pipelines(self) -> list[Any]:
        """Passes of the compiler."""
        if self.part:
            self.state.library = Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(DecideAbsent, IRProcessing)
        passes.passes = [
            (LowerKernel if each is NativeLowering else each, text)
            for each, text in passes.passes
            if each.__name__ not in UNUSED
        ]
        passes.finalize()
        return [passes]
