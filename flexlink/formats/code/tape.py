"""A tape of arithmetic: what a computation does to symbols, as a list of operations without loops and decisions.

Numbers of the tape combine with each other and with floats; zeros and ones are removed, equal operations shared. The
derivatives of all operations are written to the same tape, forward in the direction of one input.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple


class Operation(NamedTuple):
    """One line of the tape: the name of an operation and its operands, line numbers or constants."""

    name: str  # "input", "held", or a name of `SLOPES`
    operands: tuple[int | float, ...]


def _written(name: str) -> Callable[..., Number]:
    """A method of a number that writes this operation."""
    return lambda *values: values[0].tape.write(name, *values)


@dataclasses.dataclass(eq=False)
class Number:
    """The result of a line."""

    tape: Tape
    line: int

    def __add__(self, other: Real) -> Real:
        return self if _is(other, 0.0) else self.tape.write("+", self, other)

    def __sub__(self, other: Real) -> Real:
        return self if _is(other, 0.0) else self.tape.write("-", self, other)

    def __mul__(self, other: Real) -> Real:
        if _is(other, 0.0):
            return 0.0
        if _is(other, 1.0):
            return self
        return -self if _is(other, -1.0) else self.tape.write("*", self, other)

    def __truediv__(self, other: Real) -> Real:
        return self if _is(other, 1.0) else self.tape.write("/", self, other)

    def __bool__(self, *_: object) -> bool:
        raise TypeError("a kernel decides by a number of a tape")

    __eq__ = __hash__ = __bool__
    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: float) -> Real:
        return -self if other == 0.0 else self.tape.write("-", other, self)

    def __rtruediv__(self, other: float) -> Real:
        return 0.0 if other == 0.0 else self.tape.write("/", other, self)

    def sqrt(self) -> Number:
        """√x, whose derivative is finite at 0; NumPy's functions of objects call methods with their names."""
        return self.tape.write("sqrt", self + 1e-300)

    cos, sin, tanh, arctan2, __abs__, __neg__ = map(_written, ("cos", "sin", "tanh", "atan2", "fabs", "neg"))


def _is(value: Real, number: float) -> bool:
    return not isinstance(value, Number) and value == number


class Tape:
    """Operations in the order in which they are computed."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._known: dict[tuple[Operation, tuple[type, ...]], int] = {}

    def input(self) -> Number:
        """A new input."""
        self.operations.append(Operation("input", ()))
        return Number(self, len(self.operations) - 1)

    def write(self, name: str, *values: Real) -> Number:
        """The result of an operation, shared with an equal earlier one."""
        operands = tuple(value.line if isinstance(value, Number) else float(value) for value in values)
        operation = Operation(name, operands)
        if name in "+*" and repr(operands[0]) > repr(operands[1]):
            operation = Operation(name, (operands[1], operands[0]))
        key = operation, tuple(map(type, operation.operands))  # line 2 is not the constant 2.0
        if key not in self._known:
            self._known[key] = len(self.operations)
            self.operations.append(operation)
        return Number(self, self._known[key])

    def hold(self, value: Real) -> Number:
        """The same value, constant in derivatives by anything but itself."""
        self.operations.append(Operation("held", (value.line if isinstance(value, Number) else float(value),)))
        return Number(self, len(self.operations) - 1)

    def slopes(self, values: Sequence[Real], by: Iterable[Number]) -> list[list[Real]]:
        """Derivatives of values, a list for each input or held value."""
        lines = self.needed(values, through_held=False)
        return [self._slopes(values, lines, each.line) for each in by]

    def _slopes(self, values: Sequence[Real], lines: Sequence[int], by: int) -> list[Real]:
        """Derivatives of values, which need these lines; lines that do not depend on `by` are left out."""
        slopes: dict[int, Real] = {by: 1.0}
        for line in lines:
            name, operands = self.operations[line]
            if line != by and name != "held" and any(a in slopes for a in operands if isinstance(a, int)):
                x = [Number(self, a) if isinstance(a, int) else a for a in operands]
                d = [slopes.get(a, 0.0) if isinstance(a, int) else 0.0 for a in operands]
                slopes[line] = SLOPES[name](x, d, Number(self, line))
        return [slopes.get(value.line, 0.0) if isinstance(value, Number) else 0.0 for value in values]

    def needed(self, values: Sequence[Real], *, through_held: bool = True) -> list[int]:
        """Lines on which values depend, in order."""
        wanted = {value.line for value in values if isinstance(value, Number)}
        for line in range(max(wanted, default=-1), -1, -1):
            name, operands = self.operations[line]
            if line in wanted and (through_held or name != "held"):
                wanted |= {a for a in operands if isinstance(a, int)}
        return sorted(wanted)


Real = Number | float


def chosen(x: Real, positive: Real, negative: Real) -> Real:
    """`positive` if x ≥ 0, else `negative`."""
    return x.tape.write("choose", x, positive, negative) if isinstance(x, Number) else positive if x >= 0 else negative


SLOPES: dict[str, Callable[[Sequence[Any], Sequence[Any], Any], Any]] = {
    "+": lambda x, d, y: d[0] + d[1],
    "-": lambda x, d, y: d[0] - d[1],
    "*": lambda x, d, y: d[0] * x[1] + x[0] * d[1],
    "/": lambda x, d, y: (d[0] - y * d[1]) / x[1],
    "neg": lambda x, d, y: 0.0 - d[0],
    "sin": lambda x, d, y: x[0].tape.write("cos", x[0]) * d[0],
    "cos": lambda x, d, y: 0.0 - x[0].tape.write("sin", x[0]) * d[0],
    "tanh": lambda x, d, y: (1.0 - y * y) * d[0],
    "fabs": lambda x, d, y: chosen(x[0], 1.0, -1.0) * d[0],
    "sqrt": lambda x, d, y: d[0] / (2.0 * y),
    "atan2": lambda x, d, y: (x[1] * d[0] - x[0] * d[1]) / (x[0] * x[0] + x[1] * x[1]),
    "choose": lambda x, d, y: chosen(x[0], d[1], d[2]),
}
"""Derivative of each operation y of x, from those of its operands, d."""
