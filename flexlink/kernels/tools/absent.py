"""What a record lacks, None, is no code: `if record.part is not None` is decided by the type of the record.

Numba leaves out the branch that is not taken where an argument itself is None. Here parts of arguments that are named
tuples count, too, and arguments that are something: a plain chain is then compiled without branches, slides and force
elements, and one that has them without a test for them.
"""

import operator
from typing import Any

from numba.core import ir, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.ir_utils import get_definition, guard
from numba.core.untyped_passes import IRProcessing

from flexlink.kernels.tools.parts import Part


@register_pass(mutates_CFG=False, analysis_only=False)
class DecideAbsent(FunctionPass):
    """Put a constant for `x is None` and `x is not None` where the type of x is known from the arguments."""

    _name = "flexlink_decide_absent"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Rewrite them all; Numba's own pruning of dead branches does the rest."""
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
    """Type of a variable that is an argument, a part of one, or None; None of any other."""
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


class KernelCompiler(CompilerBase):
    """Numba's compiler with this pass; of what is only copied it makes a `Part`."""

    def __init__(self, *arguments: Any, part: bool = False) -> None:
        super().__init__(*arguments)
        self.part = part

    def define_pipelines(self) -> list[Any]:
        """Its passes."""
        if self.part:
            self.state.library = Part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(DecideAbsent, IRProcessing)
        passes.finalize()
        return [passes]
