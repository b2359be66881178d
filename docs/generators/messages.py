"""Pages of messages: what each id means, what to do, and the texts of the source with this id."""

from __future__ import annotations

import ast
import functools
import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import flexlink
from docs.generators.rest import directive, heading, literal, prose, table

LIBRARY = Path(flexlink.__file__).parent
EXPLAINED = Path(__file__).parent / "messages.toml"

INTRO = """\
Every message has an id, which the command line prints in brackets at its end: ``… [unknown-key]``. In Python a refusal
raises a subclass of :class:`flexlink.FlexlinkError` with the attribute ``id``; the command line prints the message and
exits with 2. A ``warning:`` means that a result may be wrong; it is also stored in ``Trajectory.warnings``, or in
``Trajectory.hints`` if a value is probably in another unit. A ``note:`` means that a value has no effect, or is
probably not intended.
"""


class Explanation(NamedTuple):
    """What an id means, and what to do."""

    id: str
    means: str
    remedy: str


@functools.cache
def groups() -> dict[str, tuple[Explanation, ...]]:
    """Explanations by the title of their page."""
    found = tomllib.loads(EXPLAINED.read_text(encoding="utf-8"))["group"]
    return {group["title"]: tuple(Explanation(name, *texts) for name, texts in group["ids"].items()) for group in found}


def page_name(title: str) -> str:
    """File name of the page of a group, without its ending."""
    return f"messages_{title.partition(':')[0].partition(',')[0].lower().replace(' ', '_')}"


def page(_: Path) -> str:
    """All ids in one table, each with a link to its explanation."""
    rows = [
        (f":ref:`{prose(title)} <{page_name(title)}>`",
         ", ".join(f":ref:`{each.id} <message-{each.id}>`" for each in sorted(explained)))
        for title, explained in groups().items()
    ]  # fmt: skip
    pages = directive("toctree", body="\n".join(map(page_name, groups())), hidden="", maxdepth="1")
    return "\n".join([heading("Messages"), INTRO, table(("subject", "ids"), rows, "25 75"), pages])


def group_page(title: str, _: Path) -> str:
    """The ids of one group, with meaning, remedy and texts."""
    parts = [f".. _{page_name(title)}:\n", heading(f"Messages: {title[0].lower()}{title[1:]}")]
    for each in groups()[title]:
        shown = [f"- {prose(text)}" for text in sorted(texts().get(each.id, ()), key=str.casefold)]
        parts += [f".. _message-{each.id}:\n", heading(each.id, 1), f"{prose(each.means)} {prose(each.remedy)}\n"]
        if shown:
            parts.append(directive("dropdown", f"Texts with the id {literal(each.id)}", "\n".join(shown)))
    return "\n".join(parts)


@functools.cache
def texts() -> dict[str, set[str]]:
    """Texts of errors, warnings and notes in the source, by id, with … for every value."""
    found: dict[str, set[str]] = {}
    for path in sorted([*LIBRARY.rglob("*.py"), *(LIBRARY.parent / "flexlink_witnesses").glob("*.py")]):
        tree = _Said().visit(ast.parse(path.read_text(encoding="utf-8")))
        for name, text in _identified(ast.walk(tree)):
            if not name:
                continue
            found.setdefault(name, set())
            if len(text.replace("…", "").split()) > 1:
                found[name].add(text)
    for name in re.findall(
        r'\bid = "([a-z-]+)"', (LIBRARY / "diagnosis/data/mistakes.toml").read_text(encoding="utf-8")
    ):
        found.setdefault(name, set())
    return found


class _Said(ast.NodeTransformer):
    """Put texts in the places of the names to which they are assigned above, in the same function."""

    def __init__(self) -> None:
        self.said: dict[str, ast.expr] = {}

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Names of other functions mean something else."""
        outer, self.said = self.said, {}
        self.generic_visit(node)
        self.said = outer
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        """Note a text."""
        self.generic_visit(node)
        text = isinstance(node.value, ast.JoinedStr) or isinstance(getattr(node.value, "value", None), str)
        if isinstance(node.targets[0], ast.Name) and text:
            self.said[node.targets[0].id] = node.value
        return node

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.AST:
        """A text in a text."""
        return self.said.get(node.value.id, node) if isinstance(node.value, ast.Name) else node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """A text as an argument."""
        return self.said.get(node.id, node) if isinstance(node.ctx, ast.Load) else node


def _identified(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, str]]:
    """Ids and texts of calls with `id="…"`, of `Diagnostic(text, "id")`, and of classes of errors with an id.

    Also of `_refused(key, why, "id")`, and of `missing(key, why)`.
    """
    for node in nodes:
        if isinstance(node, ast.Call) and ast.unparse(node.func) in {"self._refused", "missing"}:
            key, why, *rest = node.args
            name, form = ("missing-key", ": missing; ") if not rest else (ast.literal_eval(rest[0]), " = …: ")
            yield name, f"{_template(key)}{form}{_template(why)}"
        elif isinstance(node, ast.Call):
            named = [given.value for given in node.keywords if given.arg == "id"]
            place = {"Diagnostic": 1, "Finding": 3}.get(ast.unparse(node.func))
            named += [] if place is None else node.args[place : place + 1]
            for given in named:
                for name in _constants(given):
                    yield name, _template(node.args[0]) if node.args else ""
        elif isinstance(node, ast.Assign) and re.search(r"\b(_?id|ref)\b", ast.unparse(node.targets[0])):
            texts = (part.value for part in ast.walk(node.value) if isinstance(part, ast.Constant))
            yield from (
                (text, "")
                for text in texts
                if isinstance(text, str) and re.fullmatch(r"[a-z]+(-[a-z0-9]+)+|diverged", text)
            )


def _constants(node: ast.expr) -> Iterator[str]:
    """Ids in an expression: a constant, or the branches of a condition."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from (*_constants(node.body), *_constants(node.orelse))


def _template(node: ast.expr) -> str:
    """A text with … for every value in it."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_template(part) for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _template(node.left) + _template(node.right)
    return "…"
