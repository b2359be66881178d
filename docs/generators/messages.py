"""The page "Messages": meaning and remedy of the usual messages, then every error text of the library."""

from __future__ import annotations

import ast
import functools
import inspect
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

import flexlink
from docs.generators.rest import heading, prose
from flexlink import errors

LIBRARY = Path(flexlink.__file__).parent
USUAL = Path(__file__).parent / "messages.toml"

INTRO = """\
A message is one line: the object, its value, what is allowed, and a remedy. In Python a refusal raises a subclass of
:class:`flexlink.FlexlinkError`; the command line prints it and exits with 2. Doubtful results cause a ``warning:``,
also stored in ``Trajectory.warnings``. Values without effect, or probably unintended, cause a ``note:``. The headings
below are parts of messages, without their numbers and names.
"""


def page(_: Path) -> str:
    """Return the usual messages with cause and remedy, then all messages by class."""
    parts = [heading("Messages"), INTRO]
    for group in tomllib.loads(USUAL.read_text(encoding="utf-8"))["group"]:
        parts.append(heading(group["title"], 1))
        for message in group["message"]:
            body = f"{prose(message['means'])}\n\n**Remedy:** {prose(message['do'])}"
            parts.append(f"{prose(message['text'])}\n{_hanging(body)}\n")
    parts.append(heading("All errors by class", 1))
    parts.append("… is a value.\n")
    for name, texts in sorted(error_texts().items()):
        kind = getattr(errors, name)
        parts += [heading(name, 2), f":class:`flexlink.{'errors.' * (name != 'FlexlinkError')}{name}`: "
                  f"{prose((inspect.getdoc(kind) or '').splitlines()[0])}\n"]  # fmt: skip
        parts.append("\n".join(f"- {prose(text)}" for text in texts) + "\n")
    return "\n".join(parts)


def _hanging(text: str) -> str:
    return "\n".join(f"   {line}" if line else "" for line in text.splitlines())


def error_texts() -> dict[str, list[str]]:
    """Texts of every `raise` of a public error, by class."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for name, text in _source()[0]:
        found[name].add(text)
    return {name: sorted(texts, key=str.casefold) for name, texts in found.items()}


def literals() -> Iterator[str]:
    """Yield every string of the library's source and data files."""
    yield from _source()[1]
    for path in LIBRARY.rglob("*.toml"):
        yield path.read_text(encoding="utf-8")


@functools.cache
def _source() -> tuple[list[tuple[str, str]], list[str]]:
    """Texts of every `raise`, and every string, of the library's source."""
    raised, texts = list[tuple[str, str]](), list[str]()
    for path in LIBRARY.rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        raised += _raised(nodes)
        texts += [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return raised, texts


def _raised(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, str]]:
    for node in nodes:
        call = node.exc if isinstance(node, ast.Raise) else None
        if (
            isinstance(call, ast.Call)
            and isinstance(call.func, ast.Name)
            and call.func.id in errors.__all__
            and call.args
        ):
            text = _template(call.args[0])
            if len(text.replace("…", "").split()) > 1:
                yield call.func.id, text


def _template(node: ast.expr) -> str:
    """Return a text with … in place of every value."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(_template(part) for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _template(node.left) + _template(node.right)
    return "…"
