"""Eight numbers side by side as one number of a kernel, so the same code works for one chain or eight at once.

`Lanes` is LLVM's vector of eight doubles: one register with AVX-512, two with AVX2, four with SSE2. It has + − × ÷ and
negation; tuples of three are 3-vectors, as for floats. A kernel accesses arrays by `at` and `put_at`: for shape (m,) or
(m, p) they read and write a float, for shape (m, 8) or (m, p, 8) eight numbers.

With NUMBA_DISABLE_JIT=1 the functions run as Python code, and eight numbers are an array, `Eight`.
"""

import math
import operator
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from flexlink.kernels.tools.compiler import INLINED, inlined, kernel, recursion, subroutine

LANES = 8
CACHE_LINE = 64  # bytes; also the size of eight lanes
VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class Eight(np.ndarray):
    """Eight numbers for uncompiled code; as for a float, `x += y` does not change other names of the same object."""

    def __iadd__(self, other):  # type: ignore[misc]
        return self + other

    def __isub__(self, other):  # type: ignore[misc]
        return self - other

    def __imul__(self, other):  # type: ignore[misc]
        return self * other


class LanesType(types.Type):
    """Type of eight float64 side by side."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


lanes = LanesType()


@register_model(LanesType)
class LanesModel(models.PrimitiveModel):
    """Machine representation of `LanesType`: one vector register, or several."""

    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


def _splat(builder, value):
    """Machine code that converts a double to eight equal lanes; lanes are returned unchanged."""
    if value.type == VECTOR:
        return value
    undefined = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, everywhere)


def _binary(symbol, instruction):
    @intrinsic
    def combined(typing, x, y):
        def generate(context, builder, sig, args):
            x, y = (_splat(builder, each) for each in args)
            return getattr(builder, instruction)(x, y, flags=("contract",))

        return lanes(*(each if each == lanes else types.float64 for each in (x, y))), generate

    @overload(symbol, jit_options=INLINED)
    def implement(x, y):
        if lanes in {x, y} and all(each == lanes or isinstance(each, types.Number) for each in (x, y)):
            return lambda x, y: combined(x, y)  # noqa: PLW0108
        return None


for _symbol, _instruction in (
    (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"), (operator.truediv, "fdiv"),
    (operator.iadd, "fadd"), (operator.isub, "fsub"), (operator.imul, "fmul"),
):  # fmt: skip
    _binary(_symbol, _instruction)


@intrinsic
def _negative(typing, x):
    return lanes(x), lambda context, builder, sig, args: builder.fneg(args[0])


@overload(operator.neg, jit_options=INLINED)
def _neg(x):
    return (lambda x: _negative(x)) if x == lanes else None  # noqa: PLW0108


def _place(context, builder, array_type, array, first):
    data = cgutils.create_struct_proxy(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [first]), VECTOR.as_pointer())


@intrinsic
def _load(typing, array, index):
    def generate(context, builder, sig, args):
        load = builder.load(_place(context, builder, sig.args[0], *args))
        load.align = 8
        return load

    return lanes(array, types.intp), generate


@intrinsic
def _store(typing, array, index, value):
    def generate(context, builder, sig, args):
        store = builder.store(args[2], _place(context, builder, sig.args[0], args[0], args[1]))
        store.align = 8
        return context.get_dummy_value()

    return types.none(array, types.intp, lanes), generate


@kernel
def empty_lanes(shape):
    """Uninitialized array of this shape with a last axis of eight, aligned to cache lines.

    Numba aligns arrays to a cache line or to half of one. In the latter case every access touches two lines, and
    recursions take 1.15 times as long.
    """
    count = LANES
    for extent in shape:
        count *= extent
    doubles = np.empty(count + CACHE_LINE // 8)
    skipped = -doubles.ctypes.data % CACHE_LINE // 8
    return doubles[skipped : skipped + count].reshape((*shape, LANES))


def at(array, *index):
    """Element of an array of shape (m,) or (m, p); with a last axis of eight, the eight numbers as lanes."""
    found = array[index]
    return found.copy().view(Eight) if found.ndim else found


def put_at(array, value, *index):
    """Write an element that `at` reads."""
    array[index] = value


def eight_of(array, first):
    """Eight numbers from index `first` of a contiguous array (m,), as lanes."""
    return array[first : first + LANES].copy().view(Eight)


def put_eight(array, value, first):
    """Write eight numbers that `eight_of` reads."""
    array[first : first + LANES] = value


def zero_of(array, *index):
    """Zero of the type that `at` returns for an array; by default for one index."""
    return np.zeros(LANES).view(Eight) if array.ndim > max(1, len(index)) else 0.0


@overload(at, jit_options=INLINED)
def _at(array, *index):
    if array.ndim == len(index):
        return lambda array, *index: array[index]
    if len(index) == 1:
        return lambda array, *index: _load(array, index[0] * LANES)
    return lambda array, *index: _load(array, (index[0] * array.shape[1] + index[1]) * LANES)


@overload(put_at, jit_options=INLINED)
def _put_at(array, value, *index):
    if array.ndim == len(index):

        def put(array, value, *index):
            array[index] = value

        return put
    if len(index) == 1:
        return lambda array, value, *index: _store(array, index[0] * LANES, value)
    return lambda array, value, *index: _store(array, (index[0] * array.shape[1] + index[1]) * LANES, value)


@overload(eight_of, jit_options=INLINED)
def _eight_of(array, first):
    return (lambda array, first: _load(array, first)) if array.layout == "C" else None  # noqa: PLW0108


@overload(put_eight, jit_options=INLINED)
def _put_eight(array, value, first):
    return (lambda array, value, first: _store(array, first, value)) if array.layout == "C" else None


@intrinsic
def _zero(typing, array):
    return lanes(array), lambda context, builder, sig, args: ir.Constant(VECTOR, [0.0] * LANES)


@overload(zero_of, jit_options=INLINED)
def _zero_of(array, *index):
    if array.ndim > max(1, len(index)):
        return lambda array, *index: _zero(array)
    return lambda array, *index: 0.0


def all_zero(x):
    """Whether a float, or each of the lanes, is zero; nan is not."""
    return bool(np.all(x == 0.0))


@intrinsic
def _all_zero_lanes(typing, x):
    def generate(context, builder, sig, args):
        result = ir.Constant(ir.IntType(1), 1)
        for lane in range(LANES):
            one = builder.extract_element(args[0], ir.Constant(ir.IntType(32), lane))
            zero = builder.fcmp_ordered("==", one, ir.Constant(ir.DoubleType(), 0.0))
            result = builder.and_(result, zero)
        return result

    return types.boolean(lanes), generate


@overload(all_zero, jit_options=INLINED)
def _all_zero(x):
    return (lambda x: _all_zero_lanes(x)) if x == lanes else (lambda x: x == 0.0)  # noqa: PLW0108


def tanh(x):
    """Hyperbolic tangent of a float or of lanes."""
    return np.array([math.tanh(one) for one in x]).view(Eight) if np.ndim(x) else math.tanh(x)


@intrinsic
def _lane(typing, x, number):
    return types.float64(x, types.intp), lambda context, builder, sig, args: builder.extract_element(*args)


@intrinsic
def _with_lane(typing, x, value, number):
    return lanes(x, types.float64, types.intp), lambda context, builder, sig, args: builder.insert_element(*args)


@overload(tanh, jit_options=INLINED)
def _tanh(x):
    def each(x):
        for lane in range(LANES):
            x = _with_lane(x, math.tanh(_lane(x, lane)), lane)
        return x

    return each if x == lanes else (lambda x: math.tanh(x))  # noqa: PLW0108


def clipped(x, least, most):
    """Clip a float, or lanes, to the floats `least` … `most`; nan stays nan."""
    within = np.where(x > most, most, np.where(x < least, least, x))
    return within.view(Eight) if np.ndim(x) else float(within)


@inlined
def clip(x, least, most):
    """`clipped` for a float."""
    return most if x > most else (least if x < least else x)


@overload(clipped, jit_options=INLINED)
def _clipped(x, least, most):
    def each(x, least, most):
        for lane in range(LANES):
            x = _with_lane(x, clip(_lane(x, lane), least, most), lane)
        return x

    return each if x == lanes else (lambda x, least, most: clip(x, least, most))  # noqa: PLW0108


class Turns(NamedTuple):
    """Angles side by side with their cosines and sines, which one loop computes for all of them."""

    cosines: Any  # (n, 8)
    sines: Any
    angles: Any


def cos_sin_of(q, k):
    """Cosine and sine of angle `k` of an array (n,), or of `Turns`."""
    return (at(q.cosines, k), at(q.sines, k)) if isinstance(q, Turns) else (math.cos(q[k]), math.sin(q[k]))


@overload(cos_sin_of, jit_options=INLINED)
def _cos_sin_of(q, k):
    if isinstance(q, types.NamedUniTuple):
        return lambda q, k: (at(q.cosines, k), at(q.sines, k))
    return lambda q, k: (math.cos(q[k]), math.sin(q[k]))


def position_of(q, k):
    """Coordinate `k`, an angle or a displacement, of an array (n,), or of `Turns`."""
    return at(q.angles, k) if isinstance(q, Turns) else q[k]


@overload(position_of, jit_options=INLINED)
def _position_of(q, k):
    if isinstance(q, types.NamedUniTuple):
        return lambda q, k: at(q.angles, k)
    return lambda q, k: q[k]


@subroutine
def put_lanes(rows, start, side):
    """Write rows `start` … of an array (b, p) side by side, (p, 8); lanes past the last row repeat it."""
    for lane in range(LANES):
        i = min(start + lane, len(rows) - 1)
        for k in range(len(side)):
            side[k, lane] = rows[i, k]


@recursion
def put_lane(part, lane, side):
    """Write an array (m, p) to a lane of an array (m, p, 8)."""
    for i in range(part.shape[0]):
        for k in range(part.shape[1]):
            side[i, k, lane] = part[i, k]


@recursion
def keep_lanes(side, start, rows):
    """Write numbers side by side to the rows `start` … of an array (b, p)."""
    for lane in range(min(LANES, len(rows) - start)):
        for k in range(len(side)):
            rows[start + lane, k] = side[k, lane]


@inlined
def vec(array, first):
    """The 3-vector that starts at index `first` of an array (m,)."""
    return at(array, first), at(array, first + 1), at(array, first + 2)


@inlined
def vec_of(array, k, first):
    """The 3-vector that starts at column `first` of row `k` of an array (m, p)."""
    return at(array, k, first), at(array, k, first + 1), at(array, k, first + 2)


@inlined
def put_vec_of(array, a, k, first):
    """Write a vector that `vec_of` reads."""
    put_at(array, a[0], k, first)
    put_at(array, a[1], k, first + 1)
    put_at(array, a[2], k, first + 2)
