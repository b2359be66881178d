"""Few of all fast tests, whatever is added: of one with several sets of parameters the first and the last.

A plugin of pytest (`-p tests.machines.quick`). Which tests a CPU can move, nobody knows before one has; a list
of those it has ever moved left out all that was added since.
"""

from __future__ import annotations

import pytest


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the sets between."""
    ends: dict[str, list[pytest.Item]] = {}
    for item in items:
        ends.setdefault(item.nodeid.partition("[")[0], []).append(item)
    kept = {item.nodeid for several in ends.values() for item in (several[0], several[-1])}
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in kept])
    items[:] = [item for item in items if item.nodeid in kept]
