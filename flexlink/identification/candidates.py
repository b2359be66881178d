"""Candidates for additional data: experiments applied to the scene and the runs of a problem.

Each candidate is a part of a problem file (a run, modes, a static deflection or a prior) whose data are the predictions
of the scene at given values of the parameters.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy
from msgspec.structs import replace

from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.data.csv_table import head_of, in_si, read_csv
from flexlink.describe.link import Link
from flexlink.describe.material import BREADTHS
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor, column_names
from flexlink.describe.vary import parts_of
from flexlink.dynamics.sensors.signals import check_placements
from flexlink.identification import experiments as kinds
from flexlink.identification.block import LINEAR, unit_in
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source, as_long, at_times, exact, sagged, tapped
from flexlink.identification.problem import FitModes, FitParameter, FitProblem, FitRun, FitStatic, files_of
from flexlink.motion.simulate import simulate

Addition = FitRun | FitModes | FitStatic | FitParameter
"""Part of a problem that a candidate adds; a parameter replaces the one with its path."""


class Candidate(NamedTuple):
    """An experiment on this arm."""

    experiment: str  # name of the experiment
    title: str  # what to measure, with its assumed deviation
    reason: str  # reason for the deviation or the motion
    addition: Addition  # what it adds to the problem
    beside: str = ""  # run that it repeats with other columns; all candidates that repeat a run are simulated together
    # the addition as read from a file of the problem that already contains its column; None if there is none
    recorded: FitRun | None = None


class Bench:
    """A problem at the point x of its parameters, on which experiments are tried; `skipped` do not apply there."""

    def __init__(
        self, problem: FitProblem, sources: Sequence[Source], coordinates: Sequence[Coordinate], x: Array
    ) -> None:
        self.problem, self.coordinates, self.x = problem, coordinates, x
        pairs = [(one, float(at)) for one, at in zip(coordinates, x, strict=True) if not one.timing]
        self.values = {(one.run, one.path): one.value(at) for one, at in pairs}
        self.common = {path: value for (run, path), value in self.values.items() if not run}
        self.scene = problem.scene.varied(self.common)
        self.skipped: list[Diagnostic] = []
        known = {source.name: source for source in sources if source.is_run}
        self.runs: list[tuple[FitRun, Source | None]]
        self.runs = [(run, known[run.name]) for run in problem.run if run.name in known]
        self.runs = self.runs or [(FitRun(name="scene", columns={"t [s]": (0.0,)}), None)]

    def candidates(self, experiments: kinds.Experiments) -> Iterator[Candidate]:
        """All candidates, those without simulated runs first."""
        for prior in experiments.prior:
            yield from self._priors(prior)
        for static in experiments.static:
            for axis in range(3):
                yield from self._tried(static.name, self._static, static, axis)
        for modes in experiments.modes:
            yield from self._tried(modes.name, self._modes, modes)
        for run, source in self.runs:
            yield from self._tried(f"columns of {run.name!r}", self._of_columns, experiments.column, run, source)
            for motion in experiments.motion if source is not None else ():
                for link in self._links(motion):
                    yield from self._tried(motion.name, self._motion, motion, run, source, link)

    def _tried(self, name: str, make: Callable[..., Iterator[Candidate]], *arguments: object) -> list[Candidate]:
        try:
            return [*make(*arguments)]
        except FlexlinkError as error:
            self.skip(name, error)
            return []

    def skip(self, name: str, reason: object) -> None:
        """Note an experiment that is left out."""
        self.skipped.append(Diagnostic(f"{name}: {reason}", "experiment-left-out"))

    def _priors(self, experiment: kinds.PriorExperiment) -> Iterator[Candidate]:
        for one in self.problem.parameter:
            if one.prior is not None or not re.fullmatch(experiment.paths, one.path):
                continue
            value = self.values["", one.path]
            deviation = experiment.deviation or abs(value) * (experiment.share or 0.0)
            if not deviation or (value <= 0 and one.scale == "log"):
                continue
            title = f"{experiment.name}: {one.path} ± {deviation:.2g} (standard deviation)"
            addition = replace(one, prior=(rounded(value), rounded(deviation)))
            yield Candidate(experiment.name, title, experiment.reason, addition)

    def _static(self, experiment: kinds.StaticExperiment, axis: int) -> Iterator[Candidate]:
        """The heaviest weight that moves the tip by no more than allowed."""
        scene, before = self.scene, self.scene.wrench.force
        if scene.wrench.varies or scene.arm.base.free:
            cause = "the base is free" if scene.arm.base.free else "the wrench is not constant in frame 0"
            raise ArgumentError(cause, id="no-effect")
        largest = experiment.largest * lump(scene).reach
        down = scene.gravity[axis] < 0 and abs(scene.gravity[axis]) > 0.5 * math.hypot(*scene.gravity)
        found, what = None, f"tip {'xyz'[axis]} [m]"
        for mass in sorted(experiment.kilograms):
            force = [*before]
            force[axis] += (-1 if down else 1) * scipy.constants.g * mass
            addition = FitStatic(
                axis="xyz"[axis], value=0.0, deviation=experiment.deviation,  # type: ignore[arg-type]
                set={"wrench.force": tuple(map(rounded, force))}, before={"wrench.force": before},
            )  # fmt: skip
            self._refuse_sought(addition.set)
            try:
                value = self._predicted(sagged(self.problem, addition, 0))[0][0]
            except FlexlinkError:  # the arm buckles or sags too far for a static solution
                if found is None:
                    raise
                break
            if abs(value) > largest:
                break
            if abs(value) > experiment.deviation:
                title = f"static: {what} under {mass:g} kg along {addition.axis} (noise {experiment.deviation:g} m)"
                addition = replace(addition, value=rounded(value))
                found = Candidate(experiment.name, title, experiment.reason, addition)
        if found is None:
            raise ArgumentError(f"{what}: no weight moves the tip within the allowed range", id="no-effect")
        yield found

    def _modes(self, experiment: kinds.ModesExperiment) -> Iterator[Candidate]:
        added, on = self._mass(experiment.kilograms, {})
        for count in range(experiment.count, 0, -1):
            addition = FitModes(
                hertz=tuple(float(k + 1) for k in range(count)), deviation=(1.0,), set=added,
                ratios=(0.0,) * count if experiment.ratio_share else (), locked=() if experiment.free else None,
            )  # fmt: skip
            try:
                hertz, *ratios = self._predicted(tapped(self.problem, addition, 0))
                break
            except ArgumentError as error:
                if error.id != "unknown-mode" or count == 1:
                    raise
        deviations = tuple(rounded(experiment.share * f) for f in hertz)
        addition = replace(addition, hertz=tuple(map(rounded, hertz)), deviation=deviations)
        if ratios and experiment.ratio_share:
            if not all(float(ζ) > 0 for ζ in ratios[0]):
                raise ArgumentError("no mode is damped", id="no-effect")
            deviation = rounded(experiment.ratio_share * float(min(ratios[0])))
            addition = replace(addition, ratios=tuple(map(rounded, ratios[0])), ratio_deviation=deviation)
        listed = ", ".join(f"{f:.3g}" for f in hertz)
        title = f"{experiment.name}{on}: {listed} Hz ± {100 * experiment.share:.2g} %"
        if addition.ratios:
            title += f", damping ratio ± {100 * (experiment.ratio_share or 0.0):.2g} %"
        yield Candidate(experiment.name, title, experiment.reason, addition)

    def _of_columns(
        self, experiments: Sequence[kinds.ColumnExperiment], run: FitRun, source: Source | None
    ) -> Iterator[Candidate]:
        """One candidate for each column or sensor, recorded in a repeat of a run; one simulation predicts all."""
        scene, sensors = self.problem.scene.varied(run.set) if run.set else self.problem.scene, list[Sensor]()
        own = {one.name: sensors_on(one, scene, sensors) for one in experiments if one.sensor}
        t = self._times(source, 1.0)
        columns = self._recorded(run, {"sensor": (*scene.sensor, *sensors)} if sensors else {}, t)
        measured = {block.name for block in source.blocks} if source is not None else set()
        new = {name for one in sensors for name in column_names((one,), scene.arm)}
        for one in experiments:
            if one.sensor and not own[one.name]:
                self.skip(one.name, f"no link of {run.name!r} takes this sensor")
            of_sensors = [(sensor, column_names((sensor,), scene.arm)) for sensor in own.get(one.name, ())]
            others = [name for name in columns if name not in new and self._measurable(name, one.columns)]
            for sensor, names in [*of_sensors, *((None, (name,)) for name in others)]:
                if not measured & {*names}:
                    changes = {} if sensor is None else {"sensor": (*scene.sensor, sensor)}
                    yield from self._column(one, run, sensor, changes, t, {name: columns[name] for name in names})

    def _column(
        self, experiment: kinds.ColumnExperiment, run: FitRun, sensor: Sensor | None, changes: Mapping[str, Any],
        t: Array, columns: Mapping[str, Array],
    ) -> Iterator[Candidate]:  # fmt: skip
        largest = max(float(np.abs(column).max()) for column in columns.values())
        noise = rounded(experiment.noise or (experiment.share or 0.0) * largest)
        names = tuple(name for name, column in columns.items() if np.ptp(column) > noise > 0)  # others show noise only
        what = sensor.name if sensor is not None else next(iter(columns))
        if not names:
            self.skip(f"{what} in {run.name!r}", "it does not change by more than its noise")
            return
        unit, head = unit_in(names[0]), "" if sensor is not None else heads_of(run).get(names[0], "")
        where = "a run of the scene"
        if run in self.problem.run:
            where = f"run {run.name!r}, where it is already recorded" if head else f"a repeat of run {run.name!r}"
        addition = self._run(
            run, f"{run.name}, {what.partition(' [')[0]}", changes, t, columns, dict.fromkeys(names, noise),
            gain=names if experiment.gain else (), bias=names if experiment.bias else (),
        )  # fmt: skip
        title = f"add {what} in {where} (noise {noise:.2g}{f' {unit}' if unit != '1' else ''})"
        again = replace(addition, columns={}, file=run.file, compare=(head,), start=run.start) if head else None
        yield Candidate(experiment.name, title, experiment.reason, addition, run.name, again)

    def _measurable(self, name: str, pattern: str) -> bool:
        """Whether a column matches, and is not the angle of a hinge of a beam."""
        joint = name.partition(" ")[2].rpartition(" [")[0]
        measured = not name.startswith(("q ", "qd ", "tau ")) or joint in self.problem.scene.arm.joint_names
        return measured and bool(pattern) and re.fullmatch(pattern, name) is not None

    def _links(self, experiment: kinds.MotionExperiment) -> list[str]:
        """Names of the driven links, on each of which a motion is tried; "" if its paths name no link."""
        if not any("{link}" in path for path in (*experiment.scale, *experiment.add, *experiment.set)):
            return [""]
        return [link.name for link in self.scene.arm.links if not link.joint.locked]

    def _motion(
        self, experiment: kinds.MotionExperiment, run: FitRun, source: Source, link: str
    ) -> Iterator[Candidate]:
        added, on = self._mass(experiment.kilograms, run.set)
        changes = changes_of(experiment, self.problem.scene.varied(run.set), link) | added
        self._refuse_sought(changes)
        t = self._times(source, experiment.longer)
        columns = self._recorded(run, changes, t)
        where = f", joint {link}" if link else ""
        blocks = [(b, float(np.median(b.σ))) for b in source.blocks]
        if not (noise := {b.name: rounded(σ) for b, σ in blocks if np.ptp(columns[b.name]) > σ}):
            raise ArgumentError("no column changes by more than its noise", id="no-effect")
        unknown = {key: tuple(b.name for b, _ in blocks if key in b.linear and b.name in noise) for key in LINEAR}
        unknown["delay"] = tuple(head for head in run.delay if head_of(head)[0] in {head_of(name)[0] for name in noise})
        addition = self._run(run, f"{run.name}, {experiment.name}{where}", changes, t, columns, noise, **unknown)
        title = f"run {run.name!r} again, {experiment.name}{on}{where} (noise as in that run)"
        yield Candidate(experiment.name, title, experiment.reason, addition)

    def _run(
        self, run: FitRun, name: str, changes: Mapping[str, Any], t: Array, columns: Mapping[str, Array],
        noise: Mapping[str, float], **unknown: tuple[str, ...],
    ) -> FitRun:  # fmt: skip
        """A run to be recorded, with the columns that `noise` names; `unknown` names columns by what is unknown."""
        parameters = (replace(one, start=self.values.get((run.name, one.path), one.start)) for one in run.parameter)
        recorded = FitRun(
            name=name, set={**run.set, **changes}, noise=dict(noise), parameter=tuple(parameters), clock=run.clock,
            columns={"t [s]": tuple(t.tolist())} | {one: tuple(columns[one].tolist()) for one in noise},
            window=None if run.window is None else (float(t[0]), float(t[-1])),
            start="unknown" if run.start == "unknown" else None,
        )  # fmt: skip
        return replace(recorded, **unknown)

    def _recorded(self, run: FitRun, changes: Mapping[str, Any], t: Array) -> Mapping[str, Array]:
        """Columns of the changed run at times t, predicted by the scene."""
        scene = self.problem.scene.varied({**run.set, **changes})
        own = {path: value for (name, path), value in self.values.items() if name in ("", run.name)}
        scene = as_long(exact(scene.varied(own), self.problem.tolerance), t)
        found = simulate(scene)
        return {name: at_times(found.t, column, t) for name, column in found.columns.items() if name != "t [s]"}

    def _times(self, source: Source | None, longer: float) -> Array:
        """Times of the samples of a run, or of the scene's run."""
        if source is None:
            return self.problem.scene.run.times_from(self.problem.scene.initial.time)
        t = np.asarray(max((block.t for block in source.blocks if block.t is not None), key=len))
        if longer == 1:
            return t
        between, start = float(np.median(np.diff(t))), float(t[0])
        return np.asarray(start + between * np.arange(round(longer * (float(t[-1]) - start) / between) + 1), np.float64)

    def _predicted(self, source: Source) -> list[Array]:
        assert source.at_rest is not None
        return source.at_rest(source.scene.varied(self.common))

    def _mass(self, kilograms: Sequence[float], already: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
        """Change that clamps a known mass to the end of the last link, and its text."""
        if not kilograms:
            return {}, ""
        mass = max([mass for mass in kilograms if mass <= lump(self.scene).mass / 2] or [min(kilograms)])
        path = f"{self.scene.arm.path(len(self.scene.arm.links))}.end.mass"
        now = float(self.problem.scene.varied(dict(already)).values_at(path)[0] or 0.0)
        self._refuse_sought({path: mass})
        return {path: rounded(now + mass)}, f" ({mass:g} kg)"

    def _refuse_sought(self, changes: Mapping[str, Any]) -> None:
        """Refuse an experiment that sets a sought parameter, or a part of one."""
        for path in changes:
            for _, sought in self.values:
                one, other = parts_of(path), parts_of(sought)
                if one[: len(other)] == other or other[: len(one)] == one:
                    raise ArgumentError(f"it sets {path}, but {sought} is sought", id="parameter-set")


def sensors_on(experiment: kinds.ColumnExperiment, scene: Scene, others: list[Sensor]) -> list[Sensor]:
    """The sensor of an experiment on every link and at every place that takes it; they are appended to `others`."""
    found = []
    for link in scene.arm.links:
        fibres = _fibres(scene, link) if experiment.sensor.get("kind") == "strain" else [{}]
        for place in experiment.places or (None,):
            at = {} if place is None else {"x": rounded(place * link.beam.length)}
            for fibre in fibres:
                label = f"{experiment.name} on {link.name}" + "".join(f" at {x:.4g} m" for x in at.values())
                label += "".join(f", {'z' if z else 'y'} side" for _, z in fibre.values())
                try:
                    sensor = Sensor(
                        name=re.sub(r"[\[\]\n\r\t]", " ", label), link=link.name,
                        **{**experiment.sensor, **at, **fibre},
                    )  # fmt: skip
                    check_placements(scene.varied({"sensor": (*scene.sensor, *others, sensor)}))
                except FlexlinkError:
                    continue
                found.append(sensor)
                others.append(sensor)
    return found


def _fibres(scene: Scene, link: Link) -> list[dict[str, tuple[float, float]]]:
    """Positions (y, z) of gauges at the outermost fibres of a link's section; empty if these are not known."""
    section = scene.arm.sections.get(link.section or "")
    if section is None or section.shape not in BREADTHS or link.flex == "rigid":
        return []
    along_z, along_y = (float(getattr(section, key)) for key in BREADTHS[section.shape])
    both = [{"fibre": (rounded(along_y / 2), 0.0)}]
    return [*both, {"fibre": (0.0, rounded(along_z / 2))}] if "y" in link.flex else both


def changes_of(experiment: kinds.MotionExperiment, scene: Scene, link: str) -> dict[str, Any]:
    """Values by path that turn a run into another motion."""
    quoted = link if re.fullmatch(r"[A-Za-z0-9_-]+", link) else f'"{link}"'

    def at(path: str) -> str:
        return path.replace("{link}", quoted)

    changes = {at(path): _scaled(scene, at(path), factor) for path, factor in experiment.scale.items()}
    for path, number in experiment.add.items():
        changes[at(path)] = rounded(float(scene.values_at(at(path))[0] or 0.0) + number)
    changes |= {at(path): value for path, value in experiment.set.items()}
    if any(experiment.tilt_deg):
        if not any(scene.gravity):
            raise ArgumentError("the scene has no gravity", id="no-effect")
        base = scipy.spatial.transform.Rotation.from_rotvec(experiment.tilt_deg, degrees=True)
        changes["gravity"] = tuple(rounded(float(part)) for part in base.inv().apply(scene.gravity))
    return changes


def _scaled(scene: Scene, path: str, factor: Any) -> Any:
    """The number or the list of numbers at a path, times a factor."""
    value = scene.values_at(path)[0]
    if value is None or isinstance(value, str):
        raise ArgumentError(f"{path} is not set", id="no-effect")
    return [rounded(item * factor) for item in value] if isinstance(value, list | tuple) else rounded(value * factor)


def rounded(value: float) -> float:
    """A value with five digits, for the problem file."""
    return float(f"{float(value):.5g}")


def heads_of(run: FitRun) -> dict[str, str]:
    """Column heads in the file of a run, by the names of columns in SI units."""
    heads = [head for file in files_of(run) for head in read_csv(Path(file)).heads]
    return {found[0]: head for head in heads if (found := in_si(head)) is not None}
