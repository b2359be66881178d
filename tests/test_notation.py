"""NOTATION.md leads to what is there: files, functions of the flow, choices that the study's page names, too."""

from __future__ import annotations

import re
import tomllib

import pytest
from conftest import ROOT

import flexlink as fl

TEXT = (ROOT / "NOTATION.md").read_text(encoding="utf-8")
FLOW = TEXT.partition("## The flow of a simulation")[2].partition("\n## ")[0]


def test_every_file_that_it_names_is_there() -> None:
    paths = re.findall(r"\]\(([^)#]+)\)", TEXT) + re.findall(r"`(flexlink/[\w/]+)/?`", TEXT)
    assert paths
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_every_function_of_the_flow_is_there() -> None:
    rows = [line.split("|")[2] for line in FLOW.splitlines() if line.startswith("| ") and "---" not in line][1:]
    for row in rows:
        files = [(ROOT / path).read_text(encoding="utf-8") for path in re.findall(r"\]\(([^)]+)\)", row)]
        for name in re.findall(r"`([a-z_]+)(?=[`(])", row):
            assert hasattr(fl, name) or any(f"def {name}(" in file for file in files), f"{name} in {row}"


@pytest.mark.parametrize("choice", ["T_FL", "EI/l", "solid", "length", "prism"])
def test_what_the_paper_leaves_open_stands_where_the_study_is_read_too(choice: str) -> None:
    known = tomllib.loads((ROOT / "reports" / "limitations.toml").read_text(encoding="utf-8"))["limitation"]
    (said,) = (each["text"] for each in known if each["title"] == "Choices that the paper leaves open")
    assert choice in said
    assert choice in TEXT.partition("## What the paper leaves open")[2]
