"""Measurements, and the model's predictions for them: recorded runs, and single measurements at rest."""

import dataclasses
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy
from msgspec.structs import replace

from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, DataFileError, Diagnostic, FlexlinkError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, plural
from flexlink.data.csv_table import Measured, measured_from, named, read_measured
from flexlink.describe.numbers import within
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.vibration.modal import modes
from flexlink.dynamics.vibration.steady import first_elastic_frequency
from flexlink.identification.block import Block
from flexlink.identification.coordinates import Coordinate, shifted, timings
from flexlink.identification.frequency_response import Response, at_rest, measured_response, predicted, table_of
from flexlink.identification.problem import FitFrf, FitModes, FitProblem, FitRun, FitStatic, Use, files_of
from flexlink.motion.inputs.actuation import initial_wrench
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.simulate import simulate
from flexlink.motion.slopes_of_runs import smooth
from flexlink.results.samples import sources_of as columns_of
from flexlink.results.trajectory import Trajectory


@dataclasses.dataclass(eq=False)
class Source:
    """A recorded run, or single measurements at rest."""

    # name, use: as in the problem
    name: str
    use: Use
    scene: Scene  # the scene that predicts the data, before parameters are set
    blocks: tuple[Block, ...]  # columns of the run, or the single measurements
    rate: float = 0.0  # sampling rate of a run's file [Hz]
    shows: str = ""  # text with the length of a run and the number of periods of the slowest mode that it contains
    doubts: tuple[Diagnostic, ...] = ()  # warnings about a run's times
    # time that the simulation of a run continues beyond the data, for unknown delays, clock and start [s]
    margin: float = 0.0
    # function that predicts single measurements from a scene; None for a run
    at_rest: Callable[[Scene], list[Array]] | None = None
    response: Response | None = None  # the measured frequency response, if the blocks are its real and imaginary part
    # the same data in a form whose cost has fewer minima, for the first search; None if there is none
    rough: "Source | None" = None

    @property
    def is_run(self) -> bool:
        """Whether the source is a recorded run."""
        return self.at_rest is None

    def first(self, part: float) -> "Source":
        """Return the first part of a run, the fraction `part` of its samples and at least ten samples."""
        counts = [max(math.ceil(part * len(block.y)), min(10, len(block.y))) for block in self.blocks]
        blocks = tuple(
            dataclasses.replace(block, y=block.y[:n], σ=block.σ[:n], t=np.asarray(block.t)[:n])
            for block, n in zip(self.blocks, counts, strict=True)
        )
        end = max(float(np.asarray(block.t)[-1]) for block in blocks) + self.margin
        run = self.scene.run
        duration = math.ceil((end - self.scene.initial.time) / run.spacing - 1e-6) * run.spacing
        shorter = {"run.duration": float(f"{duration:.12g}"), "run.sample": run.spacing}
        scene = self.scene.varied(shorter) if duration < run.duration else self.scene
        return dataclasses.replace(self, scene=scene, blocks=blocks)

    def model(self, run: Trajectory, timing: Sequence[tuple[Coordinate, float]] = ()) -> list[Array]:
        """Predictions for all blocks, by cubic splines through a run's samples; `timing`: unknowns of the times."""
        columns, begin = run.columns, self.scene.initial.time
        return [
            at_times(run.t, columns[block.name], shifted(np.asarray(block.t), begin, block.name, timing))
            for block in self.blocks
        ]


def recorded(problem: FitProblem, run: FitRun) -> Source:
    """Read a recorded run of a problem."""
    scene = problem.scene.varied(run.set) if run.set else problem.scene
    known = dict.fromkeys((*columns_of(lump(open_chain(scene))), *column_names(scene.sensor, scene.arm)))
    measured, offset = _from_start(run, scene, _measured(run, known))
    first, last = run.window or (-math.inf, math.inf)
    first = max(first, scene.initial.time)
    inside = within(measured.t, first, last)
    if inside.sum() < 2:
        text = f"the file covers {measured.t[0]:g} to {measured.t[-1]:g} s"
        text = f"run {run.name!r}: fewer than two samples from {first:g} to {last:g} s; {text}"
        raise DataFileError(text, id="too-few-samples")
    t, heads = np.maximum(measured.t[inside], scene.initial.time), _by_name(run, known, measured.columns)
    of_sensors = _noise_of_sensors(scene, measured.columns)
    blocks = tuple(
        _block(run, name, column[inside], t, heads, known, of_sensors.get(name, 0.0))
        for name, column in measured.columns.items()
        if np.isfinite(column[inside]).any()
    )
    if not blocks:
        raise DataFileError(f"run {run.name!r}: no measured values inside its window", id="no-measured-values")
    _check_reach(run, scene, blocks)
    if not isinstance(run.file, str):  # times of the column with the highest sampling rate, and the ends of all
        every = [np.asarray(block.t) for block in blocks if len(block.y) > 1]
        of_fastest = min(every, key=lambda times: float(np.median(np.diff(times))), default=t)
        t = np.unique(np.concatenate([t[:1], of_fastest, t[-1:]]))
    rate, smooth, hertz = float((len(t) - 1) / (t[-1] - t[0])), exact(scene, problem.tolerance), slowest_mode(scene)
    sought = (*problem.parameter, *(one for each in problem.run for one in each.parameter))
    if not any(one.path.startswith("sensor") for one in sought):  # other sensors cost time in every run
        names = {block.name for block in blocks}
        sensors = tuple(one for one in smooth.sensor if names & {*column_names((one,), scene.arm)})
        smooth = replace(smooth, sensor=sensors)
    doubts = (*offset, *doubts_of_times(smooth, blocks, t, hertz))
    margin = sum(abs(one.between[1]) * (1.0 if one.timing != "clock" else t[-1] - t[0]) for one in timings(run))
    long = as_long(smooth, t, float(margin))
    return Source(run.name, run.use, long, _with_noise(blocks), rate, in_periods(t, hertz), doubts, float(margin))


def _from_start(run: FitRun, scene: Scene, measured: Measured) -> tuple[Measured, tuple[Diagnostic, ...]]:
    """Measurements with times from the scene's start on, and a note if the record and the scene start apart."""
    furthest = 10.0  # largest time between the start of the scene and of the record, in lengths of the record
    begin, t = scene.initial.time, measured.t
    if run.start is not None and run.start != "unknown":
        zero = float(t[0]) if isinstance(run.start, str) else run.start
        measured = measured._replace(t=begin + (t - zero))
        t = measured.t
    between, late = float(np.median(np.diff(t))), float(t[0]) - begin
    if before := int((~within(t, begin)).sum()):
        text = f"{plural(before, 'sample')} before the scene's start at {begin:g} s not used"
        return measured, (Diagnostic(text, "samples-before-start"),)
    if late <= 1.5 * between or run.window is not None:
        return measured, ()
    text = f"record starts at {t[0]:g} s, the scene at {begin:g} s"
    remedy = "if the scene starts with the record, set start = 'first sample'"
    if late > furthest * (t[-1] - t[0]):
        text = f"run {run.name!r}: {text}: {late:g} s to simulate before it; {remedy}"
        raise DataFileError(text, id="record-starts-late")
    return measured, (Diagnostic(f"{text}; {remedy}", "record-starts-late"),)


def _check_reach(run: FitRun, scene: Scene, blocks: Sequence[Block]) -> None:
    """Refuse tip positions that the arm cannot reach, unless its base floats or a sliding joint has no limits."""
    times = 20.0  # if the range of positions exceeds this multiple of the reach, their unit is wrong
    chain = lump(open_chain(scene))
    reach, ends = chain.reach, chain.hinges[["lower", "upper"]][chain.slides]
    if scene.arm.base.free or not all(np.isfinite(ends[end]).all() for end in ("lower", "upper")):
        return
    for block in blocks:
        far = float(np.ptp(block.y))
        if re.fullmatch(r"tip [xyz] \[m\]", block.name) and far > times * reach:
            text = f"run {run.name!r}: {block.name} ranges over {far:.4g} m, but the arm reaches {reach:.2g} m; if the "
            text += f"column is in mm, name it {block.name.replace('[m]', '[mm]')!r}"
            raise DataFileError(text, id="likely-unit")


def _measured(run: FitRun, known: Mapping[str, object]) -> Measured:
    if run.file:
        return read_measured([Path(file) for file in files_of(run)], known, run.compare)
    where = f"run {run.name!r}"
    return measured_from(where, list(run.columns), table_of(where, run.columns), known, run.compare)


def _by_name(run: FitRun, known: Mapping[str, object], compared: Mapping[str, object]) -> dict[str, dict[str, str]]:
    """Map simulated columns to the file's column heads that a run uses in `noise`, `gain` and `bias`."""
    where, found = f"run {run.name!r}", {}
    for key in ("noise", "gain", "bias", "drift", "delay"):
        found[key] = {named(where, head, known)[0]: head for head in getattr(run, key)}
        for name, head in found[key].items():
            if name not in compared:
                text = f"{where}: {key} of {head!r}: this column is not compared{did_you_mean(head, compared)}"
                raise DataFileError(text, id="no-such-column")
    return found


def _block(
    run: FitRun, name: str, y: Array, t: Array, heads: Mapping[str, Mapping[str, str]], known: Mapping[str, object],
    of_sensor: float,
) -> Block:  # fmt: skip
    measured = np.isfinite(y)
    head = heads["noise"].get(name)
    σ = run.noise[head] * named(run.name, head, known)[1] if head is not None else of_sensor
    return Block(
        name, y[measured], np.full(int(measured.sum()), σ), σ > 0, t[measured], None,
        name in heads["gain"], name in heads["bias"], name in heads["drift"],
    )  # fmt: skip


def _with_noise(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """The blocks, with an assumed standard deviation where the noise is not stated."""
    assumed = 0.01  # assumed deviation, as a fraction of the range of all columns with the same unit
    range_of: dict[str, float] = {}
    for block in blocks:
        range_of[block.unit] = max(range_of.get(block.unit, 0.0), float(np.ptp(block.y)))
    return tuple(b.with_deviation(None if b.stated else assumed * (range_of[b.unit] or 1.0)) for b in blocks)


def exact(scene: Scene, tolerance: float) -> Scene:
    """The scene with settings for differentiable runs (`smooth`), and sensors that are read at every sample."""
    sensors = tuple(replace(one, rate=None) for one in scene.sensor)
    return smooth(replace(scene, sensor=sensors) if sensors else scene, tolerance)


def _noise_of_sensors(scene: Scene, compared: Mapping[str, object]) -> dict[str, float]:
    """Standard deviation of each sensor column, from noise and resolution; refuses compared columns that drift."""
    found = {}
    for one in scene.sensor:
        for name in column_names((one,), scene.arm):
            if one.bias_walk and name in compared:
                text = "a fit has no random walk of a bias; set it to 0"
                raise SceneError(f"sensor.{one.name}.bias_walk = {one.bias_walk!r}: {text}", id="fit-bias-walk")
            found[name] = math.hypot(one.noise, (one.resolution or 0.0) / math.sqrt(12))
    return found


def at_times(t: Array, samples: Array, times: Array) -> Array:
    """Samples (n, …) at times t, interpolated to `times` by cubic splines; outside, the first and last values hold."""
    if len(times) <= len(t) and np.allclose(t[: len(times)], times, rtol=0, atol=1e-9 * max(float(times[-1]), 1e-3)):
        return np.asarray(samples[: len(times)])
    return np.asarray(scipy.interpolate.CubicSpline(t, samples)(np.clip(times, t[0], t[-1])))


# Times of a record, checked against the arm's slowest mode: a record shows a mode if it covers at least a tenth of the
# mode's period, with two or more samples per period.


def slowest_mode(scene: Scene) -> float:
    """Natural frequency of the slowest elastic mode at rest, with driven joints locked [Hz]; nan if there is none."""
    try:
        chain = lump(scene)
        wrench, frame = initial_wrench(scene, chain)
        return first_elastic_frequency(chain, initial_state(scene, chain)[0], tip_wrench=wrench, frame=frame)
    except FlexlinkError:  # for example, an arm without a static equilibrium
        return np.nan


def in_periods(t: Array, hertz: float) -> str:
    """Text with the length of a record and the number of periods of the slowest mode that it contains."""
    length = float(t[-1] - t[0])
    periods = f", {length * hertz:.3g} periods of the slowest mode, {hertz:.3g} Hz" if hertz > 0 else ""
    return f"{length:.4g} s{periods}"


def doubts_of_times(scene: Scene, blocks: Sequence[Block], t: Array, hertz: float) -> tuple[Diagnostic, ...]:
    """Warnings about the times t of a record, shape (samples,) [s]."""
    shown = 0.1  # smallest length of a record that shows the slowest mode, in periods of this mode
    length, between = float(t[-1] - t[0]), float(np.median(np.diff(t)))
    if length * hertz < shown:
        text = f"the record is {length:.3g} s long, {length * hertz:.2g} of a period of the slowest mode, "
        text += f"{hertz:.3g} Hz: record a period or more; if its times are in s, name the column 't [s]'"
        return (Diagnostic(text, "record-too-short"),)
    if not 2 * between * hertz > 1:
        return ()
    spacing = f"samples are {between:.3g} s apart, {length:.4g} s in total: too far apart for the mode of "
    spacing += f"{hertz:.3g} Hz, which needs a sample every {1 / (2 * hertz):.2g} s or less"
    if not _swings(scene, blocks, hertz, between):
        return (Diagnostic(f"{spacing}; this mode is not excited", "sampling-too-slow"),)
    text = f"{spacing}, and which the simulation excites; if the times are in ms, name the column 't [ms]'"
    raise DataFileError(text, id="likely-unit")


def as_long(scene: Scene, t: Array, margin: float = 0.0) -> Scene:
    """The scene with a run as long as the record, at its times if possible; with a `margin` [s] longer and finer."""
    finer = 4  # samples of the run per sample of the record, for times that are shifted
    between = float(np.median(np.diff(t))) / (finer if margin else 1)
    length = float(t[-1]) - scene.initial.time + margin
    for sample in (float(f"{between:.9g}"), scene.run.spacing):
        duration = max(math.ceil(length / sample - 1e-6), 1) * sample
        try:
            return scene.varied({"run.sample": sample, "run.duration": float(f"{duration:.12g}")})
        except FlexlinkError as error:
            reason = error
    raise reason


def _swings(scene: Scene, blocks: Sequence[Block], hertz: float, between: float) -> bool:
    """Whether the simulation deviates from a spline through its samples by a large part of the measured range.

    The simulation covers several periods of the slowest mode and enough samples for a spline. If that takes too long,
    a straight line replaces the spline.
    """
    periods, most, per_period = 20, 400, 20  # smallest and largest number of periods; samples per period
    few = 8  # smallest number of the record's samples that the simulation covers
    part = 0.1  # smallest deviation from the spline that counts, relative to the measured range
    every = max(round(between * hertz * per_period), 1)
    count = min(max(periods * per_period, few * every), most * per_period)
    t = np.asarray(scene.initial.time + between / every * np.arange(count), np.float64)
    try:
        run = simulate(as_long(scene, t))
    except FlexlinkError:  # the error is reported when the run itself is needed
        return False
    for block in blocks:
        y = scipy.interpolate.CubicSpline(run.t, run.columns[block.name])(t)
        if count > few * every // 2:
            inside = slice(None, (count - 1) // every * every + 1)
            between_samples = y[inside] - scipy.interpolate.CubicSpline(t[::every], y[::every])(t[inside])
        else:
            between_samples = y - np.polyval(np.polyfit(t - t[0], y, 1), t - t[0])
        if np.ptp(between_samples) > part * np.ptp(block.y):
            return True
    return False


def tapped(problem: FitProblem, part: FitModes, number: int) -> Source:
    """Source of measured natural frequencies and damping ratios."""
    name = f"modes {number}"
    indices = np.array(part.numbers or range(1, len(part.hertz) + 1)) - 1
    σ = np.broadcast_to(np.array(part.deviation), len(part.hertz)).astype(float)
    blocks = [Block("frequency [Hz]", np.array(part.hertz), σ, True)]
    if part.ratios:
        ratios = np.array(part.ratios)
        blocks.append(Block("damping ratio [1]", ratios, np.full(len(ratios), part.ratio_deviation), True))

    def of(scene: Scene) -> list[Array]:
        chain, rest, load = at_rest(scene)
        found = modes(chain, rest.q, **load, locked=chain.active.tolist() if part.locked is None else list(part.locked))
        elastic = np.flatnonzero(np.array(found.kinds) == "elastic")
        if len(elastic) <= indices.max():
            text = f"mode {indices.max() + 1} was measured; the model has only {len(elastic)} elastic modes"
            raise ArgumentError(f"{name}: {text}", id="unknown-mode")
        which = elastic[indices]
        return [found.hertz[which], found.damping_ratios[which]][: len(blocks)]

    scene = problem.scene.varied(part.set) if part.set else problem.scene
    return Source(name, part.use, scene, tuple(blocks), at_rest=of)


def sagged(problem: FitProblem, part: FitStatic, number: int) -> Source:
    """Source of one measured coordinate of the tip at rest, or of the change of this coordinate between two states."""

    def tip(scene: Scene) -> float:
        chain, rest, _ = at_rest(scene)
        return float(tip_position(chain, rest.q)["xyz".index(part.axis)])

    def of(scene: Scene) -> list[Array]:
        return [np.array([tip(scene) - (0.0 if part.before is None else tip(scene.varied(part.before)))])]

    scene = problem.scene.varied(part.set) if part.set else problem.scene
    block = Block(f"tip {part.axis} [m]", np.array([part.value]), np.array([part.deviation]), True)
    return Source(f"static {number}", part.use, scene, (block,), at_rest=of)


def responded(problem: FitProblem, part: FitFrf, number: int) -> Source:
    """Source of a measured frequency response: its real part and its imaginary part."""
    coarse = 0.1  # standard deviation of a logarithm in the first search, which the whole curve then determines
    name, scene = f"frf {number}", problem.scene.varied(part.set) if part.set else problem.scene
    found = measured_response(scene, part, name)

    def parts(scene: Scene) -> list[Array]:
        H = predicted(scene, found.input, found.output, found.f)
        return [H.real.copy(), H.imag.copy()]

    def log_size(scene: Scene) -> list[Array]:
        return [np.log(_not_zero(np.abs(predicted(scene, found.input, found.output, found.f))))]

    magnitude = _not_zero(np.abs(found.H))
    size = Block(f"ln {found.name}", np.log(magnitude), np.maximum(found.σ / magnitude, coarse), True)
    rough = Source(name, part.use, scene, (size,), at_rest=log_size, response=found)
    real = Block(f"Re {found.name}", found.H.real.copy(), found.σ, True)
    imaginary = Block(f"Im {found.name}", found.H.imag.copy(), found.σ, True)
    return Source(name, part.use, scene, (real, imaginary), at_rest=parts, response=found, rough=rough)


def _not_zero(size: Array) -> Array:
    """Magnitudes with zeros, whose logarithm is infinite, replaced by a small part of the largest one."""
    return np.asarray(np.maximum(size, 1e-12 * (size.max() or 1.0)))


def sources_of(problem: FitProblem, use: Use) -> list[Source]:
    """All sources with one use, "fit" or "check"."""
    found: list[Source] = []
    for run in problem.run:
        if run.use == use:
            try:
                found.append(recorded(problem, run))
            except (DataFileError, SceneError) as error:
                text = str(error)
                raise type(error)(text if text.startswith("run ") else f"run {run.name!r}: {text}") from None
    found += [tapped(problem, one, k) for k, one in enumerate(problem.modes, 1) if one.use == use]
    found += [sagged(problem, one, k) for k, one in enumerate(problem.static, 1) if one.use == use]
    found += [responded(problem, one, k) for k, one in enumerate(problem.frf, 1) if one.use == use]
    return found
