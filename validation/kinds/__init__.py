"""Kinds of measurement: one file each, with its `Settings` and a generator `run(case, settings)`.

A kind is found by being here, under the name of its file. One that measures time says `TIMED = True`: nothing else
runs meanwhile, and the study notes what the machine did besides. If its kernels take long to compile, it has
`rehearsal(settings)`, the settings of a short run that compiles them all: the study makes it while other cases run. One
whose cases take long says `LONG = True`: they start first, so that no core idles while the last one runs.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from typing import Any, Protocol

from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.store import Series


class Kind(Protocol):
    """What a file in this folder provides."""

    @property
    def Settings(self) -> type[Spec]:
        """The case's table `settings`, decoded strictly."""

    def run(self, case: Case, settings: Any, /) -> Iterator[Measured | Series] | Iterator[Measured]:
        """Numbers and series in the order in which they are known."""


KINDS: dict[str, Kind] = {
    name: importlib.import_module(f"{__name__}.{name}")
    for name in sorted(info.name for info in pkgutil.iter_modules(__path__))
}
TIMED = {name for name, kind in KINDS.items() if getattr(kind, "TIMED", False)}
LONG = {name for name, kind in KINDS.items() if getattr(kind, "LONG", False)}
