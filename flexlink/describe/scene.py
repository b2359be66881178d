"""Scene: an arm with gravity, initial state, drive, motion, wrench and run settings; strict TOML in and out."""

from __future__ import annotations

from collections.abc import Container, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import msgspec
from msgspec.structs import FieldInfo, replace

from flexlink.common.errors import DataFileError, SceneError
from flexlink.common.memo import Memo, keep_last
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.output import write_text
from flexlink.common.types import Array
from flexlink.data import documents
from flexlink.describe.actions import Drive, PrescribedMotion, Wrench
from flexlink.describe.arm import Arm
from flexlink.describe.from_files import filled_from_files, without_starts
from flexlink.describe.initial import InitialState
from flexlink.describe.own_units import OF_JOINT, Row, in_si, together
from flexlink.describe.reference import Reference
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.run_settings import RunSettings, implied, of_run_alone
from flexlink.describe.scene_checks import check_named, check_parts
from flexlink.describe.scene_keys import OF_ARM, read_keys
from flexlink.describe.sensor import Sensor
from flexlink.describe.spec import Positive, Spec, Vector3, build_validated, fields_of, measured_in
from flexlink.describe.vary import apply_changes, as_document, parts_by_key, to_document, top_level_keys, values_at
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
    gravity: Annotated[Vector3, measured_in("m/s²")] = (0.0, 0.0, 9.81)
    """Acceleration of gravity in frame 0 [m/s²]; [0, 0, 9.81] has Z down, [0, 0, -9.81] Z up."""
    air_density: Annotated[Positive | None, measured_in("kg/m³")] = None
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
            raise SceneError("name = '': must not be empty", id="empty-name")
        said = {
            name: name if getattr(self.initial, name) else f"the default {name}" for name in ("joint_deg", "joint_m")
        }
        if not self.initial.joint_deg:
            self._put_joints_at_zero()
        self._read_files()
        check_parts(
            self.arm, self.initial, self.drive, self.run, motion=self.motion, wrench=self.wrench, sensor=self.sensor,
            air_density=self.air_density, course=lambda: self.course, said=said,
        )  # fmt: skip

    def _read_files(self) -> None:
        """Tables in files become the scene's own; a joint that moves by one starts where its file does."""
        filled = filled_from_files(
            self.arm, motion=self.motion, drive=self.drive, wrench=self.wrench, initial=self.initial
        )
        for name, value in filled.items():
            msgspec.structs.force_setattr(self, name, value)

    @property
    def fluid_density(self) -> float:
        """Density of the air that links with drag move through [kg/m³]; 0 without any."""
        sea_level = 1.225  # at 15 °C, of the International Standard Atmosphere
        return (self.air_density or sea_level) if self.arm.has_drag else 0.0

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

    def _put_joints_at_zero(self) -> None:
        """Where nothing else is said; but of a whole state nobody has said where a reference starts."""
        if self.initial.q is not None and self.drive.reference is not None:
            for slides in set(self.arm.slides):
                key, default = f"from_{OF_JOINT[slides].unit}", f"joint_{OF_JOINT[slides].unit}"
                if self.drive.reference.starts_at_initial(slides=slides) and not getattr(self.initial, default):
                    raise SceneError(
                        f"drive.reference.{key}: missing; initial.{default}, its default, is not given",
                        id="missing-key",
                    )
        joint_deg = (0.0,) * len(self.arm.links)
        msgspec.structs.force_setattr(self, "initial", replace(self.initial, joint_deg=joint_deg))

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
            if reference.shaper is not None and documents.is_user_file(reference.shaper.kind):  # which may change
                return reference.course(start, free, slides)
            return _course(reference, start, free, slides)
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
        return self.wrench.constant

    def varied(self, changes: Mapping[str, object]) -> Scene:
        """This scene with other values, each at a path in the words of the TOML file.

        Parameters
        ----------
        changes
            Values by path, put in one after the other; a value replaces all that stands at its path, and None leaves
            the key out, so that its default holds. Paths lead through tables by their keys (`run.step`), through
            materials and sections by name, through links by name, number from 1 or `*`, and so through motions and
            lists of one number per link (`initial.joint_deg.upper`), into vectors by x, y and z (`gravity.x`); a name
            with a dot stands in quotes. `*` stands for all links on which the key has an effect: `flex`, `segments`,
            `lumping` and `damping` of those that are flexible, `material` and `section` of those that have some,
            friction, armature, rates and torques of those whose joint is free. A tolerance takes the place of fixed
            steps, and a step that of a tolerance.

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
        if not of_run_alone(changes):
            return self._varied(changes)
        known = tuple((path, type(value), value) for path, value in changes.items())
        run = RUNS(self.run, known, lambda: self._varied(changes).run)
        varied: Scene = build_validated(replace, self, run=run)
        check_named(varied.arm, varied.run)
        return varied

    def _varied(self, changes: Mapping[str, object]) -> Scene:
        if isinstance(changes, Mapping):
            changes = {**implied(self.run, changes), **changes}
        anew = top_level_keys(changes)
        parts = {**parts_by_key(self), **parts_by_key(self.arm)}
        seen = {key: as_document(parts[key]) for key in {"link", *anew} & parts.keys() if parts[key] is not None}
        document = apply_changes(seen, FIELDS, changes)
        kept = {key: value for key, value in parts.items() if key not in anew}
        if "motion" in changes and "initial" in kept:
            kept["initial"] = without_starts(self.initial, self.arm, self.motion, changes["motion"])
        arm = None if anew & OF_ARM.keys() else self.arm
        varied = scene_from({key: value for key, value in document.items() if key in anew}, kept, arm)
        check_named(varied.arm, varied.run)
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
        order = (
            "name", "about", "gravity", "air_density", "base", "material", "section", "rigidity", "link", "tip",
            "initial", "drive", "motion", "wrench", "sensor", "run",
        )  # fmt: skip
        said = {key: document[key] for key in order if key in document and document[key] != {}}
        return toml_of(said, inline=frozenset({"base"}))

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
        path = documents.require_path("path", path)
        write_text(path, self.to_toml())
        return path

    def document(self, keys: Container[str] | None = None) -> dict[str, Any]:
        """What a TOML parser returns of this scene, or of some of its keys, with all defaults written out."""
        parts, wanted = {**parts_by_key(self), **parts_by_key(self.arm)}, FIELDS if keys is None else keys
        return {key: to_document(value) for key, value in parts.items() if key in wanted and value is not None}


@keep_last(64)
def _course(
    reference: Reference, start: tuple[float, ...], free: tuple[int, ...], slides: tuple[bool, ...]
) -> ReferenceTrajectory:
    """A reference's trajectory, which runs of one scene share."""
    return reference.course(start, free, slides)


def scene_from(
    raw: Mapping[str, Any],
    kept: Mapping[str, Any] = MappingProxyType({}),
    arm: Arm | None = None,
    *,
    finite: bool = False,
) -> Scene:
    """The scene of a parsed file, and of parts of another scene, or its whole arm, which have been checked.

    `finite` as of `decode`.

    Raises
    ------
    SceneError
        The message names the key path, the value and what is allowed.
    """
    required = [field.encode_name for field in _fields() if field.required and field.encode_name not in kept]
    arm, own = read_keys(raw, FIELDS, required, kept, arm, finite=finite)
    return build_validated(Scene, arm=arm, **{key: value for key, value in own.items() if key in FIELDS})


def _fields() -> list[FieldInfo]:
    """Fields of what a scene's file holds."""
    return [field for field in (*fields_of(Scene), *fields_of(Arm)) if field.name != "arm"]


RUNS = Memo(256)
"""Settings of runs by those that they are variants of, and the changes: scenes share them."""
FIELDS: dict[str, Any] = {field.encode_name: field.type for field in _fields()}
"""What stands at each key of a scene's file, which is flat: the arm's keys stand beside the scene's own."""
