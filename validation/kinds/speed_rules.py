"""CPU time at equal tip error: the cheapest chain of one family of lumping rules against the cheapest of another.

Every family uses its own cheapest number of hinges and tolerance; only the time of the steps counts
(`with_flexlink.timed_run`). The reference is a finer chain, whose error is estimated with a coarser one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.store import Series, table
from validation.trade.rule_ladder import Reference, Tried, exact, ladder
from validation.trade.scenes import Varied, varied_scene

TIMED = True

COLUMNS = "rule", "error [m]", "CPU time [s]", "hinges", "tolerance [m]"


class Race(Spec, frozen=True):
    """A scene and its tip errors [m]; for each method, the numbers of hinges to try by rule."""

    name: str
    scene: Varied
    errors: tuple[Positive, ...]
    hinges: dict[str, dict[str, tuple[int, ...]]]


class Settings(Spec, frozen=True):
    """Families of rules, compared with the first one; the comparisons; the longest run [s]."""

    families: dict[str, tuple[str, ...]]
    reference: Reference
    tolerances: tuple[Positive, ...]
    longest: Positive
    race: tuple[Race, ...]


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield times of each family and their ratios for every comparison, and a series of all runs."""
    for race in settings.race:
        scene = varied_scene(race.scene, race.name)
        true = exact(scene, settings.reference)
        yield Measured("reference, its own error", true.own, race.name)
        yield Measured("reference, its own error / smallest error", true.own / min(race.errors), race.name)
        tried = {
            method: list(ladder(scene, rules, (method,), settings.tolerances, true.tip, settings.longest))
            for method, rules in race.hinges.items()
        }
        for method, runs in tried.items():
            for error in race.errors:
                yield from _rows(settings, race, method, error, runs)
        yield _series(race, scene, [each for runs in tried.values() for each in runs])


def _rows(settings: Settings, race: Race, method: str, error: float, runs: Sequence[Tried]) -> Iterator[Measured]:
    best: dict[str, Tried] = {}
    for family, rules in settings.families.items():
        met = [each for each in runs if each.at.rule in rules and each.point.error <= error]
        if met:
            best[family] = least = min(met, key=lambda each: each.point.seconds)
            facts: Facts = {"family": family, "method": method, "tip error": error}
            note = f"{least}: {least.point.error:.2g} m."
            yield Measured("CPU time", 1e3 * least.point.seconds, race.name, varied=facts, note=note, timed=True)
    first, *others = settings.families
    if first not in best:
        return
    for family in others:
        if family in best:
            gain = best[first].point.seconds / best[family].point.seconds
            note = f"{best[first]}; {best[family]}."
            named = f"{first} / {family}, {method}, tip error {error:g} m"
            for quantity in (named, f"{race.name}: {named}"):
                yield Measured(quantity, gain, race.name, note=note, timed=True)


def _series(race: Race, scene: Scene, runs: Sequence[Tried]) -> Series:
    rows = [
        (f"{each.at.rule}, {each.method}", each.point.error, each.point.seconds, each.at.hinges, each.point.setting)
        for each in runs
    ]
    _, x, y, *_ = COLUMNS
    title = f"{race.name}: {race.scene.about}"
    return Series("work", title, table(COLUMNS, rows), x, x, y, "log", "log", group="rule", scene=scene.name)
