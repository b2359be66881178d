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
from flexlink.describe.arm import BASE, Arm, Link
from flexlink.describe.conditions import (
    OF_MOTION,
    BaseState,
    Drive,
    InitialState,
    PrescribedMotion,
    RunSettings,
    Wrench,
    check_method,
    implied,
    whole,
)
from flexlink.describe.drag import SEA_LEVEL
from flexlink.describe.from_files import filled_from_files, without_starts
from flexlink.describe.hinges import hinges_of
from flexlink.describe.mistakes import check_all, mistakes, raise_together
from flexlink.describe.own_units import KIND, UNIT, Row, in_si, misplaced, together
from flexlink.describe.reference import refuse_beyond
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.sensor import Sensor, sensor_mistakes
from flexlink.describe.spec import (
    Positive,
    Spec,
    Vector3,
    build_validated,
    check_keys,
    decode,
    did_you_mean,
    fields_of,
    key_mistakes,
    link_key,
    truncated,
)
from flexlink.describe.vary import apply_changes, to_document, top_level_keys, values_at
from flexlink.describe.writing import Inline, toml_of, without_defaults


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
    air_density: Positive | None = None
    """Density ρ of the air in which links with `drag` move [kg/m³]; default: 1.225, at sea level and 15 °C."""
    drive: Drive = Drive()
    """What drives the joints."""
    motion: tuple[PrescribedMotion, ...] = ()
    """Motions of joints that are prescribed, `[[motion]]` in a file."""
    wrench: Wrench = Wrench()
    """Force and moment on the tip."""
    sensor: tuple[Sensor, ...] = ()
    """What is measured, `[[sensor]]` in a file: columns of every run."""
    run: RunSettings = RunSettings()
    """How to integrate."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.name:
            raise SceneError("name = '': must not be empty")
        said = {
            name: name if getattr(self.initial, name) else f"the default {name}" for name in ("joint_deg", "joint_m")
        }
        if not self.initial.joint_deg:
            self._put_joints_at_zero()
        self._read_files()
        raise_together(self._wrong_lists())  # on whose lengths all else counts
        checks = [self._check_rate, lambda: self._check_limits(said), self._check_reference, self._check_motions]
        checks += [
            self._check_air,
            self._check_base,
            self._check_wrench,
            lambda: raise_together(sensor_mistakes(self.sensor, self.arm)),
        ]
        check_all(checks if self.run.controlled else [self._check_grid, *checks])

    def _read_files(self) -> None:
        """Tables in files become the scene's own; a joint that moves by one starts where its file does."""
        filled = filled_from_files(
            self.arm, motion=self.motion, drive=self.drive, wrench=self.wrench, initial=self.initial
        )
        for name, value in filled.items():
            msgspec.structs.force_setattr(self, name, value)

    def _wrong_lists(self) -> Iterator[str]:
        """Lists of another length than the arm has links, numbers of joints that are locked, or in the wrong unit."""
        links, drive = self.arm.links, self.drive
        reference = drive.reference.per_link if drive.reference is not None else {}
        per_link: dict[str, tuple[float, ...] | None] = {
            "initial.joint_deg": self.initial.joint_deg,
            "initial.rate_deg": self.initial.rate_deg,
            "initial.joint_m": self.initial.joint_m,
            "initial.rate_m": self.initial.rate_m,
            "drive.torque": drive.torque,
            "drive.kp": drive.kp,
            "drive.kd": drive.kd,
            "drive.target_deg": drive.target_deg,
            "drive.target_m": drive.target_m,
            "drive.effort": drive.effort,
            **{f"drive.torques[{k}]": row for k, row in enumerate(drive.torques or ())},
            **{f"drive.reference.{key}": row for key, row in reference.items() if len(row) == len(links)},
        }
        of_locked_joints_too = {
            "initial.joint_deg", "initial.joint_m", "drive.target_deg", "drive.target_m", "drive.effort",
        }  # fmt: skip
        fitting = {}
        for key, values in per_link.items():
            if values is None:
                continue
            if len(values) != len(links):
                yield f"{key} = {truncated(values)}: expected one number per link, {len(links)}"
                continue
            fitting[key] = values
            for k, link in enumerate(links if not key.startswith("drive.reference.") else ()):
                if link.joint.locked and values[k] and key not in of_locked_joints_too:
                    where = self.arm.path(k + 1, key)
                    yield f"{where} = {values[k]!r}: the joint of {link.name!r} is locked; only 0 fits"
        for k, key, wrong in misplaced(self.arm.slides, [link.name for link in links], fitting):
            if key.startswith("initial.") or not links[k].joint.locked:
                yield f"{self.arm.path(k + 1, key)} = {fitting[key][k]!r}: {wrong}"
        if drive.kind in {"pd", "computed_torque"} and not reference:
            yield from self._missing_targets()

    def _missing_targets(self) -> Iterator[str]:
        """A law leads joints of either kind somewhere."""
        for key, slides in (("target_deg", False), ("target_m", True)):
            names = [link.name for link in self.arm.links if not link.joint.locked and link.joint.slides == slides]
            if names and getattr(self.drive, key) is None:
                yield f"drive.{key}: missing; joint {names[0]!r} is {KIND[slides]}"

    def _check_limits(self, said: Mapping[str, str]) -> None:
        """Joints start within their limits."""
        for k, (link, place) in enumerate(zip(self.arm.links, self.starts, strict=True)):
            outside = _outside_limits(link, place)
            if outside and (self.initial.q is None or link.joint.locked):
                key = said["joint_m" if link.joint.slides else "joint_deg"].replace("joint_", "initial.joint_")
                raise SceneError(f"{self.arm.path(k + 1, key)} = {outside}")

    def _check_air(self) -> None:
        """Air without anything that it drags at."""
        if self.air_density is not None and not self.arm.has_drag:
            raise SceneError(
                f"air_density = {self.air_density!r}: has no effect; no link has drag; give one, such as "
                "link.NAME.drag = { coefficient = 1.2 }, or leave it out"
            )

    @property
    def fluid_density(self) -> float:
        """Density of the air that links with drag move through [kg/m³]; 0 without any."""
        return (self.air_density or SEA_LEVEL) if self.arm.has_drag else 0.0

    def _check_base(self) -> None:
        """What is said of the base's start, and what takes for granted that it does not float."""
        free, drive = self.arm.base.free, self.drive
        if self.initial.base != BaseState() and not free:
            raise SceneError(
                "initial.base: has no effect, the base is fixed; leave it out, or give base = { kind = 'free', "
                "mass = …, inertia = … }"
            )
        if free and self.initial.passive == "static":
            raise SceneError("initial.passive = 'static': an arm on a free base has no rest; leave passive out")
        for key, value in (("kind", drive.kind), ("gravity", drive.gravity)):
            if free and value in {"computed_torque", "rigid", "static"}:
                raise SceneError(
                    f"drive.{key} = {value!r}: takes the base for fixed, but it floats; a free base takes kind 'pd' "
                    "without gravity, or a law of your own"
                )

    def _check_wrench(self) -> None:
        """The wrench acts at the end of a link that no other hangs on."""
        on, tips = self.wrench.on, [self.arm.links[k - 1].name for k in self.arm.tips]
        if on and on not in tips:
            known = on in {link.name for link in self.arm.links}
            why = "other links hang on it" if known else "no such link"
            if on == BASE:
                why = "is no link; hang one of no length, its joint locked, on it (link.on = 'base'), and name that"
            raise SceneError(f"wrench.on = {on!r}: {why}; allowed are {', '.join(tips)}{did_you_mean(on, tips)}")

    @property
    def starts(self) -> Row:
        """Where the joints start, one number per link, [deg] or, where it slides, [m]."""
        return self.initial.own("joint", self.arm.slides)

    @property
    def joint_positions(self) -> Array:
        """Where the joints start, one number per link, [rad] or, where it slides, [m]."""
        return in_si(self.arm.slides, self.starts)

    @property
    def joint_rates(self) -> Array:
        """Rates with which the joints start, one number per link, [rad/s] or, where it slides, [m/s]."""
        return in_si(self.arm.slides, self.initial.own("rate", self.arm.slides))

    @property
    def joint_targets(self) -> Array:
        """Where a law leads the joints, one number per link, [rad] or, where it slides, [m]; zero without any."""
        return in_si(self.arm.slides, together(self.arm.slides, self.drive.target_deg, self.drive.target_m))

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
        if self.initial.q is not None and self.drive.reference is not None:
            for slides in set(self.arm.slides):
                key, default = f"from_{UNIT[slides]}", f"joint_{UNIT[slides]}"
                if self.drive.reference.starts_at_initial(slides=slides) and not getattr(self.initial, default):
                    raise SceneError(f"drive.reference.{key}: missing; initial.{default}, its default, is not given")
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
        initial, joint = self.initial, self.arm.links[number - 1].joint
        if motion.slides != joint.slides:
            key, wanted = motion.keys[0], "position_m, rate_m, acceleration_m" if joint.slides else ", ".join(OF_MOTION)
            given = f"{path}.{key} = {truncated(motion.columns[0])}"
            raise SceneError(f"{given}: joint {self.arm.links[number - 1].name!r} is {joint.kind}; give {wanted}")
        (position, rate), slides = motion.keys[:2], self.arm.slides
        for key, start, first, elsewhere in (
            (position, self.starts[number - 1], motion.columns[0][0], initial.q),
            (rate, initial.own("rate", slides)[number - 1], motion.columns[1][0], initial.qd),
        ):
            if start != first and initial.time == 0 and elsewhere is None:
                raise SceneError(f"{path}.{key}[0] = {first!r}: must be the initial value, {start!r}")
        for k, place in enumerate(motion.columns[0]):
            if outside := _outside_limits(self.arm.links[number - 1], place):
                raise SceneError(f"{path}.{position}[{k}] = {outside}")
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
            refuse_beyond(course, [(link.name, link.joint) for link in self.arm.links if not link.joint.locked])
            for time in [] if run.controlled or self.drive.rate else course.jumps:
                whole("jumps, or its rate does: t", float(f"{time:.12g}"), run.said("step", "run."), run.fixed_step)
        except SceneError as error:
            raise SceneError(f"drive.reference {error}") from None

    @property
    def course(self) -> ReferenceTrajectory | None:
        """Where the drive's reference leads the joints that are not locked [rad, m], one column each; None without one.

        Raises
        ------
        SceneError
            An angle changes faster than float64 can hold, or the reference does not fit the arm.
        DataFileError
            The file of its shaper is not valid.
        """
        if self.drive.reference is None:
            return None
        reference, start, slides = self.drive.reference, self.starts, self.arm.slides
        free = tuple(k for k, link in enumerate(self.arm.links) if not link.joint.locked)
        try:
            if reference.shaper is not None and data_files.is_user_file(reference.shaper.kind):  # which may change
                return reference.course(start, free, slides)
            return COURSES(reference, (start, free, slides), lambda: reference.course(start, free, slides))
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
        if "motion" in changes and "initial" in kept:
            kept["initial"] = without_starts(self.initial, self.arm, self.motion, changes["motion"])
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
        initial = document.get("initial", {})
        turns_only = not (any(self.arm.slides) or self.arm.base.free)
        if not (turns_only or self.initial.q or any(self.initial.joint_deg)):  # of other arms angles of 0 say little
            initial.pop("joint_deg", None)
        for table in (document, initial):
            if "base" in table:
                table["base"] = Inline(table["base"])
        order = (
            "name", "about", "gravity", "air_density", "base", "material", "section", "rigidity", "link", "tip",
            "initial", "drive", "motion", "wrench", "sensor", "run",
        )  # fmt: skip
        return toml_of({key: document[key] for key in order if key in document and document[key] != {}})

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


def _outside_limits(link: Link, place: float) -> str:
    """The angle [deg], or position [m], with what is wrong about it; empty within the joint's limits."""
    joint = link.joint
    low, high = joint.own_limits or (-math.inf, math.inf)
    return (
        "" if low <= place <= high else f"{place!r}: outside {joint.limits_key} = {[low, high]} of joint {link.name!r}"
    )


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
    raw = data_files.beside(path.parent, data_files.read_toml(path))
    try:
        scene = scene_from(raw)
        check_named(scene)
    except (SceneError, DataFileError) as error:
        raise type(error)(f"{path}: {error}") from None
    return scene


def scene_named(document: dict[str, Any], folder: Path) -> Scene:
    """Take `scene` out of what a TOML parser returned of a file in a folder, and read the scene that it names.

    Raises
    ------
    SceneError, DataFileError
        It is no path; or as in `load_scene`.
    """
    name = document.pop("scene")
    if not isinstance(name, str):
        raise SceneError(f"scene = {truncated(name)}: expected the path of a scene file")
    return load_scene(folder / name)


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
