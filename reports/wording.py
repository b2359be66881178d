"""Words of the report: display names, because stored names identify results and cannot change, and ranges."""

from __future__ import annotations

from pathlib import Path

from flexlink.data.documents import read_toml

DISPLAYED = read_toml(Path(__file__).with_suffix(".toml"))
"""Stored name → name that pages show."""


def displayed(name: str) -> str:
    """Display name of a stored quantity or verdict; other names are shown unchanged."""
    return str(DISPLAYED.get(name, name))


def from_to(low: str, high: str) -> str:
    """Range of two numbers as text; the number, if both are the same."""
    return low if low == high else f"{low} to {high}"
