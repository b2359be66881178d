"""A case of the study: scenes, a kind of measurement, its settings, and the limit of each quantity with its reason."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

import msgspec

from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.data import documents
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.describe.spec import Positive, Spec, decode
from validation.facts import Facts
from validation.store import Bound

HERE = Path(__file__).parent
CASES = HERE / "cases"
MODELS = HERE.parent / "models"
STUDY_SCENES = HERE / "scenes"


CLAIM = "claim"  # the quantity that judges it, and the fact that its rows carry

ALL = ("*",)
"""Pattern of all cases, those that run by their name only included."""


class Quantity(Spec, frozen=True):
    """A measured quantity: it passes if its value is `bound` the tolerance; without a tolerance there is no verdict.

    `reason` says why the tolerance is what it is; of a quantity without one, what it is shown for, if that needs words.
    `given_up` says why a tolerance that was once set is not kept, `widened` why it is wider than the published one.
    `rows` is how often it is measured, all scenes and engines together; "by machine" where that depends on what is
    installed or on how many runs end in time. What is timed is not counted.
    """

    metric: str
    reason: str = ""
    given_up: str = ""
    widened: str = ""
    rows: Annotated[int, msgspec.Meta(ge=1)] | Literal["by machine"] = 1
    unit: str = "1"
    tolerance: float | None = None
    bound: Bound = "at most"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tolerance is not None and not self.reason:
            raise SceneError("reason: missing; a tolerance needs one", id="missing-key")


class Sheet(Spec, frozen=True):
    """What any code's answer to a benchmark is judged by.

    How its error is defined, which error is accepted (relative, or of a motion in its unit), and the values' unit.
    """

    error: str
    accepted: Positive
    unit: str


class Case(Spec, frozen=True):
    """One TOML file in `cases/`; its name is the file's.

    `parts` names a list of the settings: each of its values is then a case of its own, called NAME-VALUE, so that a
    long study is stored, and goes on after it was stopped, value by value. The name of the file means all of them.

    The title says what is measured, never what comes out: a case passes when the numbers are as expected, also where
    they refute somebody's `claim`, which its quantity of that name judges in words.
    """

    name: str
    kind: str
    title: str
    about: str
    quantity: dict[str, Quantity]
    scenes: tuple[str, ...] = ()  # names of files in models/, also globs, or validation/scenes/
    settings: dict[str, Any] = msgspec.field(default_factory=dict)  # decoded by the kind
    by_name: bool = False  # runs only when it is asked for: it takes long
    needs: str = (
        ""  # path from the checkout of data that are no part of it; without them the case is left out, and told
    )
    claim: str = ""
    sheet: Sheet | None = None  # of a benchmark that other codes can be judged by, too
    parts: str = ""
    whole: str = ""  # of a part the name of its file

    @property
    def part(self) -> str:
        """The value of which it is the part; "" of a whole case."""
        return self.name.removeprefix(f"{self.whole}-") if self.whole else ""

    @property
    def has_data(self) -> bool:
        """Whether the data that it needs are there."""
        return not self.needs or (HERE.parent / self.needs).exists()

    @property
    def without_data(self) -> str:
        """Why it is left out where the data are missing."""
        return f"needs {self.needs}, which is not here"

    def divided(self) -> list[Case]:
        """Its parts, each with the common quantities and its own, "PART, …"; the case itself if it has none."""
        if not self.parts:
            return [self]
        values = [str(value) for value in self.settings[self.parts]]
        return [self._of(value, {other for other in values if other != value}) for value in values]

    def _of(self, value: str, others: set[str]) -> Case:
        return msgspec.structs.replace(
            self, name=f"{self.name}-{value}", whole=self.name, parts="", title=f"{self.title}: {value}",
            settings=self.settings | {self.parts: [value]},
            quantity={name: each for name, each in self.quantity.items() if name.split(", ")[0] not in others},
        )  # fmt: skip

    def demands(self, quantity: str) -> bool:
        """Whether the case must measure this quantity; a part must measure only quantities that carry its name."""
        return not self.part or quantity.startswith(f"{self.part}, ")

    def is_meant_by(self, pattern: str) -> bool:
        """Whether the name, the kind, or the words either begins with match a glob pattern; of `by_name` its name."""
        names = (self.name, self.whole) if self.whole else (self.name,)
        if self.by_name:
            return any(fnmatchcase(name, pattern) for name in names)
        return any(fnmatchcase(text, p) for text in (*names, self.kind) for p in (pattern, f"{pattern}_*"))

    def load_scenes(self) -> list[Scene]:
        """The scenes, in order."""
        return [load_scene(path) for path in self.scene_files]

    def varied_scene(self, name: str, change: Mapping[str, Any]) -> Scene:
        """The scene of that name, which a key of the settings' table `scene` is, varied."""
        scenes = {scene.name: scene for scene in self.load_scenes()}
        return require_one_of(f"{self.path}: settings.scene", name, scenes).varied(change)

    @property
    def path(self) -> Path:
        """The case's file."""
        return CASES / f"{self.whole or self.name}.toml"

    @property
    def scene_files(self) -> list[Path]:
        """The scenes' files; a name with `*` means all of models/ that it matches."""
        files: list[Path] = []
        for name in self.scenes:
            files += sorted(MODELS.glob(f"{name}.toml")) if "*" in name else [scene_file(name)]
        return files


def scene_file(name: str) -> Path:
    """The file of a scene: one of the study's own, or of models/."""
    own = STUDY_SCENES / f"{name}.toml"
    return own if own.is_file() else MODELS / f"{name}.toml"


NOTHING_VARIED: Facts = MappingProxyType({})


class Measured(NamedTuple):
    """One measured number, before it is judged."""

    quantity: str
    value: float
    scene: str = ""
    engine: str = "native"
    varied: Facts = NOTHING_VARIED  # what was varied: names of `validation.facts`
    scale: float = 1.0  # the case's tolerance is in units of this, where the limit follows from the physics of the run
    note: str = ""  # computed words on this value
    timed: bool = False  # a matter of speed, not of correctness


def load_case(path: Path) -> Case:
    """Read one case file.

    Raises
    ------
    DataFileError
        The message names the file, the key path, the value and what is allowed.
    """
    return _read(path, path.read_bytes() if path.is_file() else b"")


@functools.lru_cache(maxsize=512)
def _read(path: Path, content: bytes) -> Case:
    """The case of a file with that content: a study asks for all of them again and again."""
    try:
        raw = documents.read_toml(path)
        for key in ("name", "whole"):
            if key in raw:
                raise SceneError(
                    f"{key} = {raw[key]!r}: unknown key; the name of a case is its file's", id="unknown-key"
                )
        case: Case = decode(raw | {"name": path.stem}, Case)
        if case.parts and not isinstance(case.settings.get(case.parts), list):
            raise SceneError(f"parts = {case.parts!r}: not a list of the settings", id="unknown-name")
        return case
    except SceneError as error:
        raise DataFileError(f"{path}: {error}") from None


def load_cases(*wanted: str) -> list[Case]:
    """The cases that any of `wanted` means, by name; if there are none, all but those that run `by_name` only.

    `wanted` are names or kinds, or the words they begin with ("speed" means every speed_…), or globs of them.

    Raises
    ------
    DataFileError
        A file is not a valid case.
    ArgumentError
        One of `wanted` means none.
    """
    cases = [part for path in sorted(CASES.glob("*.toml")) for part in load_case(path).divided()]
    for pattern in wanted:
        if not any(case.is_meant_by(pattern) for case in cases):
            known = ", ".join(case.name for case in cases)
            raise ArgumentError(f"case = {pattern!r}: no such case; there are {known}", id="unknown-name")
    chosen = [case for case in cases if any(map(case.is_meant_by, wanted))] if wanted else cases
    left = [case for case in chosen if case.has_data and (wanted or not case.by_name)]
    if chosen and not left:
        raise ArgumentError(f"case = {chosen[0].name!r}: {chosen[0].without_data}")
    return left


def cases_without_data(*wanted: str) -> list[Case]:
    """The cases that `load_cases` leaves out because the data that they need are not here."""
    cases = [part for path in sorted(CASES.glob("*.toml")) for part in load_case(path).divided()]
    meant = [case for case in cases if any(map(case.is_meant_by, wanted)) or not (wanted or case.by_name)]
    return [case for case in meant if not case.has_data]
