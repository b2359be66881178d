"""Checks that tables over time share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flexlink.common.errors import SceneError
from flexlink.common.wording import plural
from flexlink.describe.numbers import require_increasing


def check_table(
    times: tuple[float, ...] | None, tables: Mapping[str, Sequence[object] | None], *, smooth: bool, hold: bool
) -> None:
    """Check that times increase, that every table has one row per time, and that the interpolation is possible.

    Raises
    ------
    SceneError
        A check fails; the message names the key or the row.
    """
    if times is not None:
        require_increasing("times", times)
    if smooth and len(times or ()) < 2:
        raise SceneError(f"smooth = {smooth}: needs a table with at least 2 times", id="needs-another-key")
    if hold and (smooth or times is None):
        needs = f"a table, times and {' or '.join(tables)}" if times is None else "smooth = False"
        raise SceneError(f"hold = {hold}: needs {needs}", id="needs-another-key")
    for name, rows in tables.items():
        if times is not None and rows is not None and len(rows) != len(times):
            raise SceneError(f"{name}: {plural(len(rows), 'row')}, but {len(times)} times", id="one-per-time")
