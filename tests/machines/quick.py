"""Select a few fast tests: of each parametrized test only the first and the last parameter set.

A plugin of pytest (`-p tests.machines.quick`). A fixed list of the tests that a CPU has ever affected
would omit all new tests.
"""

import pytest


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the parameter sets of each test between the first and the last."""
    ends: dict[str, list[pytest.Item]] = {}
    for item in items:
        ends.setdefault(item.nodeid.partition("[")[0], []).append(item)
    kept = {item.nodeid for several in ends.values() for item in (several[0], several[-1])}
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in kept])
    items[:] = [item for item in items if item.nodeid in kept]
