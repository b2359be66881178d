"""Words to avoid in everything that people read: `python -m tests.books.language [FILE …]` lists them.

The words are in `language.toml`. Texts are docstrings, comments and strings of Python, strings and comments of TOML,
Markdown without its code, and names of tests.
"""

import ast
import functools
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORDS = Path(__file__).with_name("language.toml")
LEFT_OUT = (
    "tests/books/language.toml",
    "tests/messages.txt",
    "models/",
    "validation/reference/",
    "reports/full",
    "docs/inventories",
)
CODE = re.compile(r"`[^`]*`")


@functools.cache
def words() -> list[tuple[re.Pattern[str], str, re.Pattern[str] | None]]:
    """Patterns of words, their better alternatives, and the contexts in which they are allowed."""
    found = []
    for word in tomllib.loads(WORDS.read_text(encoding="utf-8"))["word"]:
        allowed = word.get("allowed")
        context = re.compile("|".join(allowed), re.IGNORECASE) if allowed else None
        flags = re.MULTILINE if "Of (" in word["pattern"] else re.IGNORECASE | re.MULTILINE
        found.append((re.compile(word["pattern"], flags), word["better"], context))
    return found


def faults(text: str) -> Iterator[tuple[int, str, str]]:
    """Offsets of words to avoid in a text, the words, and better alternatives."""
    plain = CODE.sub(lambda code: "x" * len(code[0]), text)
    for pattern, better, context in words():
        for match in pattern.finditer(plain):
            around = plain[max(0, match.start() - 40) : match.end() + 40]
            if context is None or not context.search(around):
                yield match.start(), match[0].strip(), better


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """All texts in a file that people read, with their line numbers."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        yield from _of_python(path, source)
    elif path.suffix == ".md":
        yield (
            1,
            re.sub(r"^```.*?^```", lambda code: re.sub(r"[^\n]", " ", code[0]), source, flags=re.MULTILINE | re.DOTALL),
        )
    elif path.suffix in {".toml", ".txt", ".cff"}:
        yield from enumerate(source.splitlines(), 1)


def _of_python(path: Path, source: str) -> Iterator[tuple[int, str]]:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            yield node.lineno, node.value
        if isinstance(node, ast.FunctionDef) and path.name.startswith("test_") and node.name.startswith("test_"):
            yield node.lineno, node.name.replace("_", " ")
    for number, line in enumerate(source.splitlines(), 1):  # comments, and some strings a second time
        if "#" in line:
            yield number, line[line.index("#") :]


def files() -> list[Path]:
    """Files of the project that contain texts; in a checkout, only those under version control."""
    try:
        found = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split(
            "\n"
        )
    except (OSError, subprocess.CalledProcessError):
        return []
    kinds = {".py", ".md", ".toml", ".cff"}
    return [
        ROOT / name for name in found
        if Path(name).suffix in kinds and not name.startswith(LEFT_OUT) and (ROOT / name).is_file()
    ]  # fmt: skip


def listed(paths: list[Path]) -> list[str]:
    """One line for every word to avoid, with file, line, word and better alternative."""
    found = []
    for path in paths:
        for first, text in texts(path):
            for at, word, better in faults(text):
                line = first + text.count("\n", 0, at)
                shown = " ".join(text[max(0, at - 40) : at + 50].split())
                found.append(f"{path.resolve().relative_to(ROOT)}:{line}: {word!r}: {better}  | …{shown}…")
    return found


if __name__ == "__main__":
    lines = listed([Path(name) for name in sys.argv[1:]] or files())
    print("\n".join(lines))
    print(f"{len(lines)} words to avoid")
    sys.exit(bool(lines))
