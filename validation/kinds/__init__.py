"""Kinds of measurement: one file each, with a generator `run`.

Each file in this folder is a kind, named after the file. A case's table `settings` contains the parameters of `run`
after `case`; a kind that needs them together declares a class `Settings`, and its generator is `run(case, settings)`.

A kind that measures time sets `TIMED = True`: nothing else runs meanwhile, and the study records the load of the
machine. If no limit applies to its times, or they are mostly not CPU times, it also sets `BESIDE = True`, so that it
runs alone only in the full study. If its kernels take long to compile, it has a function `rehearsal(settings)`, which
returns the settings of a short run that compiles them while other cases run. A kind with long cases sets `LONG = True`;
they start first, so that no core is idle at the end.
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
    """Interface of a file in this folder."""

    run: Callable[..., Iterator[Measured | Series] | Iterator[Measured]]
    """Yields numbers and series in the order of measurement."""


def measurements(kind: Kind, case: Case, settings: Any) -> Iterator[Measured | Series]:
    """Measurements by a kind for a case with decoded settings."""
    if hasattr(kind, "Settings"):
        yield from kind.run(case, settings)
    else:
        yield from kind.run(case, **msgspec.structs.asdict(settings))


def _settings(kind: Kind) -> type[Spec]:
    """Type into which a case's table `settings` is strictly decoded."""
    if hasattr(kind, "Settings"):
        return typing.cast(type[Spec], kind.Settings)
    types = typing.get_type_hints(kind.run, include_extras=True)
    _, *parameters = inspect.signature(kind.run).parameters.values()
    body = {each.name: each.default for each in parameters if each.default is not each.empty}
    body["__annotations__"] = {each.name: types[each.name] for each in parameters}
    make: typing.Any = type(Spec)  # msgspec.defstruct cannot make classes of another metaclass than its own
    return typing.cast(type[Spec], make("Settings", (Spec,), body, frozen=True))


KINDS: dict[str, Kind] = {
    name: importlib.import_module(f"{__name__}.{name}")
    for name in sorted(info.name for info in pkgutil.iter_modules(__path__))
}
SETTINGS = {name: _settings(kind) for name, kind in KINDS.items()}
TIMED = {name for name, kind in KINDS.items() if getattr(kind, "TIMED", False)}
BESIDE = {name for name, kind in KINDS.items() if getattr(kind, "BESIDE", False)}
LONG = {name for name, kind in KINDS.items() if getattr(kind, "LONG", False)}
