"""All texts are in plain English, and tests do not depend on their wording."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import flexlink as fl
from docs.generators import messages
from docs.generators.messages import groups, texts
from docs.generators.rest import prose
from tests.books import language
from tests.conftest import ROOT
from tests.support import words
from tests.support.words import close, line, refused_line, reviewed, sentence, split, written

HERE = Path(__file__).parent
TESTS = (HERE.parent, HERE.parents[1] / "validation" / "tests")
MOST_ASSERTS_ON_PROSE = 32
WORD = re.compile(r"[A-Za-z]{2,}")


def test_no_text_uses_a_forbidden_word() -> None:
    """The command of CONTRIBUTING.md, which the test of its blocks leaves out."""
    command = [sys.executable, "-m", "tests.books.language"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "\n0 words to avoid\n")


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


def explained() -> list[str]:
    return [each.id for group in groups().values() for each in group]


def test_every_id_of_the_source_is_explained() -> None:
    assert sorted(texts().keys() - set(explained()) - {""}) == []


def test_every_explained_id_is_in_the_source() -> None:
    assert sorted(set(explained()) - texts().keys()) == []


def test_each_id_is_explained_once_with_a_remedy() -> None:
    assert [name for name, times in Counter(explained()).items() if times > 1] == []
    assert all(each.means.endswith(".") and each.remedy.endswith(".") for group in groups().values() for each in group)


def test_every_id_of_a_reviewed_message_is_in_the_source() -> None:
    """Keys with a colon or without a hyphen are not ids: they belong to outputs and to texts of the study."""
    known = texts().keys()
    keys = [key for key in words.texts() if "-" in key and ":" not in key and not key.startswith("test-")]
    assert [key for key in keys if key not in known] == []


def test_the_page_of_a_group_lists_its_ids_with_their_texts(tmp_path) -> None:
    title = next(iter(groups()))
    page = messages.group_page(title, tmp_path)
    assert all(f".. _message-{each.id}:" in page for each in groups()[title])
    shown = [prose(text) for each in groups()[title] for text in texts().get(each.id, ())]
    assert any("…" in text for text in shown)
    assert all(text in page for text in shown)


TEXT = (ROOT / "NOTATION.md").read_text(encoding="utf-8")
FLOW = TEXT.partition("## The flow of a simulation")[2].partition("\n## ")[0]


def test_every_file_named_in_notation_md_exists() -> None:
    paths = re.findall(r"\]\(([^)#]+)\)", TEXT) + re.findall(r"`(flexlink/[\w/]+)/?`", TEXT)
    assert paths
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_every_function_of_the_data_flow_exists() -> None:
    rows = [line.split("|")[2] for line in FLOW.splitlines() if line.startswith("| ") and "---" not in line][1:]
    for row in rows:
        files = [(ROOT / path).read_text(encoding="utf-8") for path in re.findall(r"\]\(([^)]+)\)", row)]
        for name in re.findall(r"`([a-z_]+)(?=[`(])", row):
            assert hasattr(fl, name) or any(f"def {name}(" in file for file in files), f"{name} in {row}"


def test_the_choices_that_the_paper_leaves_open_are_also_listed_in_the_study() -> None:
    choices = ("T_FL", "EI/l", "solid", "length", "prism")
    known = tomllib.loads((ROOT / "reports" / "limitations.toml").read_text(encoding="utf-8"))["limitation"]
    (listed,) = (each["text"] for each in known if "NOTATION.md" in each["text"])
    assert [choice for choice in choices if choice not in listed] == []
    last = TEXT.rpartition("\n## ")[2]
    assert [choice for choice in choices if choice not in last] == []


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch) -> None:
    """A reviewed file with one message."""
    monkeypatch.delenv(words.RECORDER, raising=False)
    monkeypatch.setattr(words, "texts", lambda: {"sag": ["arm.toml: sag = 1.25 m\n  also: x"]})
    monkeypatch.setattr(words, "known_texts", words.known_texts.__wrapped__)


def test_equal_words_and_near_numbers_pass(file: None) -> None:
    reviewed("sag", "/tmp/test-1/arm.toml: sag = 1.2501 m\n  also: x")


@pytest.mark.parametrize(
    "text", ["arm.toml: sag = 1.3 m\n  also: x", "arm.toml: sags = 1.25 m\n  also: x", "", "another"]
)
def test_other_words_and_numbers_fail(text: str, file: None) -> None:
    with pytest.raises(AssertionError):
        reviewed("sag", text)


def test_an_unknown_key_fails(file: None) -> None:
    with pytest.raises(AssertionError):
        reviewed("swing", "arm.toml: sag = 1.25 m\n  also: x")


def test_numbers_in_a_text_are_replaced_by_hashes() -> None:
    assert split("t = −1.5e-3 s, joint_2, 12 of 13") == ("t = # s, joint_2, # of #", (-0.0015, 12.0, 13.0))


def test_numbers_that_differ_by_rounding_are_close() -> None:
    assert close(1e-16, 7e-15) and close(1.0, 1.009) and not close(1.0, 1.02)


def test_a_file_is_read_as_it_was_written(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    long = "one\n  also: two"
    met = {"b": {long, "x = 1.0"}, "a": {"x = 1.001", "x = 1.0"}}
    (tmp_path / "messages.txt").write_text(written(met), encoding="utf-8")
    monkeypatch.setattr(words, "FILE", tmp_path / "messages.txt")
    read = words.texts.__wrapped__()
    assert read == {"a": ["x = 1.0"], "b": [long, "x = 1.0"]}


def test_the_line_of_an_error_ends_in_its_id(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setenv(words.RECORDER, str(tmp_path))
    text = "flexlink: a = 1: b\n  also: c"
    assert refused_line(f"note: n\n{text}  [id]\n", "id") == text
    with pytest.raises(AssertionError):
        refused_line("flexlink: a = 1: b  [other]\n", "id")


def test_lines_and_sentences_are_found_by_their_parts() -> None:
    assert line("a 1\nb 2\nb 3", "b", "2") == "b 2"
    page = "<p>One a. Two <b>b</b> c.</p><script>Two b.</script>"
    assert sentence(page, "b") == "Two b c."
    with pytest.raises(ValueError):
        line("a\na", "a")
