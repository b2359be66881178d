"""The reviewed file of messages: words and numbers are compared, and rounding may differ."""

from __future__ import annotations

import pytest

from tests.support import words
from tests.support.words import close, line, refused_line, reviewed, sentence, split, written


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
