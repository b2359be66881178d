"""Modules that build pages; they are imported only when needed, since they need optional packages."""

from __future__ import annotations

import importlib
from types import ModuleType

from flexlink.common.errors import MissingDependencyError, how_to_install


def builder(module: str, page: str) -> ModuleType:
    """Import the module that builds a `page`; it needs matplotlib and jinja2."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        why = f"a {page} needs matplotlib and jinja2 ({error}); install them with: {how_to_install('report')}"
        raise MissingDependencyError(why, id="package-missing") from None


def require_pages(page: str) -> None:
    """Check that pages can be built, before the work starts."""
    for module in ("page", "picture"):
        builder(f"flexlink.pages.{module}", page)
