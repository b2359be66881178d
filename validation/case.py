"""A case of the study: scenes, a kind of measurement, its settings, and a limit with a reason for each quantity."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

import msgspec

from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.wording import did_you_mean
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


CLAIM = "claim"  # name of the quantity that tests a claim, and of the setting with the claim's text in its rows

ALL = ("*",)
"""Pattern that matches all cases, including those that run only if named."""


class Quantity(Spec, frozen=True):
    """A measured quantity, which passes if its value is at most or at least (`bound`) the tolerance.

    Without a tolerance there is no verdict. `reason` justifies the tolerance, or states why the quantity is shown.
    `given_up` states why an earlier tolerance was abandoned, `widened` why it is wider than the published one. `rows`
    is the number of measurements over all scenes and engines, or "by machine" if that number depends on the installed
    packages or on how many runs finish in time. Timed quantities are not counted.
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
    """Definition of a benchmark's error in the study's data sheets; the accepted error, relative or a distance [m]."""

    error: str
    accepted: Positive


class Case(Spec, frozen=True):
    """One TOML file in `cases/`, after which the case is named.

    `parts` names a list in the settings: each value becomes a separate case NAME-VALUE. A long study is then stored
    value by value, and can be continued after a stop. The name of the file selects all parts.

    The title states what is measured, never the outcome. A case passes if the numbers are as expected, even if they
    refute a published claim; the quantity named `claim` checks that claim.
    """

    name: str
    kind: str
    title: str
    about: str
    quantity: dict[str, Quantity]
    scenes: tuple[str, ...] = ()  # file names or globs, in models/ or validation/scenes/
    settings: dict[str, Any] = msgspec.field(default_factory=dict)  # decoded by the kind
    by_name: bool = False  # runs only if named: it takes long
    claim: str = ""
    sheet: Sheet | None = None  # definition of the error, if the case has a data sheet
    parts: str = ""
    whole: str = ""  # for a part of a case: name of the case's file

    @property
    def part(self) -> str:
        """The value that this part measures; "" for an undivided case."""
        return self.name.removeprefix(f"{self.whole}-") if self.whole else ""

    def divided(self) -> list[Case]:
        """The parts, each with the common quantities and those named "PART, …"; an undivided case returns itself."""
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
        """Whether the case must measure this quantity; for a part, only quantities that begin with its name."""
        return not self.part or quantity.startswith(f"{self.part}, ")

    def has_separate_limit(self, scene: str, quantity: str) -> bool:
        """Whether a separate quantity of this scene replaces the limit for all scenes."""
        own = self.quantity.get(f"{scene}, {quantity}")
        return own is not None and bool(own.given_up)

    def is_meant_by(self, pattern: str) -> bool:
        """Whether a glob pattern matches the name or kind, or their first words; `by_name` cases match by name only."""
        names = (self.name, self.whole) if self.whole else (self.name,)
        if self.by_name:
            return any(fnmatchcase(name, pattern) for name in names)
        return any(fnmatchcase(text, p) for text in (*names, self.kind) for p in (pattern, f"{pattern}_*"))

    def load_scenes(self) -> list[Scene]:
        """The scenes, in order."""
        return [load_scene(path) for path in self.scene_files]

    def varied_scene(self, name: str, change: Mapping[str, Any]) -> Scene:
        """The scene of that name with a change; the name is a key of the table `settings.scene`."""
        scenes = {scene.name: scene for scene in self.load_scenes()}
        return require_one_of(f"{self.path}: settings.scene", name, scenes).varied(change)

    @property
    def path(self) -> Path:
        """The case's file."""
        return CASES / f"{self.whole or self.name}.toml"

    @property
    def scene_files(self) -> list[Path]:
        """The scenes' files; a name with `*` means every match in models/."""
        files: list[Path] = []
        for name in self.scenes:
            files += sorted(MODELS.glob(f"{name}.toml")) if "*" in name else [scene_file(name)]
        return files


def scene_file(name: str) -> Path:
    """The file of a scene, from the study's scenes or from models/."""
    own = STUDY_SCENES / f"{name}.toml"
    return own if own.is_file() else MODELS / f"{name}.toml"


def module_of(kind: str) -> str:
    """The module that defines a kind: a generator of its name, or `run` in a file of its name."""
    named = re.compile(rf"^@kind.*\ndef {kind}\(", re.MULTILINE)
    files = [path for path in (HERE / "kinds").glob("*.py") if named.search(path.read_text(encoding="utf-8"))]
    # not one string, in which dependencies would find all kinds
    return ".".join(("validation", "kinds", files[0].stem if files else kind))


NOTHING_VARIED: Facts = MappingProxyType({})


class Measured(NamedTuple):
    """One measured number, before it is compared with its limit."""

    quantity: str
    value: float
    scene: str = ""
    engine: str = "native"
    varied: Facts = NOTHING_VARIED  # varied conditions, by their names in `validation.facts`
    scale: float = 1.0  # factor on the case's tolerance, for a limit that is computed from the run
    note: str = ""  # computed remark on this value
    timed: bool = False  # whether it measures speed, not correctness


def load_case(path: Path) -> Case:
    """Read one case file.

    Raises
    ------
    DataFileError
        The message names the file, the key path, the value and the allowed values.
    """
    return _read(path, path.read_bytes() if path.is_file() else b"")


@functools.lru_cache(maxsize=512)
def _read(path: Path, content: bytes) -> Case:
    """Read the case from a file with that content; cached, since a study needs all cases repeatedly."""
    try:
        raw = documents.read_toml(path)
        for key in ("name", "whole"):
            if key in raw:
                raise SceneError(f"{key} = {raw[key]!r}: unknown key; a case is named after its file", id="unknown-key")
        case: Case = decode(raw | {"name": path.stem}, Case)
        if case.parts and not isinstance(case.settings.get(case.parts), list):
            raise SceneError(f"parts = {case.parts!r}: is not a list in the settings", id="wrong-type")
        return case
    except SceneError as error:
        raise DataFileError(f"{path}: {error}") from None


def load_cases(*wanted: str) -> list[Case]:
    """Load the cases that match any of `wanted`, sorted by name; by default, all except those that run only if named.

    `wanted` are names, kinds, their first words ("speed" means every speed_…), or globs.

    Raises
    ------
    DataFileError
        A file is not a valid case.
    ArgumentError
        One of `wanted` matches no case.
    """
    cases = [part for path in sorted(CASES.glob("*.toml")) for part in load_case(path).divided()]
    for pattern in wanted:
        if not any(case.is_meant_by(pattern) for case in cases):
            names = [case.name for case in cases]
            near = did_you_mean(pattern, names) or f"; available: {', '.join(names)}"
            raise ArgumentError(f"case = {pattern!r}: no such case{near}", id="unknown-name")
    return [case for case in cases if (any(map(case.is_meant_by, wanted)) if wanted else not case.by_name)]
