"""The library prints the usual messages of the page "Messages" in exactly these words."""

from __future__ import annotations

import functools
import tomllib
from collections import Counter

import pytest

from docs.generators import messages

USUAL = [message for group in tomllib.loads(messages.USUAL.read_text(encoding="utf-8"))["group"]
         for message in group["message"]]  # fmt: skip


@functools.cache
def source() -> list[str]:
    """Every literal of the library; reading them takes a second, which no other test has to wait for."""
    return list(messages.literals())


def said(text: str) -> bool:
    return any(text in literal for literal in source())


@pytest.mark.parametrize("message", USUAL, ids=lambda message: message["text"])
def test_a_usual_message_stands_in_the_source(message: dict[str, str]) -> None:
    assert said(message["text"])
    assert len(message["means"]) > 20 and len(message["do"]) > 10


def test_a_message_that_nothing_prints_is_noticed() -> None:
    assert not said("the flux capacitor is empty")


def test_links_of_the_page_are_links(tmp_path) -> None:
    shown = messages.page(tmp_path)
    assert ":doc:`../../explanation/integrators`" in shown
    assert "``" in shown and ":doc:``" not in shown


def test_each_message_stands_there_once() -> None:
    assert [text for text, times in Counter(message["text"] for message in USUAL).items() if times > 1] == []
    assert len(USUAL) >= 35
