"""Conditions that are rarely true: LLVM moves the code they guard out of the loop, and keeps registers for the rest.

A loop with about twenty live vectors would otherwise spill them in every iteration, around calls that few chains need.
"""

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def rarely(condition):
    """Whether a number is not zero, which is rare; must be called in the `if` itself."""
    return bool(condition)


# LLVM expects the hint at the branch; in a separate function, which an `overload` would make, the hint would be lost.
@intrinsic
def _rarely(typing, condition):
    def generate(context, builder, sig, args):
        bit = ir.IntType(1)
        expect = builder.module.declare_intrinsic("llvm.expect", [bit], ir.FunctionType(bit, [bit, bit]))
        return builder.call(expect, [context.cast(builder, args[0], sig.args[0], types.boolean), bit(0)])

    return types.boolean(condition), generate


if not numba.config.DISABLE_JIT:
    rarely = _rarely
