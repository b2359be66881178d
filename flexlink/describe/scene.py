"""Scene: an arm with gravity, initial state, drive, motion, wrench and run settings; strict TOML in and out."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.memo import Memo
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.output import write_text
from flexlink.common.types import Array
from flexlink.describe import data_files
from flexlink.describe.arm import Arm, Link
from flexlink.describe.conditions import (
    Drive,
    InitialState,
    PrescribedMotion,
    RunSettings,
    Wrench,
    check_method,
    implied,
    whole,
)
from flexlink.describe.hinges import hinges_of
from flexlink.describe.mistakes import check_all, mistakes, raise_together
from flexlink.describe.reference import refuse_beyond
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.spec import (
    Spec,
    Vector3,
    build_validated,
    check_keys,
    decode,
    fields_of,
    key_mistakes,
    link_key,
    truncated,
)
from flexlink.describe.vary import apply_changes, get_in, to_document, top_level_keys, values_at
from flexlink.describe.writing import toml_of, without_defaults


class Scene(Spec, frozen=True):
    """One arm in one situation, as plain data: `lump` cuts it, `simulate` runs it; `gravity` [m/s²] in frame 0.

    Examples
    --------
    >>> start = fl.InitialState(joint_deg=(30.0, -60.0))
    >>> falling = fl.Scene(name="two_links", arm=arm, gravity=(0.0, -9.81, 0.0), initial=start)
    >>> heavier = falling.varied({"tip.mass": 5.0, "link.*.segments": 5})
    >>> print(heavier.arm.tip.mass, fl.lump(heavier).n)
    5.0 10
    """

    name: str
    """Name of the scene; files written from it are called so."""
    arm: Arm
    """The arm; in a file its keys `link`, `material`, `section`, `tip`, `base` stand at the top."""
    initial: InitialState = InitialState()
    """State at the start. Default: all joints at zero, at rest."""
    about: str = ""
    """A sentence on what the scene shows."""
    gravity: Vector3 = (0.0, 0.0, 9.81)
    """Acceleration of gravity in frame 0 [m/s²]; [0, 0, 9.81] has Z down, [0, 0, -9.81] Z up."""
    drive: Drive = Drive()
    """What drives the joints."""
    motion: tuple[PrescribedMotion, ...] = ()
    """Motions of joints that are prescribed, `[[motion]]` in a file."""
    wrench: Wrench = Wrench()
    """Force and moment on the tip."""
    run: RunSettings = RunSettings()
    """How to integrate."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name:
            raise SceneError("name = '': must not be empty")
        said = "initial.joint_deg" if self.initial.joint_deg else "the default initial.joint_deg"
        if not self.initial.joint_deg:
            self._put_joints_at_zero()
        raise_together(self._wrong_lists())  # on whose lengths all else counts
        checks = [self._check_rate, lambda: self._check_limits(said), self._check_reference, self._check_motions]
        check_all(checks if self.run.controlled else [self._check_grid, *checks])

    def _wrong_lists(self) -> Iterator[str]:
        """Lists of another length than the arm has links, and numbers of joints that are locked."""
        links = len(self.arm.links)
        per_link: dict[str, tuple[float, ...] | None] = {
            "initial.joint_deg": self.initial.joint_deg,
            "initial.rate_deg": self.initial.rate_deg,
            "drive.torque": self.drive.torque,
            "drive.kp": self.drive.kp,
            "drive.kd": self.drive.kd,
            "drive.target_deg": self.drive.target_deg,
            "drive.effort": self.drive.effort,
            **{f"drive.torques[{k}]": row for k, row in enumerate(self.drive.torques or ())},
        }
        of_locked_joints_too = {"initial.joint_deg", "drive.target_deg", "drive.effort"}
        for key, values in per_link.items():
            if values is not None and len(values) != links:
                yield f"{key} = {truncated(values)}: expected one number per link, {links}"
                continue
            for k, link in enumerate(self.arm.links):
                if link.joint.locked and values and values[k] and key not in of_locked_joints_too:
                    where = self.arm.path(k + 1, key)
                    yield f"{where} = {values[k]!r}: the joint of {link.name!r} is locked; only 0 fits"

    def _check_limits(self, said: str) -> None:
        """Joints start within their limits."""
        for k, (link, angle) in enumerate(zip(self.arm.links, self.initial.joint_deg, strict=True)):
            outside = _outside_limits(link, angle)
            if outside and (self.initial.q is None or link.joint.locked):
                raise SceneError(f"{self.arm.path(k + 1, said)} = {outside}")

    def __repr__(self) -> str:
        run = self.run
        return f"<Scene {self.name!r}: {self.arm!r}; {run.in_words}>"

    def _repr_html_(self) -> str:
        heads = ("link", "flex", "segments", "length [m]", "material", "section")
        rows = [
            (k.name, k.flex, "" if k.flex == "rigid" else k.segments, k.length, k.material or "", k.section or "")
            for k in self.arm.links
        ]
        run = self.run
        return html_table(f"{self.name}: {run.in_words}", heads, rows)

    def plot(self) -> Any:
        """Draw the arm where the scene starts, from the side and, if it is not in a plane, from above.

        Returns a matplotlib Figure, which a notebook shows once.

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.
        SceneError, ConvergenceError
            As in `initial_state`.

        Examples
        --------
        >>> picture = scene.plot()
        >>> picture.savefig("two_links.png")
        """
        return drawing_module("scene_report.arm_picture").plot_scene(self)

    def _check_motions(self) -> None:
        """Each link moves by one motion, and is not driven by gains."""
        moved: set[int] = set()
        for motion in self.motion:
            number = self._check_motion(motion)
            if number in moved:
                raise SceneError(f"motion.{motion.link}: the second motion of this link; give one")
            moved.add(number)
            for name in ("kp", "kd"):
                gains = getattr(self.drive, name)
                if gains is not None and gains[number - 1]:
                    gain = f"{self.arm.path(number, f'drive.{name}')} = {gains[number - 1]!r}"
                    raise SceneError(f"{gain}: the motion of {motion.link!r} is prescribed; only 0 fits")

    def _check_grid(self) -> None:
        """Fixed steps end where the run starts, and where a held row gives way to the next."""
        whole("initial.time", self.initial.time, self.run.said("step", "run."), self.run.fixed_step)
        for name, table in (("drive", self.drive), ("wrench", self.wrench)):
            for k, time in enumerate(table.times or () if table.hold else ()):
                whole(f"{name}.times[{k}]", time, self.run.said("step", "run."), self.run.fixed_step)

    def _put_joints_at_zero(self) -> None:
        """Where nothing else is said; but of a whole state nobody has said where a reference starts."""
        if self.initial.q is not None and self.drive.reference is not None and self.drive.reference.from_initial:
            raise SceneError("drive.reference.from_deg: missing; initial.joint_deg, its default, is not given")
        joint_deg = (0.0,) * len(self.arm.links)
        msgspec.structs.force_setattr(self, "initial", replace(self.initial, joint_deg=joint_deg))

    def _check_motion(self, motion: PrescribedMotion) -> int:
        """Number of the link that moves."""
        path = f"motion.{link_key([str(motion.link)], 0)}"
        try:
            number = self.arm.number(motion.link)
        except ArgumentError as error:
            raise SceneError(f"{path}.{error}") from None
        if self.arm.links[number - 1].joint.locked:
            raise SceneError(f"{path}: its joint is locked; a motion needs a free joint")
        initial = self.initial
        for key, start, first, elsewhere in (
            ("angle_deg", initial.joint_deg[number - 1], motion.angle_deg[0], initial.q),
            ("rate_deg", initial.rates[number - 1], motion.rate_deg[0], initial.qd),
        ):
            if start != first and initial.time == 0 and elsewhere is None:
                raise SceneError(f"{path}.{key}[0] = {first!r}: must be the initial value, {start!r}")
        for k, angle in enumerate(motion.angle_deg):
            if outside := _outside_limits(self.arm.links[number - 1], angle):
                raise SceneError(f"{path}.angle_deg[{k}] = {outside}")
        return number

    def _check_rate(self) -> None:
        """A law is asked at ends of steps, at the start of a run, and at every sample or as many samples apart."""
        rate, run = self.drive.rate, self.run
        if rate is None:
            return
        apart = 1 / rate
        long, short_one = (run.said("sample", "run."), run.spacing), ("1 / rate", apart)
        if apart > run.spacing:
            long, short_one = short_one, long
        try:
            if not run.controlled:
                whole("1 / rate", apart, run.said("step", "run."), run.fixed_step)
            whole("initial.time", self.initial.time, "1 / rate", apart)
            whole(*long, *short_one)
        except SceneError as error:
            fitting = max(1, round(run.spacing * rate)) / rate
            own = "" if run.sample is not None else f"; give run.sample, such as {fitting:.6g}"
            raise SceneError(f"drive.rate = {rate!r}: {error}{own}") from None

    def _check_reference(self) -> None:
        """The reference stays within the joints' limits, at every extreme of a piece, and jumps at ends of steps."""
        course, run = self.course, self.run
        if course is None:
            return
        try:
            refuse_beyond(
                course, [(link.name, link.joint.limits_deg) for link in self.arm.links if not link.joint.locked]
            )
            for time in [] if run.controlled or self.drive.rate else course.jumps:
                whole("jumps, or its rate does: t", float(f"{time:.12g}"), run.said("step", "run."), run.fixed_step)
        except SceneError as error:
            raise SceneError(f"drive.reference {error}") from None

    @property
    def course(self) -> ReferenceTrajectory | None:
        """Where the drive's reference leads the joints that are not locked [rad], one column each; None without one.

        Raises
        ------
        SceneError
            An angle changes faster than float64 can hold, or the reference does not fit the arm.
        DataFileError
            The file of its shaper is not valid.
        """
        if self.drive.reference is None:
            return None
        reference, start = self.drive.reference, self.initial.joint_deg
        free = tuple(k for k, link in enumerate(self.arm.links) if not link.joint.locked)
        try:
            if reference.shaper is not None and data_files.is_user_file(reference.shaper.kind):  # which may change
                return reference.course(start, free)
            return COURSES(reference, (start, free), lambda: reference.course(start, free))
        except (SceneError, DataFileError) as error:
            raise type(error)(f"drive.reference.{error}") from None

    @property
    def tip_wrench(self) -> Array:
        """Constant force and moment on the tip, frame 0, shape (6,).

        Raises
        ------
        SceneError
            They are not constant there: `Trajectory.tip_wrench` holds what acted in a run.
        """
        if self.wrench.varies:
            cause = "frame = 'tip'" if self.wrench.frame == "tip" else f"times = {truncated(self.wrench.times)}"
            raise SceneError(
                f"wrench.{cause}: is not constant in frame 0; Trajectory.tip_wrench holds it at the samples"
            )
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
        >>> driven = scene.varied({"drive": fl.Drive(kind="constant", torque=(30.0, 5.0))})
        """
        if not isinstance(changes, Mapping) or not changes or not all(map(_of_run, changes.items())):
            return self._varied(changes)
        known = tuple((path, type(value), value) for path, value in changes.items())
        run = RUNS(self.run, known, lambda: self._varied(changes).run)
        varied: Scene = build_validated(replace, self, run=run)
        check_named(varied)
        return varied

    def _varied(self, changes: Mapping[str, object]) -> Scene:
        if isinstance(changes, Mapping):
            changes = {**implied(self.run, changes), **changes}
        anew = top_level_keys(changes)
        parts = {**_parts(self), **_parts(self.arm)}
        seen = {key: _seen(parts[key]) for key in {"link", *anew} & parts.keys() if parts[key] is not None}
        document = apply_changes(seen, FIELDS, changes)
        kept = {key: value for key, value in parts.items() if key not in anew}
        arm = None if anew & OF_ARM.keys() else self.arm
        varied = scene_from({key: value for key, value in document.items() if key in anew}, kept, arm)
        check_named(varied)
        return varied

    def values_at(self, path: str) -> list[Any]:
        """What stands at a path of `varied`, as in a TOML file: one value, or, with `*`, several; None for nothing.

        Raises
        ------
        SceneError
            The path leads nowhere.

        Examples
        --------
        >>> print(scene.values_at("tip.mass"), scene.values_at("link.*.segments"))
        [4.0] [3, 3]
        """
        return values_at(self.document(), FIELDS, path)

    def to_toml(self) -> str:
        """This scene as a TOML document that `load_scene` reads back equal; defaults are left out, but for gravity.

        Examples
        --------
        >>> print(scene.to_toml().splitlines()[0])
        name    = "two_links"
        """
        document: dict[str, Any] = without_defaults(self, always=frozenset({"gravity"}))
        document |= document.pop("arm")
        order = (
            "name", "about", "gravity", "base", "material", "section", "link", "tip", "initial", "drive", "motion",
            "wrench", "run",
        )  # fmt: skip
        return toml_of({key: document[key] for key in order if key in document})

    def save(self, path: str | Path) -> Path:
        """Write `to_toml` into a file that `load_scene` reads back equal; it appears whole or not at all.

        Raises
        ------
        ArgumentError
            `path` is no path.
        OutputError
            It cannot be written.

        Examples
        --------
        >>> print(fl.load_scene(scene.save("two_links.toml")) == scene)
        True
        """
        path = data_files.require_path("path", path)
        write_text(path, self.to_toml())
        return path

    def document(self, keys: Container[str] | None = None) -> dict[str, Any]:
        """What a TOML parser returns of this scene, or of some of its keys, with all defaults written out."""
        parts = {**_parts(self), **_parts(self.arm)}
        return _document_of_parts(parts, FIELDS if keys is None else keys)


def _outside_limits(link: Link, angle: float) -> str:
    """The angle with what is wrong about it; empty within the joint's limits."""
    low, high = link.joint.limits_deg or (-math.inf, math.inf)
    return "" if low <= angle <= high else f"{angle!r}: outside limits_deg = {[low, high]} of joint {link.name!r}"


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

    Examples
    --------
    >>> scene = fl.load_scene("models/three_links.toml")
    >>> print(scene.name, scene.run.duration)
    three_links 8.0
    """
    path = data_files.require_path("path", path)
    raw = data_files.read_toml(path)
    _find_beside(path, raw.get("run"), "method")
    _find_beside(path, get_in(raw, "drive", "reference", "shaper"), "kind")
    for link in raw["link"] if isinstance(raw.get("link"), list) else ():
        _find_beside(path, link, "lumping")
    try:
        scene = scene_from(raw)
        check_named(scene)
    except (SceneError, DataFileError) as error:
        raise type(error)(f"{path}: {error}") from None
    return scene


def _find_beside(scene: Path, table: object, key: str) -> None:
    """A rule's, method's or shaper's own file is named from the folder of the scene, wherever it was started."""
    if isinstance(table, dict) and isinstance(table.get(key), str):
        table[key] = data_files.absolute(table[key], scene.parent)


def check_named(scene: Scene) -> None:
    """What a scene names by name or file is there, and fits it: lumping rules and method.

    Raises
    ------
    SceneError
        The message names the key path, the value and what is allowed.
    DataFileError
        The file of a rule or method is not valid.
    """
    try:
        hinges_of(scene.arm)
        check_method(scene.run)
    except SceneError:
        check_all([lambda: _check_rules(scene.arm), lambda: check_method(scene.run)])


def _check_rules(arm: Arm) -> None:
    hinges_of(arm)


def _document_of_parts(parts: Mapping[str, Any], keys: Container[str]) -> dict[str, Any]:
    return {key: to_document(value) for key, value in parts.items() if key in keys and value is not None}


def _seen(value: Any) -> Any:
    """A description as a TOML parser returns it, to look at only: variants share all of it but dicts."""
    if isinstance(value, dict):
        return {key: _seen(item) for key, item in value.items()}
    if isinstance(value, Spec | tuple):
        return DOCUMENTS(value, None, lambda: to_document(value))
    return to_document(value)


def _parts(spec: Spec) -> dict[str, Any]:
    """The fields of a description by their keys in a file."""
    return {field.encode_name: getattr(spec, field.name) for field in fields_of(type(spec))}


def scene_from(raw: Mapping[str, Any], kept: Mapping[str, Any] = MappingProxyType({}), arm: Arm | None = None) -> Scene:
    """The scene of a parsed file, and of parts of another scene, or its whole arm, which have been checked.

    Raises
    ------
    SceneError
        The message names the key path, the value and what is allowed.
    """
    required = [key for key in REQUIRED if key not in kept]
    try:
        check_keys(raw, FIELDS, required)
        values = {**kept, **{key: decode(value, FIELDS[key], key) for key, value in raw.items()}}
        arm = arm or _arm_of(values)
    except SceneError:
        raise_together(_mistakes(raw, kept, required))
        raise
    own = {key: value for key, value in values.items() if key in _OWN}
    return build_validated(Scene, arm=arm, **own)


def _arm_of(values: Mapping[str, Any]) -> Arm:
    arm: Arm = build_validated(Arm, **{OF_ARM[key].name: value for key, value in values.items() if key in OF_ARM})
    return arm


def _mistakes(raw: Mapping[str, Any], kept: Mapping[str, Any], required: Sequence[str]) -> Iterator[str]:
    """All mistakes of a parsed file, key by key; those of its arm, too, where its parts are right."""
    yield from key_mistakes(raw, list(FIELDS), required)
    known = {key: value for key, value in raw.items() if key in FIELDS}
    wrong = {key: mistakes(value, FIELDS[key], key) for key, value in known.items()}
    for found in wrong.values():
        yield from found
    of_arm = {key: value for key, value in known.items() if key in OF_ARM}
    if not any(wrong[key] for key in of_arm) and "link" in {*kept, *of_arm}:
        try:
            _arm_of({**kept, **{key: decode(value, FIELDS[key], key) for key, value in of_arm.items()}})
        except SceneError as error:
            yield str(error)


def _of_run(change: tuple[object, object]) -> bool:
    """Whether a change is one of a run, to a value that means the same everywhere, as a user's file does not."""
    path, value = change
    plain = value is None or isinstance(value, str | int | float)
    return plain and isinstance(path, str) and path.startswith("run.") and not data_files.is_user_file(value)


RUNS = Memo(256)
"""Settings of runs by those that they are variants of, and the changes: scenes share them."""
DOCUMENTS = Memo(64)
"""Parts of scenes as a TOML parser returns them."""
COURSES = Memo(64)
"""Trajectories of references: runs of one scene share them."""
_OWN = {field.encode_name: field for field in fields_of(Scene) if field.name != "arm"}
OF_ARM = {field.encode_name: field for field in fields_of(Arm)}
REQUIRED = [key for key, field in (_OWN | OF_ARM).items() if field.required]
FIELDS: dict[str, Any] = {key: field.type for key, field in (_OWN | OF_ARM).items()}
"""What stands at each key of a scene's file, which is flat: the arm's keys stand beside the scene's own."""
