"""Scene: an arm with gravity, initial state, drive, motions, wrench and run settings; strict TOML input and output."""

from __future__ import annotations

import warnings
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Never

import msgspec
from msgspec.structs import FieldInfo, replace

from flexlink.common.errors import ArgumentError, Diagnostic, SceneError, errors_at
from flexlink.common.memo import Memo, keep_last
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.output import write_text
from flexlink.common.types import Array
from flexlink.common.wording import missing, short_list
from flexlink.data import documents
from flexlink.describe import scene_checks as checks
from flexlink.describe import spec
from flexlink.describe.actions import PrescribedMotion, Wrench
from flexlink.describe.arm import Arm
from flexlink.describe.drive import Drive
from flexlink.describe.initial import InitialState
from flexlink.describe.joint import Limits
from flexlink.describe.joint_units import Row
from flexlink.describe.link import RIGID, Link
from flexlink.describe.reference import Reference
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.run_settings import RunSettings, implied, of_run_alone
from flexlink.describe.sensor import Sensor, sensor_mistakes
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, measured_in
from flexlink.describe.tie import Tie, stops_of, tie_mistakes
from flexlink.describe.vary import apply_changes, as_document, parts_by_key, to_document, top_level_keys, values_at
from flexlink.describe.writing import toml_of, without_defaults


class Scene(Spec, frozen=True):
    """An arm with its initial state, loads and run settings, as plain data for `lump` and `simulate`.

    Examples
    --------
    >>> start = fl.InitialState(joint_deg=(30.0, -60.0))
    >>> falling = fl.Scene(name="two_links", arm=arm, gravity=(0.0, -9.81, 0.0), initial=start)
    >>> heavier = falling.varied({"tip.mass": 5.0, "link.*.segments": 5})
    >>> print(heavier.arm.tip.mass, fl.lump(heavier).n)
    5.0 10
    """

    name: str
    """Name of the scene, used for files written from it."""
    arm: Arm
    """The arm; in a file its keys `link`, `material`, `section`, `tip`, `base` are at the top level."""
    initial: InitialState = InitialState()
    """Initial state. Default: all joints at zero, at rest."""
    about: str = ""
    """One-sentence description of the scene."""
    gravity: Annotated[Vector3, measured_in("m/s²")] = (0.0, 0.0, 9.81)
    """Acceleration of gravity in frame 0 [m/s²]: [0, 0, 9.81] if Z points down, [0, 0, -9.81] if Z points up."""
    air_density: Annotated[Positive | None, measured_in("kg/m³")] = None
    """Air density ρ for links with `drag` [kg/m³]. Default: 1.225, at sea level and 15 °C."""
    drive: Drive = Drive()
    """Drive of the joints."""
    motion: tuple[PrescribedMotion, ...] = ()
    """Prescribed motions of joints, `[[motion]]` in a file."""
    wrench: Wrench = Wrench()
    """Force and moment on the tip."""
    sensor: tuple[Sensor, ...] = ()
    """Sensors, `[[sensor]]` in a file: their readings are columns of every run."""
    tie: tuple[Tie, ...] = ()
    """Ties that close loops, `[[tie]]` in a file."""
    limits: Limits = Limits()
    """What joint limits do. Default: a run that exceeds them warns."""
    run: RunSettings = RunSettings()
    """Integration settings."""
    uncertain: dict[str, NonNegative] = msgspec.field(default_factory=dict)
    """Standard uncertainties of inputs, by path: "material.steel.young" = 0.02. Each is relative to its value, or in
    its unit if the value is 0. That of the `root_stiffness` of a link without one is of EI / (k L): 0.02 by default, 0
    for a rigid clamp. With --uncertain, `flexlink modes`, `simulate` and `report` give intervals."""

    def __hash__(self) -> int:
        return hash((self.name, self.arm, self.initial, self.gravity, self.drive, self.wrench, self.run))

    def __post_init__(self) -> None:
        super().__post_init__()
        if spec.is_unchecked():
            return
        if not self.name:
            raise SceneError("name = '': must not be empty", id="empty-name")
        keys = "joint_deg", "joint_m"
        names = {name: name if getattr(self.initial, name) else f"the default {name}" for name in keys}
        if not self.initial.joint_deg:
            self._put_joints_at_zero()
        self._read_files()
        arm, initial, drive, run = self.arm, self.initial, self.drive, self.run
        spec.raise_together(checks.wrong_lists(arm, initial, drive))  # first: other checks rely on the lists' lengths
        spec.check_all([
            lambda: checks.check_grid(initial, drive, self.wrench, run),
            lambda: checks.check_rate(initial, drive, run),
            lambda: checks.check_limits(arm, initial, names),
            lambda: checks.check_reference(arm, drive, self.course, run),
            lambda: checks.check_motions(arm, initial, drive, self.motion),
            self._check_air,
            lambda: checks.check_base(arm, initial, drive),
            lambda: checks.check_wrench(arm, self.wrench),
            lambda: spec.raise_together(sensor_mistakes(self.sensor, arm)),
            lambda: spec.raise_together(tie_mistakes(self.ties, arm, self.sensor)),
            self._check_uncertain,
        ])  # fmt: skip

    def _check_air(self) -> None:
        if self.air_density is not None and not self.arm.has_drag:
            remedy = "give one, such as link.NAME.drag = { coefficient = 1.2 }, or leave it out"
            raise self._refused("air_density", f"has no effect; no link has drag; {remedy}", "no-effect")

    def _check_uncertain(self) -> None:
        if self.uncertain:
            from flexlink.describe.uncertain import inputs_of  # noqa: PLC0415  it describes scenes

            inputs_of(self, FIELDS)

    def _read_files(self) -> None:
        """Read tables in files into the scene; a joint whose motion is in a file starts at the file's first row."""
        tables = (*self.motion, self.drive, self.drive.reference, self.wrench)
        if all(table is None or table.file is None for table in tables):
            return
        from flexlink.describe.from_files import filled_from_files  # noqa: PLC0415  few scenes name files

        given = {name: getattr(self, name) for name in ("motion", "drive", "wrench", "initial")}
        for name, value in filled_from_files(self.arm, **given).items():
            msgspec.structs.force_setattr(self, name, value)

    @property
    def ties(self) -> tuple[Tie, ...]:
        """All ties: those of the scene, then the stops that `limits` makes of joint limits."""
        return (*self.tie, *stops_of(self.limits, self.arm, self.tie, {motion.link for motion in self.motion}))

    @property
    def fluid_density(self) -> float:
        """Air density for links with drag [kg/m³]; 0 if there are none."""
        sea_level = 1.225  # at 15 °C, of the International Standard Atmosphere
        return (self.air_density or sea_level) if self.arm.has_drag else 0.0

    @property
    def starts(self) -> Row:
        """Initial joint positions, one per link, [deg], or [m] for prismatic joints."""
        return self.arm.own(self.initial.joint_deg, self.initial.joint_m)

    @property
    def joint_positions(self) -> Array:
        """Initial joint positions, one per link, [rad], or [m] for prismatic joints."""
        return self.arm.in_si(self.starts)

    @property
    def joint_rates(self) -> Array:
        """Initial joint rates, one per link, [rad/s], or [m/s] for prismatic joints."""
        return self.arm.in_si(self.arm.own(self.initial.rate_deg, self.initial.rate_m))

    @property
    def joint_targets(self) -> Array:
        """Target positions of a controller, one per link, [rad], or [m] for prismatic joints; zero if not given."""
        return self.arm.in_si(self.arm.own(self.drive.target_deg, self.drive.target_m))

    def __repr__(self) -> str:
        return f"<Scene {self.name!r}: {self.arm!r}; {self.run.in_words}>"

    def _repr_html_(self) -> str:
        heads = ("link", "flex", "segments", "length [m]", "material", "section")
        rows = [
            (k.name, k.flex, "" if k.flex == "rigid" else k.segments, k.length, k.material or "", k.section or "")
            for k in self.arm.links
        ]
        return html_table(f"{self.name}: {self.run.in_words}", heads, rows)

    def plot(self, *, ax: Any = None) -> Any:
        """Draw the arm in its initial state, from the side and, if it is not planar, from above.

        Returns a matplotlib Figure, which a notebook displays once; it is that of `ax`, axes to draw in, one for each
        view, or a new one.

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.
        SceneError, ConvergenceError
            Raised by `initial_state`.

        Examples
        --------
        >>> figure = scene.plot()
        >>> figure.savefig("two_links.png")
        """
        return drawing_module("scene_report.arm_picture").plot_scene(self, ax)

    def _put_joints_at_zero(self) -> None:
        """Set the default angles; if a complete state is given, a reference must then specify where it starts."""
        if self.initial.q is not None and self.drive.reference is not None:
            for unit in sorted({link.joint.terms.unit for link in self.arm.links}):
                if self.drive.reference.starts_at_initial(unit) and not getattr(self.initial, f"joint_{unit}"):
                    raise missing(f"drive.reference.from_{unit}", f"initial.joint_{unit}, its default, is not given")
        joint_deg = (0.0,) * len(self.arm.links)
        msgspec.structs.force_setattr(self, "initial", replace(self.initial, joint_deg=joint_deg))

    @property
    def course(self) -> ReferenceTrajectory | None:
        """Reference trajectory of all joints that are not locked [rad, m], one column each; None without a reference.

        Raises
        ------
        SceneError
            An angle changes too fast for float64, or the reference does not fit the arm.
        DataFileError
            The user's shaper file is invalid.
        """
        if self.drive.reference is None:
            return None
        reference, start, slides = self.drive.reference, self.starts, self.arm.slides
        free = tuple(k for k, link in enumerate(self.arm.links) if not link.joint.locked)
        with errors_at("drive.reference."):
            if reference.shaper is not None and documents.is_user_file(reference.shaper.kind):  # the file may change
                return reference.course(start, free, slides)
            return _course(reference, start, free, slides)

    @property
    def tip_wrench(self) -> Array:
        """Constant force and moment on the tip, in frame 0, shape (6,).

        Raises
        ------
        SceneError
            Force or moment vary over time in frame 0; use `Trajectory.tip_wrench` of a run instead.
        """
        return self.wrench.constant

    def varied(self, changes: Mapping[str, object] | None = None, **unknown: Never) -> Scene:
        """Return a copy of this scene with new values, each given by its key path in the TOML file.

        Parameters
        ----------
        changes
            Values by path, in any order: tables apply before their parts, and `*` before names. A value replaces
            everything at its path, and None removes the key, which restores its default. Paths lead through tables by
            key (`run.step`), through materials and sections by name, through links by name, number from 1 or `*`,
            through motions and lists of one number per link (`initial.joint_deg.upper`), and into vectors by x, y and z
            (`gravity.x`). Put a name with a dot in quotes. `flex = "rigid"` also removes what only bending needs. `*`
            selects all links on which the key has an effect: `flex`, `segments`, `lumping` and `damping` of
            flexible links, `material` and `section` of links that have them, friction, armature, rates and torques of
            links with a free joint. A tolerance replaces fixed steps, and a step replaces a tolerance.
        **unknown
            Refused; the message states how changes are written.

        Returns
        -------
        Scene
            Checked as if read from a file, including its lumping rules and method.

        Raises
        ------
        SceneError
            A path does not exist, or a value is invalid; the message names it and what is allowed.
        ArgumentError
            `changes` is not a dict of values by path.

        Examples
        --------
        >>> fine = scene.varied({"link.*.segments": 9, "link.*.lumping": "gauss", "run.step": 1e-5})
        >>> soft = scene.varied({"material.aluminium.young": 35e9, "initial.joint_deg.upper": -45.0})
        >>> driven = scene.varied({"drive": fl.Drive(kind="constant", torque=(30.0, 5.0))})
        """
        if changes is None or unknown:
            remedy = "changes are given by their paths in a dict, such as scene.varied({'tip.mass': 2.0})"
            raise ArgumentError(f"varied: {', '.join(unknown) or 'no changes'}: {remedy}", id="wrong-type")
        if not of_run_alone(changes):
            return self._varied(changes)
        known = tuple((path, type(value), value) for path, value in changes.items())
        run = RUNS(self.run, known, lambda: self._varied(changes).run)
        varied: Scene = spec.build_validated(replace, self, run=run)
        checks.check_named(varied.arm, varied.run)
        return varied

    def _varied(self, changes: Mapping[str, object]) -> Scene:
        if isinstance(changes, Mapping):
            changes = {**changes, **implied(self.run, changes), **changes}
        anew = top_level_keys(changes)
        parts = {**parts_by_key(self), **parts_by_key(self.arm)}
        touched = {"link", *anew} if anew <= FIELDS.keys() else parts.keys()  # a message on an unknown key names others
        seen = {key: as_document(parts[key]) for key in touched & parts.keys() if parts[key] is not None}
        document = apply_changes(seen, FIELDS, changes)
        kept = {key: value for key, value in parts.items() if key not in anew}
        if "motion" in changes and "initial" in kept:
            from flexlink.describe.from_files import without_starts  # noqa: PLC0415

            kept["initial"] = without_starts(self.initial, self.arm, self.motion, changes["motion"])
        arm = None if anew & OF_ARM.keys() else self.arm
        try:
            varied = scene_from({key: value for key, value in document.items() if key in anew}, kept, arm)
        except SceneError as error:
            parts = {path: [*part] for path, part in changes.items() if isinstance(part, dict)}
            tables = [f"{path}.{keys[0]}" for path, keys in parts.items() if keys and not {"kind", "name"} & {*keys}]
            if not tables or error.id not in {"missing-key", "key-of-another-kind"}:
                raise
            raise SceneError(f"{error}; a table replaces all keys: change one by {tables[0]!r}", id=error.id) from None
        checks.check_named(varied.arm, varied.run)
        return varied

    def rigidified(self) -> Scene:
        """The scene with all links, their roots and gears rigid, so its chain has only the driven joints.

        All masses, joint friction and rotor inertia are unchanged; hinges, their friction and damping are removed. The
        initial angles and rates of the joints remain: `initial.joint_deg`, `rate_deg`, and for prismatic joints
        `joint_m`, `rate_m`. Drive, motions, wrench and sensors remain as well, except strain gauges: a warning names
        them.

        Returns
        -------
        Scene
            The rigid scene.

        Examples
        --------
        >>> model = fl.lump(scene.rigidified())
        >>> print(model.n, "joints instead of", chain.n)
        2 joints instead of 6
        >>> stiff = fl.simulate(scene.rigidified())  # the same task, without bending
        >>> torque = fl.inverse_dynamics(model, q[chain.active], qd[chain.active], [1.0, 0.0])  # N m, rad/s²
        """
        gauges = [sensor.name for sensor in self.sensor if sensor.kind == "strain"]
        if gauges:
            text = f"{self.name}: strain gauges left out: {short_list(gauges)}; rigid links do not bend; read run.loads"
            warnings.warn(Diagnostic(text, id="strain-gauges-left-out"), UserWarning, stacklevel=2)
        kept = {name: getattr(self, name) for name in ("drive", "motion", "wrench", "tie", "limits")}
        sensors = tuple(sensor for sensor in self.sensor if sensor.kind != "strain")
        rigid: Scene = spec.build_validated(replace, bare_and_rigid(self), sensor=sensors, **kept)
        return rigid

    def values_at(self, path: str) -> list[Any]:
        """Values at a path of `varied`, as in a TOML file: one, or several with `*`; None if nothing is there.

        Raises
        ------
        SceneError
            The path does not exist.

        Examples
        --------
        >>> print(scene.values_at("tip.mass"), scene.values_at("link.*.segments"))
        [4.0] [3, 3]
        """
        return values_at(self.document(), FIELDS, path)

    def to_toml(self) -> str:
        """This scene as TOML, from which `load_scene` reads an equal scene; defaults are omitted, except gravity.

        Examples
        --------
        >>> print(scene.to_toml().splitlines()[0])
        name    = "two_links"
        """
        document: dict[str, Any] = without_defaults(self, always=frozenset({"gravity"}))
        document |= document.pop("arm")
        initial = document.get("initial", {})
        turns_only = not (any(self.arm.slides) or self.arm.base.free)
        if not (turns_only or self.initial.q or any(self.initial.joint_deg)):  # all angles are 0, the default
            initial.pop("joint_deg", None)
        order = (
            "name", "about", "gravity", "air_density", "base", "material", "section", "rigidity", "link", "tip",
            "initial", "drive", "motion", "wrench", "sensor", "tie", "limits", "run",
            "uncertain",
        )  # fmt: skip
        written = {key: document[key] for key in order if key in document and document[key] != {}}
        return toml_of(written, inline=frozenset({"base"}))

    def save(self, path: str | Path) -> Path:
        """Write the scene as TOML to a file; if writing fails, no partial file remains.

        Raises
        ------
        ArgumentError
            `path` is not a path.
        OutputError
            The file cannot be written.

        Examples
        --------
        >>> print(fl.load_scene(scene.save("two_links.toml")) == scene)
        True
        """
        path = documents.require_path("path", path)
        write_text(path, self.to_toml())
        return path

    def document(self, keys: Container[str] | None = None) -> dict[str, Any]:
        """This scene, or the given keys of it, as parsed TOML with all defaults."""
        parts, wanted = {**parts_by_key(self), **parts_by_key(self.arm)}, FIELDS if keys is None else keys
        return {key: to_document(value) for key, value in parts.items() if key in wanted and value is not None}


_course = keep_last(64)(Reference.course)  # trajectory of a reference, cached because all runs of a scene share it


def scene_from(
    raw: Mapping[str, Any], kept: Mapping[str, Any] = MappingProxyType({}), arm: Arm | None = None, finite: bool = False
) -> Scene:
    """Build a scene from a parsed file and from checked parts of another scene; `finite` as in `decode`."""
    required = [field.encode_name for field in _fields() if field.required and field.encode_name not in kept]
    if isinstance(raw.get("uncertain"), dict):  # paths with or without quotes
        raw = {**raw, "uncertain": dict(documents.paths_of(raw["uncertain"]))}
    try:
        spec.check_keys(raw, FIELDS, required)
        values = {**kept, **{key: spec.decode(value, FIELDS[key], key, finite=finite) for key, value in raw.items()}}
        arm = arm or _arm_of(values)
    except SceneError:
        spec.raise_together(_mistakes(raw, kept, required))
        raise
    of_scene = FIELDS.keys() - OF_ARM.keys()
    return spec.build_validated(Scene, arm=arm, **{key: value for key, value in values.items() if key in of_scene})


def _arm_of(values: Mapping[str, Any]) -> Arm:
    return spec.build_validated(Arm, **{OF_ARM[key].name: value for key, value in values.items() if key in OF_ARM})


def _mistakes(raw: Mapping[str, Any], kept: Mapping[str, Any], required: Sequence[str]) -> Iterator[Diagnostic]:
    """All mistakes in a parsed file, key by key; if the arm's parts are valid, also contradictions between them."""
    yield from spec.key_mistakes(raw, list(FIELDS), required)
    wrong = {key: spec.mistakes(value, FIELDS[key], key) for key, value in raw.items() if key in FIELDS}
    for found in wrong.values():
        yield from found
    of_arm = wrong.keys() & OF_ARM.keys()
    if not any(wrong[key] for key in of_arm) and "link" in {*kept, *of_arm}:
        try:
            _arm_of({**kept, **{key: spec.decode(raw[key], FIELDS[key], key) for key in of_arm}})
        except SceneError as error:
            yield error.diagnostic


def _fields() -> list[FieldInfo]:
    """Fields of a scene file."""
    return [field for field in (*spec.fields_of(Scene), *spec.fields_of(Arm)) if field.name != "arm"]


RUNS = Memo(256)  # cached run settings, keyed by the original settings and the changes to them; scenes share them
FIELDS: dict[str, Any] = {field.encode_name: field.type for field in _fields()}
"""Type at each key of a scene file, where the keys of the arm are at the top level, beside the keys of the scene."""
OF_ARM = {field.encode_name: field for field in spec.fields_of(Arm)}  # fields of the arm, by their keys


def bare_and_rigid(scene: Scene) -> Scene:
    """The rigid scene without drive, motions, wrench and sensors, as control laws use it."""
    return spec.build_validated(_bare_and_rigid, scene)


def _bare_and_rigid(scene: Scene) -> Scene:
    links, given, positions = scene.arm.links, scene.initial, scene.joint_positions.tolist()
    free = [position for position, link in zip(positions, links, strict=True) if not link.joint.locked]
    # coordinates of a base that floats, which come first in a chain
    of_base = (given.q or ())[: 6 if scene.arm.base.free else 0]
    q = None if given.q is None else (*of_base, *free)  # a complete state may exceed the limits
    kept = {name: getattr(scene, name) for name in ("name", "about", "gravity", "air_density", "run")}
    initial = replace(given, q=q, qd=None, passive="zero")
    return Scene(arm=replace(scene.arm, links=tuple(map(_rigid, links))), initial=initial, **kept)


def _rigid(link: Link) -> Link:
    joint = replace(link.joint, gear_stiffness=None, gear_damping=0.0, viscous_lag=0.0)
    return replace(link, joint=joint, root_stiffness=None, root_damping=None, **RIGID)
