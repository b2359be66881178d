"""Correct digits of M, T_GC and q̈ in every engine at extreme parameters, by 100-digit arithmetic on the same numbers.

The error of a quantity is the largest over its elements and over several states, relative to the largest element in
each state; it is capped at 1, which means no correct digit. For M, the error relative to √(M_jj M_kk) is also given, as
"M, scaled".

The ratio of a cell is flexlink's error divided by the smallest error of the other engines, or by √n eps if that is
larger. Rounding explains ratios up to ten (`dynamics.rounding`), because an engine may be better by chance. Cells with
cond(M) above 10¹⁶ are listed separately: there the rounded M is singular, and correct digits are accidental.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.spec import Spec
from flexlink.diagnosis.quantities import QUANTITIES, State
from flexlink.dynamics.rounding import EPS
from validation.case import Case, Measured
from validation.extremes.cells import Cell, Map, recipe
from validation.facts import in_words
from validation.kinds import kind
from validation.oracles.common_origin import of_state
from validation.store import Series, table

Numbers = dict[str, Array]


NATIVE = "native"
MEASURES = {"M": "M", "M, scaled": "M", "T_GC": "T_GC", "q̈": "q̈"}
"""Measure → quantity."""


SINGULAR_CONDITION = 1e16
"""cond(M) above which the rounded M may be singular; 1/eps is 4.5e15."""


class States(Spec, frozen=True):
    """Ranges of uniformly random states: rates up to `rate` [rad/s], T_EX of driven joints up to `torque` [N m].

    angle, bend
        Largest angles of driven joints and of hinges [rad].
    gimbal
        Distance of the middle angle of a three-axis hinge group from 90° or, if negative, from −90° [rad]; None leaves
        the angle random.
    """

    angle: float = np.pi
    bend: float = 0.3
    rate: float = 10.0
    torque: float = 10.0
    gimbal: float | None = None
    samples: Annotated[int, msgspec.Meta(ge=1)] = 3

    def draw(self, chain: Chain) -> list[State]:
        """Random states, reproducible for a chain."""
        random = np.random.default_rng(0)
        return [self._one(chain, random) for _ in range(self.samples)]

    def _one(self, chain: Chain, random: np.random.Generator) -> State:
        n, driven = chain.n, chain.active
        q, tau = random.uniform(-self.bend, self.bend, n), np.zeros(n)
        q[driven] = random.uniform(-self.angle, self.angle, len(driven))
        tau[driven] = random.uniform(-self.torque, self.torque, len(driven))
        if self.gimbal is not None:
            groups = chain.bodies[chain.bodies["stop"] - chain.bodies["first"] == 3]
            q[groups["first"] + 1] = np.copysign(np.pi / 2 - abs(self.gimbal), self.gimbal)
        return State(q, random.uniform(-self.rate, self.rate, n), tau, np.zeros(6))


class Settings(Map, frozen=True):
    """The map, and the engines compared with flexlink."""

    engines: tuple[str, ...]


class CellErrors(NamedTuple):
    """Results of a cell: number of joints, cond(M), errors by engine and measure, and why engines refused the cell."""

    n: int
    condition: float
    errors: dict[tuple[str, str], float]
    refusals: str

    def ratio(self, measure: str) -> float:
        """Flexlink's error over the smallest error of other engines (at least √n eps); nan if one is missing."""
        others = [e for (engine, of), e in self.errors.items() if of == measure and engine != NATIVE]
        own = self.errors.get((NATIVE, measure), np.nan)
        return own / max(min(others), np.sqrt(self.n) * EPS) if others else np.nan


def cell_in_words(case: Case, settings: Settings, number: int) -> Iterator[str]:
    """Describe one cell and its result, line by line."""
    cell = list(settings.cells())[number]
    found = look(settings, cell)
    yield f"{cell.scene}, {in_words(cell.values)}: {found.n} joints, cond(M) = {found.condition:.2g}"
    for (engine, measure), error in found.errors.items():
        yield f"{engine:<10} {measure:<10} error {error:.2g} of the largest element"
    yield found.refusals


@kind(long=True, cell_in_words=cell_in_words)
def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield the worst ratio of each measure, overall and by axis, the number of cells, and the cells."""
    found = [(cell, look(settings, cell)) for cell in settings.cells()]
    regular = [each for each in found if each[1].condition <= SINGULAR_CONDITION]
    for measure in MEASURES:
        yield _worst(measure, regular, {})
        for axis in settings.axis:
            yield _worst(measure, [each for each in regular if axis in each[0].values], {"axis": axis})
        beyond = _worst(measure, [each for each in found if each[1].condition > SINGULAR_CONDITION], {})
        yield beyond._replace(quantity=f"{measure}, cond(M) > 10¹⁶")
    yield Measured("cells", len(found))
    yield Measured("judged", sum(bool(each.errors) for _, each in found))
    yield _series(case, settings, found)


def look(settings: Settings, cell: Cell) -> CellErrors:
    """Errors of one cell in all engines."""
    try:
        scene, state = settings.situation(cell)
        chain = lump(scene)
        states = States(**state).draw(chain)
        exact = [of_state(chain, s.q, s.qd, s.tau) for s in states]
    except FlexlinkError as refused:
        return CellErrors(0, np.nan, {}, str(refused))
    errors, words = dict[tuple[str, str], float](), list[str]()
    for name in (NATIVE, *settings.engines):
        for measure, error in _measured(name, chain, list(zip(states, exact, strict=True))):
            if isinstance(error, str):
                words.append(f"{name}: {error}")
            else:
                errors[name, measure] = error
    return CellErrors(chain.n, max(float(np.linalg.cond(truth["M"])) for truth in exact), errors, "; ".join(words))


def _measured(name: str, chain: Chain, states: list[tuple[State, Numbers]]) -> Iterator[tuple[str, float | str]]:
    """Yield every measure of an engine with its largest error over the states, or why the engine refused the cell."""
    try:
        engine = engines.load(name, chain)
    except FlexlinkError as refused:
        yield "", str(refused)
        return
    for measure, quantity in MEASURES.items():
        try:
            with np.errstate(all="ignore"):
                values = [(QUANTITIES[quantity].evaluate(engine, s), truth[quantity]) for s, truth in states]
        except FlexlinkError as refused:
            yield measure, f"{measure}: {refused}"
        else:
            yield measure, max(_error(measure, *pair) for pair in values)


def _error(measure: str, value: Array, exact: Array) -> float:
    scale: Any = np.abs(exact).max()
    if measure == "M, scaled":
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    error = np.abs(value - exact)
    return float(np.where(error == 0, 0.0, error / scale).max()) if (error < scale).all() else 1.0


def _worst(measure: str, found: list[tuple[Cell, CellErrors]], facts: dict[str, str]) -> Measured:
    ratios = [(each.ratio(measure), cell) for cell, each in found if not np.isnan(each.ratio(measure))]
    worst, cell = max(ratios, key=lambda each: each[0], default=(np.nan, None))
    note = f"{cell.scene}, {in_words(cell.values)}" if cell else ""
    return Measured(measure, worst, varied=facts, note=note)


def _series(case: Case, settings: Settings, found: list[tuple[Cell, CellErrors]]) -> Series:
    names = [(engine, measure) for measure in MEASURES for engine in (NATIVE, *settings.engines)]
    heads = ("cell", "recipe", "situation", "varied", "axes", "n", "cond(M)", *map(" ".join, names), "said")
    rows = [
        (number, recipe(case, number), cell.scene, in_words(cell.values), " and ".join(cell.values), each.n,
         each.condition, *(each.errors.get(name, np.nan) for name in names), each.refusals)
        for number, (cell, each) in enumerate(found)
    ]  # fmt: skip
    return Series("digits", "Digits at extremes", table(heads, rows), "cond(M)", "cond(M)", "error", "log", "log")
