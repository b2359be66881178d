"""Display names for stored quantities and verdicts; stored names cannot change, because they identify results."""

from __future__ import annotations

from pathlib import Path

from flexlink.data.documents import read_toml

DISPLAYED = read_toml(Path(__file__).with_suffix(".toml"))
"""Stored name → name that pages show."""


def displayed(name: str) -> str:
    """Display name of a stored quantity or verdict; other names are shown unchanged."""
    return str(DISPLAYED.get(name, name))
