"""Apply a mutant to modules that are already imported: replace the code of functions and values of modules."""

import ast
import functools
import gc
import sys
from collections import Counter, defaultdict
from types import CodeType, FunctionType
from typing import Any

from flexlink.common.memo import Memo
from tests.faults.machine.generator import Mutant
from tests.faults.plant import ROOT


class CannotSwapError(Exception):
    """The mutant changes more than the code of functions and plain values of a module."""


def swap(mutant: Mutant) -> None:
    """Apply the mutant to this process.

    Raises
    ------
    CannotSwapError
        The mutant needs a separate process.
    """
    path = ROOT / mutant.file
    source = path.read_bytes()
    planted = mutant.planted(source)
    if mutant.where:
        _swap_code(str(path), source, planted)
    else:
        _swap_value(mutant, source, planted)
    forget()


def _swap_code(path: str, source: bytes, planted: bytes) -> None:
    old, new = (_codes(compile(text, path, "exec", dont_inherit=True)) for text in (source, planted))
    by_place: dict[tuple[str, int], list[CodeType | None]] = defaultdict(list)
    for name, code in old.items():
        by_place[code.co_qualname, code.co_firstlineno].append(new.get(name))
    swapped = 0
    for function in living(FunctionType):
        code = function.__code__
        found = by_place[code.co_qualname, code.co_firstlineno] if code.co_filename == path else []
        if len(found) == 1 and found[0] is not None and found[0] != code:
            if found[0].co_freevars != code.co_freevars:
                raise CannotSwapError
            function.__code__ = found[0]
            swapped += 1
    if not swapped:
        raise CannotSwapError


def _codes(code: CodeType) -> dict[tuple[str, int], CodeType]:
    """Code of every function, by its name and the number of earlier functions with that name."""
    found: dict[tuple[str, int], CodeType] = {}
    before: Counter[str] = Counter()

    def walk(outer: CodeType) -> None:
        for inner in outer.co_consts:
            if isinstance(inner, CodeType):
                found[inner.co_qualname, before[inner.co_qualname]] = inner
                before[inner.co_qualname] += 1
                walk(inner)

    walk(code)
    return found


def _swap_value(mutant: Mutant, source: bytes, planted: bytes) -> None:
    """Replace module values (numbers, texts, arrays) here and in all modules that imported them by name."""
    modules = [each for each in list(sys.modules.values()) if hasattr(each, "__dict__")]
    path = str(ROOT / mutant.file)
    module = next((each for each in modules if getattr(each, "__file__", None) == path), None)
    name = _assigned(ast.parse(source), mutant.line)
    if module is None or name is None:
        raise CannotSwapError
    fresh = {name: vars(module)[name] for name in ("__name__", "__file__", "__package__")}
    exec(compile(planted, mutant.file, "exec", dont_inherit=True), fresh)
    old = vars(module)[name]
    for other in modules:
        if vars(other).get(name) is old:
            setattr(other, name, fresh[name])


def _assigned(tree: ast.Module, line: int) -> str | None:
    """Return the only name assigned on this line; no other value of the module may depend on it."""
    for statement in tree.body:
        if statement.lineno <= line <= (statement.end_lineno or 0):
            match statement:
                case ast.Assign([ast.Name(name)]) | ast.AnnAssign(ast.Name(name)):
                    used = [node for each in tree.body if isinstance(each, (ast.Assign, ast.AnnAssign, ast.ClassDef))
                            for node in ast.walk(each) if isinstance(node, ast.Name) and node.id == name]  # fmt: skip
                    return name if len(used) == 1 else None
    return None


def forget() -> None:
    """Clear the caches that were filled after the modules were imported."""
    for memo in living(Memo):
        memo._results.clear()
    for each in living(functools._lru_cache_wrapper):
        each.cache_clear()


def living(kind: type) -> list[Any]:
    """All objects of a type. (`type` is compared, as `isinstance` fails for a weak proxy whose object is gone.)"""
    return [each for each in gc.get_objects() if type(each) is kind]
