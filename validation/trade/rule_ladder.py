"""Time for a given tip error against the continuous beam, by lumping rule, hinge count, method and tolerance.

The reference is a finer chain with a separate method and tolerance; its distance to a coarser chain of the same rule
bounds its error. The error of a run is the largest distance of its tip from the reference at the samples [m], including
the error of the steps.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import Positive, Spec
from flexlink.motion.evaluation_cost import run_cost
from flexlink.motion.simulate import simulate
from flexlink.results.tip_motion import largest_distance
from validation.physics.variant import Rule
from validation.trade.contestants import TooDearError
from validation.trade.scenes import seen
from validation.trade.with_flexlink import Flexlink
from validation.trade.work_precision import Point


class Reference(Spec, frozen=True):
    """Settings of the reference tip; a run with `checked` hinges estimates its error."""

    rule: str
    hinges: int
    checked: int
    method: str
    tolerance: Positive


class Exact(NamedTuple):
    """Tip at the samples, shape (samples, 3), and its distance to a coarser reference [m]."""

    tip: Array
    own: float


class Tried(NamedTuple):
    """A run: its chain, method, tolerance, measured time and error [m]; `listed` is its cost by the cost list [s]."""

    at: Rule
    method: str
    point: Point  # setting: the tolerance
    listed: float

    def __str__(self) -> str:
        return f"{self.at}, {self.method} {self.point.setting:g}"


def cut(scene: Scene, at: Rule) -> Scene:
    """The scene with this rule and number of hinges in its flexible links."""
    bent = [link.name for link in scene.arm.links if link.flex != "rigid"]
    changes = {f"link.{name}.lumping": at.rule for name in bent} | {
        f"link.{name}.segments": at.hinges + 1 for name in bent
    }
    return scene.varied(changes)


def exact(scene: Scene, how: Reference) -> Exact:
    """The reference of a scene."""
    tips = []
    for hinges in (how.hinges, how.checked):
        finer = cut(scene, Rule(rule=how.rule, hinges=hinges))
        tips.append(simulate(finer.varied({"run.method": how.method, "run.tolerance": how.tolerance})).tip)
    return Exact(tips[0], largest_distance(*tips))


def ladder(
    scene: Scene,
    rules: Mapping[str, Sequence[int]],
    methods: Sequence[str],
    tolerances: Sequence[float],
    true: Array,
    longest: float,
) -> Iterator[Tried]:
    """Yield every run of the grid that takes at most `longest` [s]; hinge numbers invalid for a rule are skipped.

    Tolerances become finer until the lumping error dominates, that is, the last three errors differ by under a tenth.
    """
    for name, method in itertools.product(rules, methods):
        rule, warm = lumping_rule(name), False
        for hinges in rules[name]:
            try:
                rule.hinges(hinges)
            except ArgumentError:
                continue
            at = Rule(rule=name, hinges=hinges)
            chained = cut(scene, at)
            if not warm:  # compile the kernels first
                with contextlib.suppress(FlexlinkError):
                    warm = bool(Flexlink(chained).run(method, 1e-3))
            yield from _of_chain(chained, at, method, tolerances, true, longest)


def _of_chain(
    scene: Scene, at: Rule, method: str, tolerances: Sequence[float], true: Array, longest: float
) -> Iterator[Tried]:
    ours, errors = Flexlink(scene, longest), list[float]()
    for tolerance in sorted(tolerances, reverse=True):
        try:
            run = ours.run(method, tolerance)
        except TooDearError:
            return
        except FlexlinkError:
            continue
        error = largest_distance(seen(ours.chain, run.q).tip, true)
        listed = run_cost(ours.chain, method, run.evaluations)
        yield Tried(at, method, Point(tolerance, error, run.seconds, evaluations=run.evaluations), listed)
        errors.append(error)
        if len(errors) > 2 and max(errors[-3:]) < 1.1 * min(errors[-3:]):
            return
