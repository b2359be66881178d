"""Check that advice selects the cheapest family of lumping rules, against a grid of all families.

Every scene has an allowed tip error. The grid comes from `rule_ladder`: rules, hinges, methods and tolerances; costs
are taken from the cost list that advice uses, and measured as CPU times. The advised family may cost more than the
cheapest only within the uncertainty of both costs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import flexlink as fl
from flexlink.common.errors import DataFileError
from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.trade.rule_ladder import Reference, Tried, exact, ladder
from validation.trade.scenes import Varied, varied_scene

TIMED = True


class Requested(Spec, frozen=True):
    """A scene and its allowed tip error [m]; `axial` marks scenes for which coupled springs should be cheapest."""

    name: str
    scene: Varied
    error: Positive
    axial: bool = False


class Settings(Spec, frozen=True):
    """Scenes; rules by family, hinges, tolerances relative to the allowed error, and methods; the longest run [s]."""

    families: dict[str, tuple[str, ...]]
    hinges: dict[str, tuple[int, ...]]
    of_error: tuple[Positive, ...]
    methods: tuple[str, ...]
    reference: Reference
    longest: Positive
    asked: tuple[Requested, ...]


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Yield the cost of the advised family relative to the cheapest, for each scene, and the largest of each group."""
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


def _family(settings: Settings, case: Case, scene: fl.Scene) -> str:
    rules = {link.lumping for link in scene.arm.links if link.flex != "rigid"}
    found = {family for family, members in settings.families.items() if rules & set(members)}
    if len(found) != 1:
        raise DataFileError(f"{case.path}: {scene.name}: the advised rules {sorted(rules)} belong to no single family")
    return found.pop()


def _over_cheapest(settings: Settings, family: str, met: Sequence[Tried], costs: Sequence[float]) -> tuple[float, str]:
    """Cost of a family's cheapest run relative to the cheapest run of all families, and a description of both runs."""
    order = sorted(range(len(met)), key=lambda k: costs[k])
    own = next(k for k in order if met[k].at.rule in settings.families[family])
    return costs[own] / costs[order[0]], f"{met[own]}; cheapest {met[order[0]]}."
