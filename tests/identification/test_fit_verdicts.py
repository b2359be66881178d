"""A parameter is identifiable only if the printed interval shows it."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

from flexlink.identification.estimate import Estimate
from tests.conftest import ROOT

MASS = Estimate("tip.mass", "tip.mass", 1.0, 1.1, 0.9, 1.3, 0.1, unit="kg", log=True, between=(0.001, 1000.0))


@pytest.mark.parametrize(
    ("change", "id"),
    [
        ({}, ""),
        ({"low": 0.3, "high": 2.9}, ""),
        ({"low": 0.3, "high": 3.1}, "wide-interval"),
        ({"low": -1.0, "high": 30.0, "log": False, "between": (-math.inf, math.inf)}, ""),
        ({"low": 0.9, "high": 1.3, "between": (0.9, 2.0)}, "interval-at-bound"),
        ({"low": 0.9, "high": 1.3, "between": (0.5, 1.2)}, "interval-at-bound"),
        ({"at_bound": True}, "estimate-at-bound"),
        ({"low": -math.inf, "high": math.inf}, "unbounded-interval"),
        ({"prior": (1.0, 0.15)}, ""),
        ({"prior": (1.0, 0.14)}, "prior-dominated"),
    ],
)
def test_the_verdict_of_a_parameter_follows_from_its_interval(change: dict[str, Any], id: str) -> None:
    estimate = dataclasses.replace(MASS, **change)
    assert (estimate.doubt.id if estimate.doubt is not None else "") == id
    assert estimate.verdict.startswith("not identifiable: " if id else "identifiable")
    assert estimate.determined == (id in ("", "prior-dominated"))


def test_the_guide_states_every_rule_of_the_verdict() -> None:
    guide = " ".join((ROOT / "docs" / "howto" / "fit.md").read_text().split())
    for words in (
        "interval is unbounded", "an end of the interval, is at a bound", "spans more than a factor of 10",
        "determines it more than the data do",
    ):  # fmt: skip
        assert words in guide, words
