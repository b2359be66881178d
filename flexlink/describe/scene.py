"""Scene: an arm with gravity, initial state, drive, motion, wrench and run settings; strict TOML in and out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.describe import catalogue
from flexlink.describe.arm import Arm, Link
from flexlink.describe.methods import check_method
from flexlink.describe.rules import hinges_of
from flexlink.describe.situation import Drive, Initial, Motion, Run, Wrench, implied, whole
from flexlink.describe.spec import Spec, Vector3, decode, fields_of, meant, short
from flexlink.describe.vary import changed, parsed
from flexlink.describe.writing import said, toml_of

Array = NDArray[np.float64]


class Scene(Spec, frozen=True):
    """One arm in one situation, as plain data: `lump` cuts it, `simulate` runs it; `gravity` [m/s²] in frame 0."""

    name: str
    arm: Arm
    initial: Initial
    about: str = ""
    gravity: Vector3 = (0.0, 0.0, 9.81)  # m/s², frame 0
    drive: Drive = Drive()
    motion: tuple[Motion, ...] = ()
    wrench: Wrench = Wrench()
    run: Run = Run()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name:
            raise SceneError("name = '': must not be empty")
        links = len(self.arm.links)
        per_link: dict[str, tuple[float, ...] | None] = {
            "initial.joint_deg": self.initial.joint_deg,
            "initial.rate_deg": self.initial.rate_deg,
            "drive.torque": self.drive.torque,
            "drive.kp": self.drive.kp,
            "drive.kd": self.drive.kd,
            "drive.target_deg": self.drive.target_deg,
            **{f"drive.torques[{k}]": row for k, row in enumerate(self.drive.torques or ())},
        }
        for key, values in per_link.items():
            if values is not None and len(values) != links:
                raise SceneError(f"{key} = {short(values)}: expected one number per link, {links}")
            for k, link in enumerate(self.arm.links):
                if link.joint.locked and values and values[k] and key not in {"initial.joint_deg", "drive.target_deg"}:
                    raise SceneError(f"{key}[{k}] = {values[k]!r}: the joint of {link.name!r} is locked; only 0 fits")
        if not self.run.controlled:
            whole("initial.time", self.initial.time, "run.step", self.run.step)
            for k, time in enumerate(self.drive.times or () if self.drive.hold else ()):
                whole(f"drive.times[{k}]", time, "run.step", self.run.step)
        for k, (link, angle) in enumerate(zip(self.arm.links, self.initial.joint_deg, strict=True)):
            _check_limits(link, f"initial.joint_deg[{k}]", angle)
        moved: set[int] = set()
        for k, motion in enumerate(self.motion):
            number = self._check_motion(motion, f"motion[{k}]")
            if number in moved:
                raise SceneError(f"motion[{k}].link = {motion.link!r}: has two motions")
            moved.add(number)

    def __repr__(self) -> str:
        run = self.run
        return f"<Scene {self.name!r}: {self.arm!r}; {run.method}, step {run.step:g} s, duration {run.duration:g} s>"

    def _check_motion(self, motion: Motion, path: str) -> int:
        """Number of the link that moves."""
        try:
            number = self.arm.number(motion.link)
        except ArgumentError as error:
            raise SceneError(f"{path}.{error}") from None
        if self.arm.links[number - 1].joint.locked:
            raise SceneError(f"{path}.link = {motion.link!r}: its joint is locked; a motion needs a free joint")
        initial = self.initial
        for key, start, first, elsewhere in (
            ("angle_deg", initial.joint_deg[number - 1], motion.angle_deg[0], initial.q),
            ("rate_deg", initial.rates[number - 1], motion.rate_deg[0], initial.qd),
        ):
            if start != first and initial.time == 0 and elsewhere is None:
                raise SceneError(f"{path}.{key}[0] = {first!r}: must be the initial value, {start!r}")
        for k, angle in enumerate(motion.angle_deg):
            _check_limits(self.arm.links[number - 1], f"{path}.angle_deg[{k}]", angle)
        return number

    @property
    def tip_wrench(self) -> Array:
        """Force and moment on the tip, frame 0, shape (6,)."""
        return np.array([*self.wrench.force, *self.wrench.moment])

    def varied(self, changes: Mapping[str, object]) -> Scene:
        """This scene with other values, each at a path in the words of the TOML file.

        Parameters
        ----------
        changes
            Values by path, put in one after the other; a value replaces all that stands at its path, and None leaves
            the key out, so that its default holds. Paths lead through tables by their keys (`run.step`), through
            materials and sections by name, through links by name, number from 1 or `*`, and so through motions and
            lists of one number per link (`initial.joint_deg.upper`); a name with a dot stands in quotes. `*` stands for
            all links on which the key has an effect: `flex`, `segments`, `lumping` and `damping` of those that are
            flexible, `material` and `section` of those that have some, friction, armature, rates and torques of those
            whose joint is free. A tolerance takes the place of fixed steps, and a step that of a tolerance.

        Returns
        -------
        Scene
            Checked like one that is read from a file, with the rules and the method that it names.

        Raises
        ------
        SceneError
            A path that leads nowhere, or a value that does not fit; the message names it and what is allowed.
        ArgumentError
            `changes` is no dict of values by path.

        Examples
        --------
        >>> fine = scene.varied({"link.*.segments": 9, "link.*.lumping": "gauss", "run.step": 1e-5})
        >>> soft = scene.varied({"material.aluminium.young": 35e9, "initial.joint_deg.upper": -45.0})
        >>> free = scene.varied({"motion": (), "drive": Drive(kind="constant", torque=(0.0, 5.0, 0.0))})
        """
        if isinstance(changes, Mapping):
            changes = {**implied(self.run, changes), **changes}
        varied = scene_from(changed(self._document(), FIELDS, changes))
        check_named(varied)
        return varied

    def to_toml(self) -> str:
        """This scene as a TOML document that `load_scene` reads back equal; defaults are left out, but for gravity."""
        document: dict[str, Any] = said(self, always=frozenset({"gravity"}))
        document |= document.pop("arm")
        return toml_of({key: document[key] for key in ORDER if key in document})

    def _document(self) -> dict[str, Any]:
        """What a TOML parser returns of this scene, with all defaults written out."""
        document: dict[str, Any] = parsed(self)
        document |= document.pop("arm")
        return document


def _check_limits(link: Link, key: str, angle: float) -> None:
    limits = link.joint.limits_deg
    if limits is not None and not limits[0] <= angle <= limits[1]:
        raise SceneError(f"{key} = {angle!r}: outside limits_deg = {list(limits)} of the joint of {link.name!r}")


def load_scene(path: str | Path) -> Scene:
    """Read a scene file.

    Parameters
    ----------
    path
        A TOML file in the format of the scenes in `models/`. Files that it names (`method`, `lumping`) are sought
        from its own folder.

    Returns
    -------
    Scene
        As the file says.

    Raises
    ------
    ArgumentError
        `path` is no path.
    SceneError
        The message names the file, the key path, the value and what is allowed.
    DataFileError
        The file of a rule or method that the scene names is not valid.
    """
    path = catalogue.given_path("path", path)
    raw = catalogue.read_toml(path)
    _find_beside(path, raw.get("run"), "method")
    for link in raw["link"] if isinstance(raw.get("link"), list) else ():
        _find_beside(path, link, "lumping")
    try:
        scene = scene_from(raw)
        check_named(scene)
    except (SceneError, DataFileError) as error:
        raise type(error)(f"{path}: {error}") from None
    return scene


def _find_beside(scene: Path, table: object, key: str) -> None:
    """A rule's or method's own file is named from the folder of the scene, wherever the program was started."""
    if isinstance(table, dict) and isinstance(table.get(key), str):
        table[key] = catalogue.absolute(table[key], scene.parent)


def check_named(scene: Scene) -> None:
    """What a scene names by name or file is there, and fits it: lumping rules and method.

    Raises
    ------
    SceneError
        The message names the key path, the value and what is allowed.
    DataFileError
        The file of a rule or method is not valid.
    """
    hinges_of(scene.arm)
    check_method(scene.run)


def scene_from(raw: dict[str, Any]) -> Scene:
    """The scene of a parsed file.

    Raises
    ------
    SceneError
        The message names the key path, the value and what is allowed.
    """
    for key, value in raw.items():
        if key not in FIELDS:
            allowed = ", ".join(FIELDS) + meant(key, FIELDS)
            raise SceneError(f"{key} = {short(value)}: unknown key; allowed are {allowed}")
    for key, field in (_OWN | _OF_ARM).items():
        if field.required and key not in raw:
            raise SceneError(f"{key}: missing; this key is required")
    values = {key: decode(value, FIELDS[key], key) for key, value in raw.items()}
    parts = {_OF_ARM[key].name: value for key, value in values.items() if key in _OF_ARM}
    return Scene(arm=Arm(**parts), **{key: value for key, value in values.items() if key in _OWN})


_OWN = {field.encode_name: field for field in fields_of(Scene) if field.name != "arm"}
_OF_ARM = {field.encode_name: field for field in fields_of(Arm)}
ORDER = (
    "name", "about", "gravity", "material", "section", "link", "tip", "initial", "drive", "motion", "wrench", "run",
)  # fmt: skip
"""Of the tables of a file that `to_toml` writes."""
FIELDS: dict[str, Any] = {key: field.type for key, field in (_OWN | _OF_ARM).items()}
"""What stands at each key of a scene's file, which is flat: the arm's keys stand beside the scene's own."""
