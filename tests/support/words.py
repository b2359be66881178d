"""Texts that people read, reviewed in `tests/messages.txt`: tests compare ids and values; the file contains the words.

A test passes a message to `reviewed`, or expects an error with `refused`. `python -m tests.support.words` runs all
tests and rewrites the file with the texts that occur, so that a change of words is one diff to review.
"""

import contextlib
import functools
import html
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

FILE = Path(__file__).parents[1] / "messages.txt"
HEAD = """\
# Messages, warnings, notes and outputs in tests, by id. `python -m tests.support.words` writes them: review its diff.
# Folders are left out; # denotes a number that is not compared. Other numbers may differ by 1 %: processors round.
"""
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w*\()", re.IGNORECASE)
FOLDER = re.compile(r"(?<!\w)(?:[A-Z]:)?/(?:[^\s/:'\"<>,;()]+/)+")
TEMPORARY = re.compile(r"\btest_\w*\d+(?=:)|(?<=')[\w.-]*(?=…)|(?<=sources )[0-9a-f]{12}\b")
"""Parts of texts that change between runs: names of temporary folders, shortened paths, the hash of the sources."""
RECORDER = "FLEXLINK_WORDS"


@contextlib.contextmanager
def refused(kind: type[BaseException], id: str, *, values: bool = True) -> Iterator[pytest.ExceptionInfo]:
    """Expect an error of this class with this id, whose text is in the reviewed file.

    Parameters
    ----------
    kind
        Class of the error.
    id
        Id of the error; for an error without id, the key of its text in the file.
    values
        Whether the numbers in its text are compared.
    """
    with pytest.raises(kind) as caught:
        yield caught
    assert (getattr(caught.value, "id", "") or id) == id, str(caught.value)
    reviewed(id, str(caught.value), values=values)


def reviewed(key: str, text: str, *, values: bool = True) -> None:
    """Check that the reviewed file contains this text under this key: the same words, and numbers within 1 %."""
    shown = normal(text)
    if not values:
        shown = NUMBER.sub("#", shown)
    if recorder := os.environ.get(RECORDER):
        with Path(recorder, f"{os.getpid()}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps([key, shown]) + "\n")
        return
    words, numbers = split(shown)
    known = known_texts().get(key, {})
    near = any(all(map(close, numbers, others)) for others in known.get(words, ()))
    assert near, f"not in {FILE.name} under {key!r}:\n{shown}\nknown:\n" + "\n".join(texts().get(key, ()))


def refused_line(stderr: str, id: str, *, values: bool = True) -> str:
    """Expect one error of the command line with this id, reviewed; returns its text without the id.

    Lines of notes, warnings and compilation before it are skipped; further mistakes ("also: …") are part of the text.
    """
    lines = stderr.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("flexlink"))
    text = "\n".join(lines[first:]).strip()
    assert text.endswith(f"[{id}]"), stderr
    text = text.removesuffix(f"[{id}]").rstrip()
    reviewed(id, text, values=values)
    return text


def line(text: str, *parts: str) -> str:
    """The only line of a text that contains all parts: names, ids or values, not prose."""
    (found,) = (each for each in text.splitlines() if all(part in each for part in parts))
    return found


def sentence(page: str, *parts: str) -> str:
    """The only sentence of an HTML page that contains all parts."""
    shown = html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)))
    sentences = re.split(r"(?<=[.:!?])\s+(?=[A-Z“„\d])", " ".join(shown.split()))
    (found,) = dict.fromkeys(each for each in sentences if all(part in each for part in parts))
    return found


def normal(text: str) -> str:
    """Remove folders and names of temporary files from a text."""
    return TEMPORARY.sub("", FOLDER.sub("", text)).strip()


def split(text: str) -> tuple[str, tuple[float, ...]]:
    """Return the text with # in place of its numbers, and the numbers."""
    return NUMBER.sub("#", text), tuple(float(number.replace("−", "-")) for number in NUMBER.findall(text))


def close(a: float, b: float) -> bool:
    """Whether two printed numbers are equal up to the rounding of another processor."""
    return a == b or abs(a - b) <= 0.01 * max(abs(a), abs(b)) + 1e-10


@functools.cache
def texts() -> dict[str, list[str]]:
    """Texts of the reviewed file by key."""
    found: dict[str, list[str]] = {}
    for block in FILE.read_text(encoding="utf-8").split("\n[")[1:]:
        key, _, rest = block.partition("]\n")
        found[key] = [item.replace("\n    ", "\n") for item in rest.rstrip("\n").removeprefix("- ").split("\n- ")]
    return found


@functools.cache
def known_texts() -> dict[str, dict[str, list[tuple[float, ...]]]]:
    """Numbers of the reviewed texts, by key and words."""
    found: dict[str, dict[str, list[tuple[float, ...]]]] = {}
    for key, several in texts().items():
        for text in several:
            words, numbers = split(normal(text))
            found.setdefault(key, {}).setdefault(words, []).append(numbers)
    return found


def written(met: dict[str, set[str]]) -> str:
    """Contents of the reviewed file, with only one of several texts that differ by rounding."""
    blocks = []
    for key in sorted(met):
        kept: dict[str, list[tuple[float, ...]]] = {}
        items = []
        for text in sorted(met[key]):
            words, numbers = split(text)
            if any(all(map(close, numbers, others)) for others in kept.get(words, ())):
                continue
            kept.setdefault(words, []).append(numbers)
            items.append("- " + text.replace("\n", "\n    "))
        blocks.append(f"\n[{key}]\n" + "\n".join(items) + "\n")
    return HEAD + "".join(blocks)


def main(arguments: list[str]) -> int:
    """Run all tests or the given ones, and write the file; texts of tests that did not run are kept."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pytest", "-q", "-n", "2", *arguments]
        code = subprocess.run(command, env={**os.environ, RECORDER: folder}, check=False).returncode
        part = bool(arguments)
        met: dict[str, set[str]] = {key: set(several) for key, several in texts().items()} if part else {}
        for file in Path(folder).glob("*.jsonl"):
            for line in file.read_text(encoding="utf-8").splitlines():
                key, text = json.loads(line)
                met.setdefault(key, set()).add(text)
    FILE.write_text(written(met), encoding="utf-8")
    return code


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
