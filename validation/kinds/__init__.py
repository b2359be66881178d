"""Kinds of measurement: one file each, with a generator `run`.

A kind is found by being here, under the name of its file. A case's table `settings` are the parameters of `run` after
`case`; a kind whose helpers need them together has them in a class `Settings`, which its `run(case, settings)` takes.
One that measures time says `TIMED = True`: nothing else runs meanwhile, and the study notes what the machine did
besides; where no limit judges these times, or is far from processor times, `BESIDE = True`: alone in the full study
only. If its kernels take long to compile, it has `rehearsal(settings)`, the settings of a short run that compiles
them all: the study makes it while other cases run. One whose cases take long says `LONG = True`: they start first, so
that no core idles while the last one runs.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import typing
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import msgspec

from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.store import Series


class Kind(Protocol):
    """What a file in this folder provides."""

    run: Callable[..., Iterator[Measured | Series] | Iterator[Measured]]
    """Numbers and series in the order in which they are known."""


def measurements(kind: Kind, case: Case, settings: Any) -> Iterator[Measured | Series]:
    """What a kind measures of a case with decoded settings."""
    if hasattr(kind, "Settings"):
        yield from kind.run(case, settings)
    else:
        yield from kind.run(case, **msgspec.structs.asdict(settings))


def _settings(kind: Kind) -> type[Spec]:
    """What a case's table `settings` is decoded into, strictly."""
    if hasattr(kind, "Settings"):
        return typing.cast(type[Spec], kind.Settings)
    types = typing.get_type_hints(kind.run, include_extras=True)
    _, *parameters = inspect.signature(kind.run).parameters.values()
    fields = [
        (each.name, types[each.name]) if each.default is each.empty else (each.name, types[each.name], each.default)
        for each in parameters
    ]
    return typing.cast(type[Spec], msgspec.defstruct("Settings", fields, bases=(Spec,), frozen=True))


KINDS: dict[str, Kind] = {
    name: importlib.import_module(f"{__name__}.{name}")
    for name in sorted(info.name for info in pkgutil.iter_modules(__path__))
}
SETTINGS = {name: _settings(kind) for name, kind in KINDS.items()}
TIMED = {name for name, kind in KINDS.items() if getattr(kind, "TIMED", False)}
BESIDE = {name for name, kind in KINDS.items() if getattr(kind, "BESIDE", False)}
LONG = {name for name, kind in KINDS.items() if getattr(kind, "LONG", False)}
