"""A tape of arithmetic: what a computation does to symbols, as a list of operations without loops and branches.

Numbers of the tape combine with each other and with floats; zeros and ones are removed, equal operations shared. The
derivatives of all operations are written to the same tape, forward in the direction of one input.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple


class Operation(NamedTuple):
    """One line of the tape: the name of an operation and its operands, line numbers or constants."""

    name: str  # "input", "+", "-", "*", "/", "neg", "sin", "cos", "tanh"
    operands: tuple[int | float, ...]


@dataclasses.dataclass(eq=False)
class Number:
    """The result of a line."""

    tape: Tape
    line: int

    def __add__(self, other: Number | float) -> Number | float:
        return self if _is(other, 0.0) else self.tape.write("+", self, other)

    def __sub__(self, other: Number | float) -> Number | float:
        return self if _is(other, 0.0) else self.tape.write("-", self, other)

    def __mul__(self, other: Number | float) -> Number | float:
        if _is(other, 0.0):
            return 0.0
        if _is(other, 1.0):
            return self
        return -self if _is(other, -1.0) else self.tape.write("*", self, other)

    def __truediv__(self, other: Number | float) -> Number | float:
        return self if _is(other, 1.0) else self.tape.write("/", self, other)

    def __neg__(self) -> Number:
        return self.tape.write("neg", self)

    def __radd__(self, other: float) -> Number | float:
        return self + other

    def __rsub__(self, other: float) -> Number | float:
        return -self if other == 0.0 else self.tape.write("-", other, self)

    def __rmul__(self, other: float) -> Number | float:
        return self * other

    def __rtruediv__(self, other: float) -> Number | float:
        return 0.0 if other == 0.0 else self.tape.write("/", other, self)


def _is(value: Number | float, number: float) -> bool:
    return not isinstance(value, Number) and value == number


class Tape:
    """Operations in the order in which they are computed."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._known: dict[Operation, int] = {}

    def input(self) -> Number:
        """A new input."""
        self.operations.append(Operation("input", (float(len(self.operations)),)))
        return Number(self, len(self.operations) - 1)

    def write(self, name: str, *values: Number | float) -> Number:
        """The result of an operation, shared with an equal earlier one."""
        operands = tuple(value.line if isinstance(value, Number) else float(value) for value in values)
        operation = Operation(name, operands)
        if name in "+*" and repr(operands[0]) > repr(operands[1]):
            operation = Operation(name, (operands[1], operands[0]))
        if operation not in self._known:
            self._known[operation] = len(self.operations)
            self.operations.append(operation)
        return Number(self, self._known[operation])

    def slopes(
        self, values: Sequence[Number | float], by: Number, held: Sequence[Number | float] = ()
    ) -> list[Number | float]:
        """Derivatives of values with respect to an input, with the numbers `held` constant."""
        slopes: dict[int, Number | float] = {each.line: 0.0 for each in held if isinstance(each, Number)}
        slopes[by.line] = 1.0
        for line in self.needed(values):
            if line not in slopes:
                slopes[line] = self._slope(line, slopes)
        return [slopes[value.line] if isinstance(value, Number) else 0.0 for value in values]

    def _slope(self, line: int, slopes: dict[int, Number | float]) -> Number | float:
        """Derivative of a line, from those of its operands."""
        name, operands = self.operations[line]
        if name == "input":
            return 0.0
        x = [Number(self, a) if isinstance(a, int) else a for a in operands]
        d = [slopes[a] if isinstance(a, int) else 0.0 for a in operands]
        found: Number | float = SLOPES[name](x, d, Number(self, line))
        return found

    def needed(self, values: Sequence[Number | float]) -> list[int]:
        """Lines on which values depend, in order."""
        wanted = {value.line for value in values if isinstance(value, Number)}
        for line in range(max(wanted, default=-1), -1, -1):
            if line in wanted:
                wanted |= {a for a in self.operations[line].operands if isinstance(a, int)}
        return sorted(wanted)


SLOPES: dict[str, Callable[[Sequence[Any], Sequence[Any], Any], Any]] = {
    "+": lambda x, d, y: d[0] + d[1],
    "-": lambda x, d, y: d[0] - d[1],
    "*": lambda x, d, y: d[0] * x[1] + x[0] * d[1],
    "/": lambda x, d, y: (d[0] - y * d[1]) / x[1],
    "neg": lambda x, d, y: 0.0 - d[0],
    "sin": lambda x, d, y: x[0].tape.write("cos", x[0]) * d[0],
    "cos": lambda x, d, y: 0.0 - x[0].tape.write("sin", x[0]) * d[0],
    "tanh": lambda x, d, y: (1.0 - y * y) * d[0],
}
"""Derivative of each operation y of x, from those of its operands, d."""


def function(name: str, x: Number | float, plain: float) -> Number | float:
    """The function `name` of x; `plain` is its value if x is a float."""
    return x.tape.write(name, x) if isinstance(x, Number) else plain
