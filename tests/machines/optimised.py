"""Emulate `python -OO` for flexlink only: its modules lose asserts and docstrings, tests keep theirs.

A plugin of pytest (`-p tests.machines.optimised`). Processes started by tests run with `-OO`.
"""

import os
from importlib.machinery import SourceFileLoader
from types import CodeType

import pytest

OWN = SourceFileLoader.get_code


def get_code(self: SourceFileLoader, fullname: str) -> CodeType | None:
    """Return the code of a module; modules of flexlink are compiled from source, not from cached byte code."""
    if fullname.partition(".")[0] != "flexlink":
        return OWN(self, fullname)
    path = self.get_filename(fullname)
    code = compile(self.get_data(path), path, "exec", dont_inherit=True, optimize=2)
    assert isinstance(code, CodeType)
    return code


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests() -> None:
    """Install the loader for flexlink."""
    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    os.environ["PYTHONOPTIMIZE"] = "2"
