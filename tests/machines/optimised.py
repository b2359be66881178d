"""`python -OO`, as far as flexlink sees it: its modules without asserts and docstrings, while tests keep their own.

A plugin of pytest (`-p tests.machines.optimised`). Processes that tests start are `-OO` as a whole.
"""

from __future__ import annotations

import os
from importlib.machinery import SourceFileLoader
from types import CodeType

import pytest

OWN = SourceFileLoader.get_code


def get_code(self: SourceFileLoader, fullname: str) -> CodeType | None:
    """The code of a module, of flexlink's from the source, whatever is kept on disk."""
    if fullname.partition(".")[0] != "flexlink":
        return OWN(self, fullname)
    path = self.get_filename(fullname)
    code = compile(self.get_data(path), path, "exec", dont_inherit=True, optimize=2)
    assert isinstance(code, CodeType)
    return code


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests() -> None:
    """Load flexlink so from now on."""
    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    os.environ["PYTHONOPTIMIZE"] = "2"
