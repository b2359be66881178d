"""All texts are in plain English, and tests do not depend on their wording."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from tests.books import language

HERE = Path(__file__).parent
TESTS = (HERE.parent, HERE.parents[1] / "validation" / "tests")
MOST_ASSERTS_ON_PROSE = 32
WORD = re.compile(r"[A-Za-z]{2,}")


def test_no_text_uses_a_forbidden_word() -> None:
    assert language.listed(language.files()) == []


def test_forbidden_words_are_detected() -> None:
    sample = tomllib.loads((HERE / "language.toml").read_text(encoding="utf-8"))["sample"]
    assert [word for _, word, _ in language.faults(sample["text"])] == sample["words"]


def asserts_on_prose(path: Path) -> Iterator[int]:
    """Lines of asserts, and of `match=`, that compare with three words or more: new wording would break them."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assert):
            yield from [node.lineno] if any(map(_is_prose, ast.walk(node.test))) else []
        elif isinstance(node, ast.Call):
            matches = [given.value for given in node.keywords if given.arg == "match"]
            yield from (node.lineno for match in matches if any(map(_is_prose, ast.walk(match))))


def _is_prose(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and len(WORD.findall(node.value)) >= 3


def test_few_tests_compare_prose() -> None:
    paths = [path for folder in TESTS for path in sorted(folder.rglob("*.py"))]
    found = [f"{path.name}:{line}" for path in paths for line in asserts_on_prose(path)]
    assert len(found) <= MOST_ASSERTS_ON_PROSE, found
