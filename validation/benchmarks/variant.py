"""A benchmark scene with changes, for any lumping rule and number of hinges."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec

from flexlink.chain.arguments import choice
from flexlink.common.errors import SceneError
from flexlink.describe import catalogue
from flexlink.describe.scene import Scene, check_named, scene_from
from flexlink.describe.spec import Spec
from validation.case import Case
from validation.facts import Facts


class Rule(Spec, frozen=True):
    """A lumping rule and its number of hinges a link."""

    rule: str
    hinges: int

    @property
    def facts(self) -> Facts:
        """As what was varied."""
        return {"rule": self.rule, "hinges": self.hinges}

    def __str__(self) -> str:
        return f"{self.rule}, {self.hinges} hinges"


class Variant(Spec, frozen=True):
    """One situation of a benchmark: a scene, what is changed in its file, and where its reference values stand.

    `change` is laid over the file's tables; lists of tables are matched one by one. `keys` lead to the values in the
    reference file. Joints of the links in `hold` stay where they are.
    """

    name: str = ""
    keys: tuple[str, ...] = ()
    scene: str = ""  # default: the case's first
    change: dict[str, Any] = msgspec.field(default_factory=dict)
    hold: tuple[str, ...] = ()

    def build(self, case: Case, wanted: Rule) -> Scene:
        """The scene with every flexible link cut by a rule.

        Raises
        ------
        SceneError
            The changed file is not a scene, or the rule does not exist for so many hinges.
        ArgumentError
            `scene` is none of the case's.
        """
        paths = {path.stem: path for path in case.scene_files}
        path = choice(f"{case.path}: variant.scene", self.scene or case.scenes[0], paths)
        raw = overlay(catalogue.read_toml(path), self.change)
        for link in raw["link"]:
            if link.get("flex", "rigid") != "rigid":
                link |= {"lumping": wanted.rule, "segments": wanted.hinges + 1}
        scene = scene_from(raw)
        check_named(scene)
        return scene


def overlay(below: Any, above: Any) -> Any:
    """`above` laid over `below`: tables key by key, lists of tables one by one, all else replaced."""
    if isinstance(below, dict) and isinstance(above, dict):
        return below | {key: overlay(below.get(key), value) for key, value in above.items()}
    if isinstance(below, list) and isinstance(above, list) and above and isinstance(above[0], dict):
        pairs = zip(below, above, strict=False)
        return [overlay(*pair) for pair in pairs] + below[len(above) :]
    return above


def grid(rules: dict[str, tuple[int, ...]]) -> Iterator[Rule]:
    """Every rule with every number of hinges."""
    for rule, counts in rules.items():
        for hinges in counts:
            yield Rule(rule=rule, hinges=hinges)


def existing(case: Case, variant: Variant, wanted: Rule) -> Scene | None:
    """The scene, or None where the rule does not exist for so many hinges."""
    try:
        return variant.build(case, wanted)
    except SceneError as error:
        if "segments" in str(error):
            return None
        raise
