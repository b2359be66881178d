"""Shortened cases of the study, each with the wrong results that are injected into it, as listed in `lies.toml`."""

import contextlib
import copy
import importlib
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import msgspec
import pytest

from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.data import documents
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.describe.spec import Spec, decode
from flexlink.engines import Engine
from validation.case import CASES, Case, load_case
from validation.formulations import ladder
from validation.formulations.ladder import FORMULATIONS
from validation.measuring import measure
from validation.store import Row

FILE = Path(__file__).parent / "lies.toml"


class Lie(Spec, frozen=True):
    """One wrong result: its quantity, relative error and call, and the quantity of the study that must fail.

    Only one call is wrong, because a check of the mean or the best of all calls would miss it. If `size` is above 1e-6,
    `why` names the limit that allows smaller errors.
    """

    of: str
    size: float
    fails: str
    call: int | Literal["first", "middle", "last", "every"] = "middle"
    why: str = ""

    def at(self, calls: int) -> int | None:
        """Index of the wrong call among this many calls, from 0 or negative from the end; None: every call is wrong."""
        named = {"first": 0, "middle": calls // 2, "last": calls - 1, "every": None}
        return named[self.call] if isinstance(self.call, str) else self.call % max(calls, 1)


class Cut(Spec, frozen=True):
    """A shortened case: other settings, fewer scenes, quantities that are measured less often."""

    kind: str
    case: str
    lie: tuple[Lie, ...] = ()
    settings: dict[str, Any] = msgspec.field(default_factory=dict)
    scenes: tuple[str, ...] = ()
    rows: dict[str, int] = msgspec.field(default_factory=dict)
    only: tuple[str, ...] = ()  # quantities; default: all
    change: dict[str, Any] = msgspec.field(default_factory=dict)  # changes of all scenes
    stand_in: dict[str, str] = msgspec.field(default_factory=dict)  # engine that may be missing → its substitute
    element: dict[str, str] = msgspec.field(default_factory=dict)  # formulation → its kind of element

    def __str__(self) -> str:
        return self.case

    @property
    def made(self) -> Case:
        """The shortened case."""
        case = next(iter(load_case(CASES / f"{self.case}.toml").divided()))
        kept = {name: each for name, each in case.quantity.items() if not self.only or name in self.only}
        return msgspec.structs.replace(
            case, scenes=self.scenes or case.scenes, settings=case.settings | self.settings,
            quantity={name: msgspec.structs.replace(each, rows=self.rows.get(name, each.rows))
                      for name, each in kept.items()},
        )  # fmt: skip

    def rows_of(self, left_out: int = 0) -> list[Row]:
        """Checked rows of the shortened case, without its last `left_out` scenes."""
        case = self.made

        def files(of: Case) -> list[Path]:
            found: list[Path] = every(of)
            return found[: len(found) - left_out]

        def scenes(of: Case) -> list[Scene]:
            return [load_scene(path).varied(self.change) for path in of.scene_files]

        def load(name: str, chain: Chain) -> Engine:
            return honest(self.stand_in.get(name, name), chain)

        honest, every = engines.load, Case.scene_files.fget  # type: ignore[attr-defined]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Case, "scene_files", property(files))
            patch.setattr(Case, "load_scenes", scenes)
            patch.setattr(engines, "load", load)
            patch.setattr(ladder, "REPEATS", 1)  # how often a run is timed again depends on the clock
            for name, element in self.element.items():
                patch.setitem(FORMULATIONS, name, FORMULATIONS[name]._replace(element=element))
            return [row for row in measure(case, "") if isinstance(row, Row)]


JUDGES = (
    "validation.oracles.manufactured.torque_pieces", "validation.oracles.bending_chain.frequencies",
    "validation.oracles.coupled_cells.frequencies", "validation.oracles.thick_beam.frequencies",
    "validation.formulations.exact_modes.hub_tip", "validation.oracles.floating_frame.tip",
    "validation.kinds.fifty_digits._exact", "validation.measured.two_link.linear_model",
)  # fmt: skip
"""Functions that compute references, and are never wrong."""


@contextlib.contextmanager
def remembering_judges() -> Iterator[None]:
    """Cache the reference results for a chain and a state, because they do not depend on the injected fault."""
    found: dict[tuple[str, bytes], Any] = {}

    def by(path: str, judge: Callable[..., Any]) -> Callable[..., Any]:
        def kept(*arguments: Any, **named: Any) -> Any:
            key = path, pickle.dumps((arguments, named))
            if key not in found:
                found[key] = judge(*arguments, **named)
            return copy.deepcopy(found[key])

        return kept

    with pytest.MonkeyPatch.context() as patch:
        for path in JUDGES:
            module, _, name = path.rpartition(".")
            patch.setattr(path, by(path, getattr(importlib.import_module(module), name)))
        yield


def load() -> list[Cut]:
    """All injected faults."""
    raw = documents.read_toml(FILE)
    return [
        decode({"kind": kind} | {"case": kind} | each, Cut, kind)
        for kind, cuts in raw.items()
        if kind != "not_lied_to"
        for each in cuts
    ]


def not_lied_to() -> dict[str, str]:
    """Kinds of cases without an injected fault, each with the reason."""
    found: dict[str, str] = documents.read_toml(FILE)["not_lied_to"]
    return found
