"""The kernels of the library in another arithmetic: one algorithm, for floats and for the numbers of a tape.

`on_tape` copies a kernel as a Python function, together with all kernels that it calls. Only what depends on the type
of numbers is replaced: `numpy` and `math` by functions for all types, whose arrays contain objects, and the few kernels
that decide by a number.
"""

from __future__ import annotations

import math
from types import CellType, FunctionType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.formats.code.tape import Number, chosen
from flexlink.kernels.forces import rotation_springs
from flexlink.kernels.forces.rotation_springs import ROW
from flexlink.kernels.tools import lanes, rare, sincos, solve

Objects = NDArray[np.object_]  # of numbers of a tape and floats


def cos_sin_all(x: Objects, cosines: Objects, sines: Objects) -> bool:
    """`cos_sin_all`; angles on a tape are never too large."""
    for k in range(len(x)):
        cosines[k], sines[k] = np.cos(x[k]), np.sin(x[k])
    return False


def solve_symmetric(M: Objects, b: Objects, _: Any = None) -> Objects:
    """`solve_cholesky` by M = L D Lᵀ, for b (n,) or (n, columns), without its test whether M is singular; returns b."""
    for j in range(len(b)):
        for l in range(j):
            b[j] = b[j] - b[l] * M[j, l]
            M[j:, j] = M[j:, j] - M[j:, l] * (M[j, l] * M[l, l])
        M[j + 1 :, j] = M[j + 1 :, j] / M[j, j]
    for j in range(len(b) - 1, -1, -1):
        b[j] = b[j] / M[j, j]
        for i in range(j + 1, len(b)):
            b[j] = b[j] - b[i] * M[i, j]
    return b


class Least:
    """A limit that every number reaches."""

    def __le__(self, other: object) -> bool:
        return True


def find_far(numbers: Objects) -> None:
    """`find_far` of springs of rotation vectors, for every quaternion; it keeps the series where they are exact."""
    for k, (w, square) in enumerate(numbers[[ROW.w, ROW.square]].T):
        if isinstance(square, Number):
            sine = square.sqrt()
            half = sine.arctan2(w)
            for row, far in (ROW.factor, 2.0 * half / sine), (ROW.g, (1.0 - half * w / sine) / (4.0 * half * half)):
                numbers[row, k] = chosen(square - rotation_springs.NEAR, far, chosen(w, numbers[row, k], far))


objects = SimpleNamespace(**vars(np) | {
    "zeros": lambda shape, kind=object: np.zeros(shape, kind),
    "empty": lambda shape, kind=object: np.empty(shape, kind),
})  # fmt: skip
COPIES: dict[int, Any] = {id(original): copy for original, copy in (
    (np, objects), (math, objects), (rare.rarely, bool), (lanes.at, lambda array, *index: array[index]),
    (sincos.cos_sin_all, cos_sin_all), (solve.solve_cholesky, solve_symmetric),
    (rotation_springs.NEAR, Least()), (rotation_springs.find_far, find_far),
)}  # fmt: skip
"""Replacements, and copies of kernels, by the id of the original."""


def on_tape(value: Any) -> Any:
    """A kernel, or a table of kernels by name or type, for numbers of a tape; the replacement of any other object."""
    plain = getattr(value, "py_func", value)
    if id(value) in COPIES:
        return COPIES[id(value)]
    if isinstance(value, dict):
        table = COPIES[id(value)] = dict[Any, Any]()  # known before its kernels are copied, which refer to it
        table.update({key: on_tape(each) for key, each in value.items()})
        return table
    if not isinstance(plain, FunctionType) or not plain.__module__.startswith("flexlink.kernels"):
        return value
    names, cells = on_tape(plain.__globals__), plain.__closure__
    held = None if cells is None else tuple(CellType(on_tape(cell.cell_contents)) for cell in cells)
    copy = FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, held)
    return COPIES.setdefault(id(value), copy)
