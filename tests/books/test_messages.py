"""The site explains exactly the message ids that the source contains."""

from __future__ import annotations

from collections import Counter

from docs.generators import messages
from docs.generators.messages import groups, texts
from docs.generators.rest import prose
from tests.support import words


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
