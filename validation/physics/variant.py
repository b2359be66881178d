"""Variants of a benchmark scene, with any lumping rule and number of hinges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import ArgumentError
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import Spec
from validation.case import Case
from validation.facts import Facts


class Rule(Spec, frozen=True):
    """A lumping rule and its number of hinges per link."""

    rule: str
    hinges: int

    @property
    def facts(self) -> Facts:
        """The rule as facts of a measurement."""
        return {"rule": self.rule, "hinges": self.hinges}

    def __str__(self) -> str:
        return f"{self.rule}, {self.hinges} hinges"


class Variant(Spec, frozen=True):
    """One configuration of a benchmark: a scene, its changes, and the location of its reference values.

    `change` is the argument of `Scene.varied`. `keys` lead to the values in the reference file. The joints of the links
    in `hold` are fixed.
    """

    name: str = ""
    keys: tuple[str, ...] = ()
    scene: str = ""  # default: the case's first scene
    change: dict[str, Any] = msgspec.field(default_factory=dict)
    hold: tuple[str, ...] = ()

    def build(self, case: Case, wanted: Rule) -> Scene:
        """The scene with every flexible link lumped by a rule.

        Raises
        ------
        SceneError
            The change does not fit, or the rule does not exist for this number of hinges.
        ArgumentError
            `scene` is not a scene of the case.
        """
        paths = {path.stem: path for path in case.scene_files}
        path = require_one_of(f"{case.path}: variant.scene", self.scene or case.scenes[0], paths)
        scene = load_scene(path).varied(self.change)
        if all(link.flex == "rigid" for link in scene.arm.links):
            return scene
        return scene.varied({"link.*.lumping": wanted.rule, "link.*.segments": wanted.hinges + 1})


def existing(
    case: Case, rules: Mapping[str, Sequence[int]], variants: Sequence[Variant] = (Variant(),)
) -> Iterator[tuple[Rule, list[Scene]]]:
    """Yield each rule and each valid number of hinges, with the scenes of all variants lumped by it."""
    for name, counts in rules.items():
        rule = lumping_rule(name)
        for hinges in counts:
            try:
                rule.hinges(hinges)
            except ArgumentError:
                continue
            wanted = Rule(rule=name, hinges=hinges)
            yield wanted, [variant.build(case, wanted) for variant in variants]
