"""The report of a validation study, made from its stored results alone."""

from reports.build import build

__all__ = ["build"]
