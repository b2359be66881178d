"""Conditions that rarely hold: LLVM lays out the code that they guard apart, and keeps registers for the other.

Of loops with some twenty vectors at work it otherwise spills them, on every turn, around calls that few chains need.
"""

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def rarely(condition):
    """Whether a number is not zero, which it rarely is; to be called in the `if` itself."""
    return bool(condition)


# LLVM looks for it where the branch is: not in a function of its own, so that an `overload` would lose it.
@intrinsic
def _rarely(typing, condition):
    def generate(context, builder, sig, args):
        bit = ir.IntType(1)
        expect = builder.module.declare_intrinsic("llvm.expect", [bit], ir.FunctionType(bit, [bit, bit]))
        return builder.call(expect, [context.cast(builder, args[0], sig.args[0], types.boolean), bit(0)])

    return types.boolean(condition), generate


if not numba.config.DISABLE_JIT:
    rarely = _rarely
