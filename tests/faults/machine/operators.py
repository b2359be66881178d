"""Mutation operators for expressions and statements."""

import ast
import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

Text = Callable[[ast.AST], str]


class Change(NamedTuple):
    """One mutation: new source for `node`."""

    kind: str
    node: ast.AST
    becomes: str


OTHER = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*",
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
NAMES = (
    ("max", "min"), ("maximum", "minimum"), ("argmax", "argmin"), ("nanmax", "nanmin"), ("fmax", "fmin"),
    ("any", "all"), ("sin", "cos"), ("floor", "ceil"), ("zeros", "ones"), ("radians", "degrees"), ("sum", "mean"),
)  # fmt: skip
SWAPPED = {a: b for pair in NAMES for a, b in (pair, pair[::-1])}
DROPPED = frozenset({"abs", "sorted", "reversed", "sqrt", "cumsum", "transpose", "conj", "diff"})
"""Functions of one array that may be replaced by their argument."""
SYMMETRIC = frozenset({
    "isinstance", "issubclass", "getattr", "hasattr", "zip", "range", "max", "min", "maximum", "minimum", "hypot",
    "multiply", "largest_distance", "allclose", "array_equal",
})  # fmt: skip
"""Functions whose argument order does not matter or cannot be wrong."""
EMPTY = {"bool": "not ({})", "float": "0.0 * ({})", "int": "0 * ({})", "Array": "0.0 * ({})", "str": '""'}
CONTAINERS = {"list": "[]", "tuple": "()", "dict": "{}", "set": "set()"}


def changes(node: ast.AST, text: Text, returns: ast.expr | None) -> Iterator[Change]:
    """Mutations of this node; `returns` is the return annotation of the enclosing function."""
    for kind, make in KINDS.items():
        for changed, becomes in make(node, text, returns):
            yield Change(kind, changed, becomes)


Made = Iterator[tuple[ast.AST, str]]


def _sign(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.BinOp(left, ast.Add() | ast.Sub() as op, right) if not _is_text(left) and not _is_text(right):
            yield node, f"{_grouped(left, text)} {OTHER[type(op)]} {_grouped(right, text)}"
        case ast.UnaryOp(ast.USub(), operand) if not isinstance(operand, ast.Constant):
            yield node, f"({text(operand)})"
        case ast.AugAssign(target, ast.Add() | ast.Sub() as op, value) if not _is_text(value):
            yield node, f"{text(target)} {OTHER[type(op)]}= {text(value)}"


def _factor(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.BinOp(left, ast.Mult() | ast.Div() as op, right) if not _is_text(left) and not _is_text(right):
            yield node, f"2 * ({text(node)})"
            yield node, f"{_grouped(left, text)} {OTHER[type(op)]} {_grouped(right, text)}"
        case ast.BinOp(base, ast.Pow(), ast.Constant()):
            yield node, f"({text(base)})"


def _count(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    if isinstance(node, ast.Constant) and type(node.value) is int:
        yield node, str(node.value + 1)


def _constant(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    if isinstance(node, ast.Constant) and type(node.value) is float and node.value:
        yield node, repr(node.value * 10)


def _comparison(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.Compare(left, [op], [right]) if type(op) in OTHER:
            yield node, f"{text(left)} {OTHER[type(op)]} {text(right)}"


def _condition(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.If(test) | ast.IfExp(test):
            yield test, "True"
            yield test, "False"
        case ast.comprehension():
            yield from ((test, "True") for test in node.ifs)
        case ast.BoolOp(_, values):
            for value in values:
                yield node, _joined(node, [text(each) for each in values if each is not value])
        case ast.UnaryOp(ast.Not(), operand):
            yield node, f"({text(operand)})"


def _arguments(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.Call(ast.Name(name) | ast.Attribute(_, name)) if name in SYMMETRIC:
            return
        case ast.Call(func, args) if not any(isinstance(arg, ast.Starred) for arg in args):
            for first, second in itertools.pairwise(args):
                swapped = [second if arg is first else first if arg is second else arg for arg in args]
                if text(first) != text(second):
                    every = [text(arg) for arg in (*swapped, *node.keywords)]
                    yield node, f"{text(func)}({', '.join(every)})"
        case ast.BinOp(left, ast.MatMult(), right):
            yield node, f"{_grouped(right, text)} @ {_grouped(left, text)}"


def _key(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    """Return whether the node is a cache key: a tuple named key, or the second argument of an upper-case function."""
    match node:
        case ast.Assign([ast.Name(name)], ast.Tuple() as key) if "key" in name.lower():
            pass
        case ast.Call(ast.Name(name), [_, ast.Tuple() as key, *_]) if name.isupper():
            pass
        case _:
            return
    for dropped in key.elts if len(key.elts) > 1 else ():
        left = [text(each) for each in key.elts if each is not dropped]
        yield key, f"({', '.join(left)},)"


def _axis(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.keyword("axis", ast.Constant(int(axis))):
            yield node.value, {0: "1", 1: "0", -1: "0"}.get(axis, "0")
        case ast.Attribute(value, "T"):
            yield node, text(value)
        case ast.Attribute(value, name) if isinstance(node.ctx, ast.Load) and name.endswith(("_x", "_y", "_z")):
            yield node, f"{text(value)}.{name[:-1]}{dict(zip('xyz', 'yzx', strict=True))[name[-1]]}"
        case ast.Subscript(value, ast.UnaryOp(ast.USub(), ast.Constant(1))):
            yield node, f"{text(value)}[0]"


def _name(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.Call(ast.Name(name)) if name in SWAPPED and name not in {"sum", "zeros", "ones"}:
            yield node.func, SWAPPED[name]
        case ast.Call(ast.Attribute(value, name)) if name in SWAPPED:
            yield node.func, f"{text(value)}.{SWAPPED[name]}"
        case ast.Call(ast.Name(name) | ast.Attribute(_, name), [only]) if name in DROPPED and not _is_array_of(node):
            yield node, f"({text(only)})"


def _is_array_of(node: ast.Call) -> bool:
    return bool(node.keywords) or (isinstance(node.func, ast.Attribute) and not isinstance(node.func.value, ast.Name))


def _returned(node: ast.AST, text: Text, returns: ast.expr | None) -> Made:
    if not isinstance(node, ast.Return) or node.value is None or isinstance(node.value, ast.Constant):
        return
    match returns:
        case ast.Name(name) if name in EMPTY:
            yield node.value, EMPTY[name].format(text(node.value))
        case ast.Subscript(ast.Name(name)) if name in CONTAINERS and name != "tuple":
            yield node.value, CONTAINERS[name]
        case ast.BinOp(_, ast.BitOr(), ast.Constant(None)):
            yield node.value, "None"


def _statement(node: ast.AST, text: Text, _: ast.expr | None) -> Made:
    match node:
        case ast.Expr(ast.Call()) | ast.Continue() | ast.Break():
            yield node, "pass"


KINDS = {
    "sign": _sign, "factor": _factor, "count": _count, "constant": _constant, "comparison": _comparison,
    "condition": _condition, "arguments": _arguments, "key": _key, "axis": _axis, "name": _name,
    "returned": _returned, "statement": _statement,
}  # fmt: skip


def _is_text(node: ast.expr) -> bool:
    """Return whether the operand is a text or a list, for which + means concatenation."""
    match node:
        case ast.Constant(str() | bytes()) | ast.JoinedStr() | ast.List() | ast.ListComp() | ast.Tuple():
            return True
        case ast.BinOp(left, _, right):
            return _is_text(left) or _is_text(right)
    return False


def _grouped(node: ast.expr, text: Text) -> str:
    simple = ast.Name, ast.Attribute, ast.Constant, ast.Call, ast.Subscript
    return text(node) if isinstance(node, simple) else f"({text(node)})"


def _joined(node: ast.BoolOp, values: list[str]) -> str:
    word = " and " if isinstance(node.op, ast.And) else " or "
    return word.join(values) if len(values) == 1 else f"({word.join(values)})"
