"""NOTATION.md names only existing files and functions, and lists the same open choices as the study page."""

from __future__ import annotations

import re
import tomllib

import flexlink as fl
from tests.conftest import ROOT

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
