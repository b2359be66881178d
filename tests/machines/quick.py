"""Select a few fast tests: of each parametrized test only the last parameter set.

A plugin of pytest (`-p tests.machines.quick`). A fixed list of the tests that a CPU has ever affected
would omit all new tests.
"""

import pytest


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect all parameter sets of each test but the last."""
    kept = set({item.nodeid.partition("[")[0]: item.nodeid for item in items}.values())
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in kept])
    items[:] = [item for item in items if item.nodeid in kept]
