"""Cost of families of lumping rules at equal tip error, and whether advice picks the cheapest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import flexlink as fl
from flexlink.common.errors import DataFileError
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.store import Series, table
from validation.trade.rule_ladder import Reference, Tried, exact, ladder
from validation.trade.scenes import Varied, varied_scene

COLUMNS = "rule", "error [m]", "CPU time [s]", "hinges", "tolerance [m]"


class Race(Spec, frozen=True):
    """A scene and its tip errors [m]; for each method, the numbers of hinges to try by rule."""

    name: str
    scene: Varied
    errors: tuple[Positive, ...]
    hinges: dict[str, dict[str, tuple[int, ...]]]


class SpeedRulesSettings(Spec, frozen=True):
    """Families of rules, compared with the first one; the comparisons; the longest run [s]."""

    families: dict[str, tuple[str, ...]]
    reference: Reference
    tolerances: tuple[Positive, ...]
    longest: Positive
    race: tuple[Race, ...]


@kind(timed=True)
def speed_rules(case: Case, settings: SpeedRulesSettings) -> Iterator[Measured | Series]:
    """CPU time at equal tip error: the cheapest chain of one family of lumping rules against the cheapest of another.

    Every family uses its own cheapest number of hinges and tolerance; only the time of the steps counts
    (`with_flexlink.timed_run`). The reference is a finer chain, whose error is estimated with a coarser one.

    Yield times of each family and their ratios for every comparison, and a series of all runs.
    """
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


def _rows(
    settings: SpeedRulesSettings, race: Race, method: str, error: float, runs: Sequence[Tried]
) -> Iterator[Measured]:
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


class Requested(Spec, frozen=True):
    """A scene and its allowed tip error [m]; `axial` marks scenes for which coupled springs should be cheapest."""

    name: str
    scene: Varied
    error: Positive
    axial: bool = False


class AdviceFamiliesSettings(Spec, frozen=True):
    """Scenes; rules by family, hinges, tolerances relative to the allowed error, and methods; the longest run [s]."""

    families: dict[str, tuple[str, ...]]
    hinges: dict[str, tuple[int, ...]]
    of_error: tuple[Positive, ...]
    methods: tuple[str, ...]
    reference: Reference
    longest: Positive
    asked: tuple[Requested, ...]


@kind(timed=True)
def advice_families(case: Case, settings: AdviceFamiliesSettings) -> Iterator[Measured]:
    """Check that advice selects the cheapest family of lumping rules, against a grid of all families.

    Every scene has an allowed tip error. The grid comes from `rule_ladder`: rules, hinges, methods and tolerances;
    costs are taken from the cost list that advice uses, and measured as CPU times. The advised family may cost more
    than the cheapest only within the uncertainty of both costs.

    Yield the cost of the advised family relative to the cheapest, for each scene, and the largest of each group.
    """
    worst: dict[bool, list[float]] = {True: [], False: []}
    for aim in settings.asked:
        scene = varied_scene(aim.scene, aim.name)
        advice = fl.advise(scene, tip=f"{aim.error:.3g} m")
        true = exact(scene, settings.reference)
        yield Measured("reference, its own error / allowed error", true.own / aim.error, aim.name)
        tolerances = [part * aim.error for part in settings.of_error]
        grid = ladder(scene, settings.hinges, settings.methods, tolerances, true.tip, settings.longest)
        met = [each for each in grid if each.point.error <= aim.error]
        family = _family(settings, case, advice.scene)
        facts: Facts = {"family": family, "tip error": aim.error}
        words = "; ".join(line for line in advice.lines if "hinge" in line)
        yield Measured("advised within the allowed error", float(advice.met), aim.name, varied=facts, note=words)
        listed, note = _over_cheapest(settings, family, met, [each.listed for each in met])
        worst[aim.axial].append(listed)
        yield Measured("advised family / cheapest, listed costs", listed, aim.name, varied=facts, note=note)
        clocked, note = _over_cheapest(settings, family, met, [each.point.seconds for each in met])
        yield Measured("advised family / cheapest, CPU time", clocked, aim.name, varied=facts, note=note, timed=True)
    for axial, word in ((True, "under axial load or bent far"), (False, "others")):
        if worst[axial]:
            yield Measured(f"advised family / cheapest, listed costs, {word}", max(worst[axial]))


def _family(settings: AdviceFamiliesSettings, case: Case, scene: fl.Scene) -> str:
    rules = {link.lumping for link in scene.arm.links if link.flex != "rigid"}
    found = {family for family, members in settings.families.items() if rules & set(members)}
    if len(found) != 1:
        raise DataFileError(f"{case.path}: {scene.name}: the advised rules {sorted(rules)} belong to no single family")
    return found.pop()


def _over_cheapest(
    settings: AdviceFamiliesSettings, family: str, met: Sequence[Tried], costs: Sequence[float]
) -> tuple[float, str]:
    """Cost of a family's cheapest run relative to the cheapest run of all families, and a description of both runs."""
    order = sorted(range(len(met)), key=lambda k: costs[k])
    own = next(k for k in order if met[k].at.rule in settings.families[family])
    return costs[own] / costs[order[0]], f"{met[own]}; cheapest {met[order[0]]}."
