"""Nested tuples of numbers stored in a row of an array: the data that recursions store for a body or a fork.

The code is generated from the types, so tuples of vectors and matrices are written and read as if coded by hand. The
numbers are floats, complex, or eight side by side (`lanes`), as for `at` and `put_at`.
"""

from collections.abc import Iterator
from typing import Any

from numba import types
from numba.extending import overload

from flexlink.kernels.tools.compiler import INLINED
from flexlink.kernels.tools.lanes import at, put_at


def keep(rows, k, values, first=0):
    """Write `values` to row k, starting at column `first`."""
    for column, value in enumerate(_numbers(values)):
        put_at(rows, value, k, first + column)


def kept(rows, k, like, first=0):
    """Read what `keep` has written, in the structure of `like`, whose values are not used."""
    return _filled(like, (at(rows, k, first + column) for column, _ in enumerate(_numbers(like))))


def added(rows, k, values, first=0):
    """`values` plus the stored values."""
    return _filled(values, (value + at(rows, k, first + column) for column, value in enumerate(_numbers(values))))


def _numbers(values: Any) -> Iterator[Any]:
    if isinstance(values, tuple):
        for value in values:
            yield from _numbers(value)
    else:
        yield values


def _filled(like: Any, numbers: Iterator[Any]) -> Any:
    return tuple(_filled(value, numbers) for value in like) if isinstance(like, tuple) else next(numbers)


def _names(kind: types.Type, name: str) -> Any:
    """Nested tuple of variable names for the numbers of a tuple of this type, in the generated code."""
    if isinstance(kind, types.BaseTuple):
        return tuple(_names(part, f"{name}[{i}]") for i, part in enumerate(kind))
    return name


def _made(line: str, arguments: str) -> Any:
    names = {"at": at, "put_at": put_at}
    exec(f"def made({arguments}):\n    {line}", names)
    return names["made"]


@overload(keep, jit_options=INLINED)
def _keep(rows, k, values, first=0):
    names = enumerate(_numbers(_names(values, "values")))
    line = "; ".join(f"put_at(rows, {name}, k, first + {column})" for column, name in names)
    return _made(line, "rows, k, values, first=0")


@overload(kept, jit_options=INLINED)
def _kept(rows, k, like, first=0):
    names = _names(like, "like")
    reads = (f"at(rows, k, first + {column})" for column, _ in enumerate(_numbers(names)))
    return _made(f"return {_code(_filled(names, reads))}", "rows, k, like, first=0")


@overload(added, jit_options=INLINED)
def _added(rows, k, values, first=0):
    names = _names(values, "values")
    sums = (f"{name} + at(rows, k, first + {column})" for column, name in enumerate(_numbers(names)))
    return _made(f"return {_code(_filled(names, sums))}", "rows, k, values, first=0")


def _code(nested: Any) -> str:
    return f"({', '.join(map(_code, nested))},)" if isinstance(nested, tuple) else nested
