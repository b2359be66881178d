"""Imports among the project's own modules, found in their text: at the top, inside functions, lazy, and by name.

Nothing is imported to find them, so that a result's dependencies are known before, and without, measuring it.
"""

from __future__ import annotations

import ast
import fnmatch
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple


class Found(NamedTuple):
    """What a module names: modules, or names in them; and patterns of modules, for names completed when it runs."""

    names: frozenset[str]
    patterns: frozenset[str]


class Project:
    """Modules of a project.

    Parameters
    ----------
    files
        Module name → its file.
    """

    def __init__(self, files: Mapping[str, Path]) -> None:
        self.files = dict(files)
        self._direct: dict[str, frozenset[str]] = {}

    def closure(self, *names: str) -> frozenset[str]:
        """These modules and all that they import, directly or through others, with the packages that contain them."""
        seen, waiting = set[str](), [name for name in names if name in self.files]
        while waiting:
            name = waiting.pop()
            if name not in seen:
                seen.add(name)
                waiting += self.imports(name)
        return frozenset(seen)

    def imports(self, name: str) -> frozenset[str]:
        """Modules that a module imports, and their packages."""
        if name not in self._direct:
            found = _found(self.files[name].read_text(encoding="utf-8"), self.files)
            by_pattern = {m for pattern in found.patterns for m in self._matching(pattern)}
            self._direct[name] = frozenset(m for each in (name, *found.names, *by_pattern) for m in self._modules(each))
        return self._direct[name]

    def _modules(self, dotted: str) -> Iterator[str]:
        """The module that defines a dotted name, and the packages that contain it."""
        package, _, last = dotted.partition(".")
        if dotted not in self.files and last in self._lazy.get(package, {}):
            dotted = self._lazy[package][last]
        while dotted:
            if dotted in self.files:
                yield dotted
            dotted = dotted.rpartition(".")[0]

    def _matching(self, pattern: str) -> Iterator[str]:
        """Modules that match a pattern; * is part of one word between dots. Whole top packages are never meant."""
        depth = pattern.count(".")
        if depth > 1:
            yield from (m for m in self.files if m.count(".") == depth and fnmatch.fnmatchcase(m, pattern))

    @cached_property
    def _lazy(self) -> dict[str, dict[str, str]]:
        """Top package → public name → module from which the package loads it when it is first used."""
        stubs = {name: self.files[name].with_suffix(".pyi") for name in self.files if "." not in name}
        return {name: _for_type_checkers(stub) for name, stub in stubs.items() if stub.exists()}


def _for_type_checkers(stub: Path) -> dict[str, str]:
    """Names that a package loads lazily, with their modules, as its stub shows."""
    body = ast.parse(stub.read_text(encoding="utf-8")).body
    imports = [node for node in body if isinstance(node, ast.ImportFrom) and node.module]
    return {alias.asname or alias.name: f"{node.module}.{alias.name}" for node in imports for alias in node.names}


def _is_for_type_checkers(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _found(text: str, modules: Mapping[str, Path]) -> Found:
    visitor = _Visitor(modules)
    visitor.visit(ast.parse(text))
    return Found(frozenset(visitor.names), frozenset(visitor.patterns))


class _Visitor(ast.NodeVisitor):
    """Collects names of modules from import statements, strings, scripts in strings, and commands."""

    def __init__(self, modules: Mapping[str, Path]) -> None:
        self.modules = modules
        self.names = set[str]()
        self.patterns = set[str]()
        self.aliases: dict[str, str] = {}  # local name → module, or name in a module

    def visit_If(self, node: ast.If) -> None:
        """Skip imports for type checkers, which have no effect on results."""
        for each in node.orelse if _is_for_type_checkers(node) else ast.iter_child_nodes(node):
            self.visit(each)

    def visit_Expr(self, node: ast.Expr) -> None:
        """Skip docstrings."""
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        """`import a.b`, `import a as b`."""
        for alias in node.names:
            self.names.add(alias.name)
            top = alias.name.partition(".")[0]
            self.aliases[alias.asname or top] = alias.name if alias.asname else top

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """`from a import b`, where b is a module or a name."""
        for alias in node.names:
            self.names.add(f"{node.module}.{alias.name}")
            self.aliases[alias.asname or alias.name] = f"{node.module}.{alias.name}"

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """`a.b`, where a was imported: b may be a name that a loads lazily."""
        if isinstance(node.value, ast.Name) and node.value.id in self.aliases:
            self.names.add(f"{self.aliases[node.value.id]}.{node.attr}")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """A module's name in a table of modules to import, or a script that another process runs."""
        if isinstance(node.value, str) and node.value in self.modules and "." in node.value:
            self.names.add(node.value)
        elif isinstance(node.value, str) and "import " in node.value:
            try:
                self.visit(ast.parse(node.value))
            except SyntaxError:  # it is prose
                return

    def visit_List(self, node: ast.List) -> None:
        """`[…, "-m", "a", …]`, the command that runs a module."""
        words = [each.value if isinstance(each, ast.Constant) else None for each in node.elts]
        for option, name in pairwise(words):
            if option == "-m" and isinstance(name, str):
                self.names |= {name, f"{name}.__main__"}
        self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """`f"a.b.{name}"`, the name of a module to import."""
        parts = [each.value if isinstance(each, ast.Constant) else "*" for each in node.values]
        pattern = "".join(map(str, parts))
        if pattern.partition(".")[0] in self.modules:
            self.patterns.add(pattern)
        self.generic_visit(node)
