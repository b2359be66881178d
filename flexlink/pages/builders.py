"""Modules that build pages: loaded when a page is asked for, since they need packages that the library does without."""

from __future__ import annotations

import importlib
from types import ModuleType

from flexlink.common.errors import MissingDependencyError


def builder(module: str, page: str) -> ModuleType:
    """A module that builds a `page`, which needs matplotlib and jinja2.

    Raises
    ------
    MissingDependencyError
        One of them is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingDependencyError(
            f"a {page} needs matplotlib and jinja2 ({error}); install them with: "
            "python -m pip install 'flexlink[report]'",
            id="package-missing",
        ) from None


def require_pages(page: str) -> None:
    """Refuse a `page`, before the work, where what builds pages is not installed; errors as in `builder`."""
    for module in ("page", "picture"):
        builder(f"flexlink.pages.{module}", page)
