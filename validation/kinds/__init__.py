"""Kinds of measurement: generators that yield the numbers of a case.

Each generator with `@kind` in a file of this folder is a kind, named after the generator, or after the file if it is
called `run`. A case's table `settings` contains the parameters of the generator after `case`; one that needs them
together takes a single parameter `settings`, a `Spec`.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.store import Series

Generator = TypeVar("Generator", bound=Callable[..., Iterator[Any]])


@dataclasses.dataclass
class Kind:
    """A generator of numbers and series in the order of measurement, and the type of its settings.

    Attributes
    ----------
    timed
        It measures time: nothing else runs meanwhile, and the study records the load of the machine.
    beside
        No limit applies to its times, or they are mostly not CPU times: it runs alone only in the full study.
    long
        Its cases are long: they start first, so that no core is idle at the end.
    rehearsal
        Changes of settings, or functions of them, for a short run that compiles the kernels while other cases run.
    cell_in_words
        Describes a cell of a map, by its number.
    sheet
        Engine → its error for a data sheet.
    """

    run: Callable[..., Iterator[Measured | Series]]
    settings: type[Spec]
    together: bool
    timed: bool = False
    beside: bool = False
    long: bool = False
    rehearsal: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    cell_in_words: Callable[[Case, Any, int], Iterator[str]] | None = None
    sheet: Mapping[str, Callable[..., float]] = dataclasses.field(default_factory=dict)

    def measurements(self, case: Case, settings: Any) -> Iterator[Measured | Series]:
        """Measurements for a case with decoded settings."""
        return self.run(case, settings) if self.together else self.run(case, **msgspec.structs.asdict(settings))

    def rehearsed(self, settings: Any) -> Any:
        """Settings of a rehearsal."""
        given = self.rehearsal.items()
        return replace(settings, **{k: v(getattr(settings, k)) if callable(v) else v for k, v in given})


KINDS: dict[str, Kind] = {}


@typing.overload
def kind(run: Generator) -> Generator: ...
@typing.overload
def kind(**traits: Any) -> Callable[[Generator], Generator]: ...
def kind(run: Any = None, **traits: Any) -> Any:
    """Make a generator a kind; `traits` are further attributes of `Kind`."""
    if run is None:
        return lambda run: kind(run, **traits) or run
    types = typing.get_type_hints(run, include_extras=True)
    _, *parameters = inspect.signature(run).parameters.values()
    together = [each.name for each in parameters] == ["settings"]
    settings = types["settings"] if together else _settings(parameters, types)
    name = run.__module__.rpartition(".")[2] if run.__name__ == "run" else run.__name__
    KINDS[name] = Kind(run, settings, together, **traits)
    return run


def _settings(parameters: list[inspect.Parameter], types: Mapping[str, Any]) -> type[Spec]:
    """Type into which a case's table `settings` is strictly decoded."""
    body = {each.name: each.default for each in parameters if each.default is not each.empty}
    body["__annotations__"] = {each.name: types[each.name] for each in parameters}
    make: Any = type(Spec)  # msgspec.defstruct cannot make classes of another metaclass than its own
    return typing.cast(type[Spec], make("Settings", (Spec,), body, frozen=True))


for info in pkgutil.iter_modules(__path__):
    importlib.import_module(f"{__name__}.{info.name}")

TIMED = {name for name, each in KINDS.items() if each.timed}
BESIDE = {name for name, each in KINDS.items() if each.beside}
