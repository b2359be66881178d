"""Comparison with measurements."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from flexlink.identification import fitted
from flexlink.identification.problem import FitParameter
from validation.case import Case, Measured
from validation.kinds import kind
from validation.measured import stored, two_link, two_link_ringing
from validation.measured.measurements import MEASUREMENTS, Measurement
from validation.measured.one_number import Candidate, Choice, OneNumber, Study, choose
from validation.measured.readings import Reading
from validation.measured.second_way import SEED, close_grids, disagreement, random_points, scatter_of, spread_of_derived
from validation.measured.trends import Trend
from validation.measured.two_link import STRAINS, Recorder, Split, Window, fit_percent
from validation.measured.uncertainty import COVERAGE, VERDICTS, Comparison, grid_convergence, of_one, standard
from validation.store import Series, table

GRIDS = (1, 2, 4)  # multiples of the number of hinges of a link
CLOSE = 0.003  # random errors of fitted inputs, relative to their deviations, which may exceed the values


class Input(Spec, frozen=True, kw_only=True):
    """An input of the model with its tolerance, ± `relative` × value or ± `by`; `path` is its key in the scene."""

    path: str
    relative: float = 0.0
    by: float = 0.0
    reason: str


class Uncertain(Spec, frozen=True, kw_only=True):
    """An input of the model known only from a drawing: anything between `low` and `high`; `path` is its key."""

    path: str
    low: float
    high: float


class MeasuredSettings(Spec, frozen=True, kw_only=True):
    """The measurement, a file of `validation/measured/`; hinges of each link on the coarsest grid; inputs by name.

    `wanted` is the required accuracy |E| / |D| for each group of quantities, which a measurement must be able to
    resolve. `order` is the order of the lumping rule. `rounding` is the smallest relative error assumed for S.
    `draws` is the number of random inputs for the second way to the uncertainties; 0 leaves it out.
    `refits` are values of each quantity with inputs fitted to different data; their scatter is then u_input.
    `drawing` are inputs as a drawing leaves them, by the same rule for all specimens: a root that may yield by 1/20 of
    L / EI, E and thickness to 5 %, masses to 1 %.
    """

    measurement: str
    hinges: dict[str, int]
    order: float
    wanted: dict[str, Positive]
    input: dict[str, Input]
    rounding: Positive = 1e-9
    draws: int = 0
    one_number: OneNumber | None = None
    refits: dict[str, list[float]] = {}  # noqa: RUF012  msgspec copies it
    drawing: dict[str, Uncertain] = {}  # noqa: RUF012


class _Simulated(NamedTuple):
    """Simulated values by name, on each grid, and with each input at both limits of its tolerance; `predict` them.

    `fitted` are the effects of independent parts of the errors of fitted inputs.
    """

    grids: list[dict[str, float]]
    inputs: dict[str, tuple[dict[str, float], dict[str, float]]]
    predict: Callable[[float, Mapping[str, float]], dict[str, float]]  # multiple of the hinges, values by path
    fitted: dict[str, dict[str, float]]

    def u_input(self, name: str) -> dict[str, float]:
        """Standard uncertainty of a simulated value due to each input."""
        return {which: abs(effects[name]) for which, effects in self.effects().items()}

    def effects(self) -> dict[str, dict[str, float]]:
        """Input → standard uncertainty of every simulated value, with the sign of its derivative."""
        return {
            which: {
                name: math.copysign(standard(abs(high[name] - low[name]) / 2), high[name] - low[name]) for name in low
            }
            for which, (low, high) in self.inputs.items()
        } | self.fitted


@kind
def measured(case: Case, settings: MeasuredSettings) -> Iterator[Measured | Series]:
    """Comparison with measurements: error of every quantity, its validation uncertainty (ASME V&V 20), and a verdict.

    No parameters are fitted for the verdicts; the scene contains the values that the source of the measurement states,
    with tolerances, or values that were fitted to other quantities. Beside the verdicts, one number of the specimen may
    be fitted to one half of the readings to predict the other (`OneNumber`), and the parts of the uncertainty may be
    derived a second way (`draws`). Ratios of readings that share their errors are pooled into trends.

    Yield every quantity, then the groups, then the table.
    """
    measurement = require_one_of(f"{case.path}: settings.measurement", settings.measurement, MEASUREMENTS)
    readings = measurement.all_readings()
    simulated = _simulate(case, settings, measurement)
    every = {name: _compared(name, reading, simulated, settings) for name, reading in readings.items()}
    trends = {each.name: each for each in measurement.trends(readings, simulated.grids[-1])}
    pooled = {each.of for each in trends.values()}
    groups: dict[str, list[Comparison]] = {}
    for name, reading in readings.items():
        groups.setdefault(reading.group, []).append(every[name])
        if reading.group not in pooled:
            yield _measured(name, reading, every[name], _parts(name, simulated, settings))
    for group, found in groups.items():
        yield from _of_group(group, found, pooled)
    yield from (_of_trend(each) for each in trends.values())
    compared = {name: each for name, each in every.items() if readings[name].group not in pooled}
    held_out = dict(compared) if measurement.fitted else {}
    if settings.one_number:
        choices, held_out = _held_out(case, settings.one_number, readings, simulated, every)
        yield from choices
    for group in groups:
        yield from _of_held_out(group, {name: each for name, each in held_out.items() if readings[name].group == group})
    rows = [_row(name, readings[name].group, readings[name].unit, each, held_out) for name, each in compared.items()]
    rows += [_row(each.name, each.of, "1", each.compared(settings.wanted[each.of]), {}) for each in trends.values()]
    columns = table(COLUMNS, rows)
    yield Series("measured", case.title, columns, "quantity", "", "E", group="group")
    yield Measured("differs from what the site shows", stored.difference(case.name, columns))
    if settings.drawing:
        ends = [
            [simulated.predict(1, {each.path: x}) for x in (each.low, each.high)] for each in settings.drawing.values()
        ]
        yield from _intervals({name: every[name] for name in measurement.readings()}, simulated.grids[0], ends)
    if settings.draws:
        yield from _second_way(case, settings, measurement, simulated, every)


COLUMNS = (
    "quantity", "group", "unit", "S", "D", "E", "u_num", "GCI", "order", "u_input", "u_D", "u_val", "wanted", "verdict",
    "held out S", "held out u_val", "held out verdict",
)  # fmt: skip


def _row(
    name: str, group: str, unit: str, c: Comparison, held_out: Mapping[str, Comparison]
) -> tuple[str | float, ...]:
    """Columns of a quantity; the last three with one number fitted, empty for a quantity that was not held out."""
    order, index = c.convergence
    numbers = c.simulated, c.measured, c.error, c.convergence.u_num, index, order, c.u_input, c.u_measured, c.u_val
    other = held_out.get(name)
    last = (other.simulated, other.u_val, other.verdict) if other else (math.nan, math.nan, "")
    return name, group, unit, *numbers, c.wanted, c.verdict, *last


def _simulate(case: Case, settings: MeasuredSettings, measurement: Measurement) -> _Simulated:
    (scene,) = case.load_scenes()

    def predict(times: float, values: Mapping[str, float]) -> dict[str, float]:
        grid = {f"link.{link}.segments": round(times * n) + 1 for link, n in settings.hinges.items()}
        return measurement.predict(scene.varied({**grid, **values}))

    grids = [predict(times, {}) for times in GRIDS]
    inputs = {
        name: (predict(1, {each.path: low}), predict(1, {each.path: high}))
        for name, each in settings.input.items()
        for low, high in [_range(scene, each)]
    }
    fitted = {} if measurement.fitted is None else measurement.fitted(scene).effects(lambda values: predict(1, values))
    return _Simulated(grids, inputs, predict, fitted)


def _range(scene: Scene, varied: Input) -> tuple[float, float]:
    """Smallest and largest value of an input."""
    (value,) = scene.values_at(varied.path)
    off = varied.by + varied.relative * abs(value)
    return value - off, value + off


def _parts(name: str, simulated: _Simulated, settings: MeasuredSettings) -> dict[str, float]:
    """Standard uncertainty of a simulated value due to each input, or due to what its fitted inputs were fitted to."""
    return {"refits": of_one(settings.refits[name])} if settings.refits else simulated.u_input(name)


def _compared(name: str, reading: Reading, simulated: _Simulated, settings: MeasuredSettings) -> Comparison:
    require_one_of("settings.wanted", reading.group, settings.wanted)
    coarse, middle, fine = (values[name] for values in simulated.grids)
    convergence = grid_convergence(coarse, middle, fine, settings.order, settings.rounding * abs(fine))
    u_input = math.hypot(*_parts(name, simulated, settings).values())
    wanted = settings.wanted[reading.group] * abs(reading.value)
    return Comparison(fine, reading.value, convergence, u_input, reading.u, wanted)


def _measured(name: str, reading: Reading, compared: Comparison, inputs: Mapping[str, float]) -> Measured:
    """The error of a quantity relative to the measured value D, as a separate quantity if D is uncertain."""
    parts = ", ".join(f"{which} {u:.2g}" for which, u in sorted(inputs.items(), key=lambda item: -item[1])) or "nothing"
    precise = COVERAGE * compared.u_measured <= compared.wanted
    quantity = f"|E| / |D|, {reading.group}" + ("" if precise else ", read too coarsely")
    note = f"{compared.words(reading.unit)} Of u_input: {parts}."
    return Measured(quantity, abs(compared.error / compared.measured), varied={"situation": name}, note=note)


def _rms(found: Iterable[Comparison]) -> float:
    return math.sqrt(float(np.mean([(c.error / c.measured) ** 2 for c in found])))


def _of_group(group: str, found: list[Comparison], pooled: Collection[str]) -> Iterator[Measured]:
    if len(found) > 1:
        yield Measured(f"root mean square of E / D, {group}", _rms(found))
    for verdict in VERDICTS if group not in pooled else ():
        yield Measured(verdict, sum(c.verdict == verdict for c in found), varied={"situation": group})


def _of_trend(trend: Trend) -> Measured:
    note = (
        f"Measured over computed trend: {trend.factor:.3f} ± {COVERAGE * trend.u:.3f}, pooled over {trend.freedom} "
        f"ratios with their common errors; misfit χ² = {trend.misfit:.1f}, expected {trend.freedom}."
    )
    return Measured("measured / computed trend", trend.factor, varied={"situation": trend.name}, note=note)


def _of_held_out(group: str, found: Mapping[str, Comparison]) -> Iterator[Measured]:
    """Yield how the readings of a group that were held out agree; those that cannot be decided are not counted."""
    decided = [c for c in found.values() if c.verdict != VERDICTS[2]]
    if not found:
        return
    agree = [c for c in decided if c.verdict == VERDICTS[0]]
    left = f"; {len(found) - len(decided)} more cannot be decided" if len(decided) < len(found) else ""
    note = f"{len(agree)} of {len(decided)}{left}."
    yield Measured(f"agree when held out, {group}", len(agree), note=note)
    yield Measured(f"root mean square of E / D when held out, {group}", _rms(decided) if decided else math.nan)
    if agree:
        shown = [100 * COVERAGE * c.u_val / abs(c.measured) for c in agree]
        note = f"From ± {min(shown):.2g} to ± {max(shown):.2g} %."
        yield Measured(f"accuracy shown, {group}", float(np.median(shown)), note=note)


def _second_way(
    case: Case,
    settings: MeasuredSettings,
    measurement: Measurement,
    simulated: _Simulated,
    every: Mapping[str, Comparison],
) -> Iterator[Measured]:
    """Yield, for each part of u_val, the largest disagreement of the two ways that lead to it."""
    (scene,) = case.load_scenes()
    inputs = _random_inputs(scene, settings, measurement, simulated)
    _, two, four = simulated.grids
    three = simulated.predict(3, {})
    grids = {name: close_grids(two[name], three[name], four[name], settings.order).u_num for name in every}
    yield _agreement(
        "u_input",
        f"{settings.draws} random inputs",
        {n: math.hypot(*simulated.u_input(n).values()) for n in every},
        inputs,
        every,
    )
    numeric = {name: c.convergence.u_num for name, c in every.items()}
    yield _agreement("u_num", "grids of 2N, 3N and 4N hinges", numeric, grids, every)
    if measurement.u_again:
        again = measurement.u_again(four) | spread_of_derived(measurement.derived(), measurement.readings())
        yield _agreement("u_D", "scatter or random readings", {n: c.u_measured for n, c in every.items()}, again, every)


def _random_inputs(
    scene: Scene, settings: MeasuredSettings, measurement: Measurement, simulated: _Simulated
) -> dict[str, float]:
    """Standard deviation of each quantity over random inputs; fitted inputs vary apart from those with tolerances."""
    found = dict.fromkeys(simulated.grids[0], 0.0)
    ranges = {each.path: _range(scene, each) for each in settings.input.values()}
    if ranges:
        values = [
            {
                path: low + (1 + x) / 2 * (high - low)
                for x, (path, (low, high)) in zip(point, ranges.items(), strict=True)
            }
            for point in random_points(settings.draws, len(ranges))
        ]
        found = scatter_of([simulated.predict(1, each) for each in values])
    if measurement.fitted is not None:
        close = measurement.fitted(scene).drawn(settings.draws, CLOSE, SEED)
        scatter = scatter_of([simulated.predict(1, each) for each in close])
        found = {name: math.hypot(u, scatter[name] / CLOSE) for name, u in found.items()}
    return found


def _agreement(
    part: str, how: str, first: Mapping[str, float], second: Mapping[str, float], every: Mapping[str, Comparison]
) -> Measured:
    off = {name: disagreement(first[name], u, every[name].u_val) for name, u in second.items()}
    worst = max(off, key=lambda name: off[name])
    note = f"{part} of “{worst}” = {first[worst]:.3g}, a second way ({how}) {second[worst]:.3g}: most of {len(off)}."
    return Measured("second way", off[worst], varied={"part": part}, note=note)


def _intervals(
    every: Mapping[str, Comparison], coarse: Mapping[str, float], ends: Sequence[Sequence[Mapping[str, float]]]
) -> Iterator[Measured]:
    """Yield the share of readings in the 95 % interval of a prediction from a drawing, and its width.

    `ends` are the predictions on the coarsest grid at both limits of each input, between which it is rectangular.
    """
    inside, widths = [], []
    for name, c in every.items():
        middle = c.simulated + sum((low[name] + high[name]) / 2 - coarse[name] for low, high in ends)
        parts = [standard(abs(high[name] - low[name]) / 2) for low, high in ends]
        half = COVERAGE * math.hypot(*parts, c.convergence.u_num, c.u_measured)
        inside.append(abs(c.measured - middle) <= half)
        widths.append(half / abs(c.measured))
    note = f"{sum(inside)} of {len(inside)}."
    yield Measured("share of readings in the interval of a drawing", float(np.mean(inside)), note=note)
    yield Measured("half width of the interval of a drawing", float(np.median(widths)))


def _held_out(
    case: Case,
    wanted: OneNumber,
    readings: Mapping[str, Reading],
    simulated: _Simulated,
    every: Mapping[str, Comparison],
) -> tuple[list[Measured], dict[str, Comparison]]:
    """The number chosen in each half, and every reading compared with the number of the half that it is not in."""
    (scene,) = case.load_scenes()
    known = {name: reading for name, reading in readings.items() if reading.group in (*wanted.groups, *wanted.beside)}

    @functools.cache  # both halves begin with the same values
    def with_number(path: str, value: float) -> dict[str, float]:
        return simulated.predict(1, {path: value})

    def study(each: Candidate) -> tuple[float, Study]:
        def predict(value: float | None) -> dict[str, float]:
            return simulated.grids[0] if value is None else with_number(each.path, value)

        return each.start or scene.values_at(each.path)[0], Study(every, simulated.effects(), predict)

    first, second = wanted.halves(readings)
    found: dict[str, Comparison] = {}
    lines = []
    for half, label, others in ((first, "first half", {*known} - {*first}), (second, "second half", {*first})):
        choice = choose(wanted, half, known, study)
        found |= {
            name: choice.fitted.others[name] if choice.fitted else every[name] for name in known if name in others
        }
        value = choice.fitted.value if choice.fitted else math.nan
        varied = {"situation": choice.name, "part": label}
        lines.append(Measured("number fitted", value, varied=varied, note=_told(choice, len(half))))
    return lines, {name: found[name] for name in known}


def _told(choice: Choice, readings: int) -> str:
    """The fit in one sentence or two."""
    found = choice.fitted
    if found is None:
        return f"No candidate is determined by the {readings} readings."
    scatter = f", and a scatter of {100 * found.scatter:.2g} % of the readings" if found.scatter else ""
    return (
        f"{choice.name}: {found.value:.4g} {choice.unit}, standard uncertainty {100 * found.u_relative:.2g} %{scatter}."
        f" Misfit of the {readings} readings in units of u_D: {found.before:.2g} → {found.after:.2g}."
    )


LINEAR = "the linear model", "the linear model with zeros"
NAMES = [strain.partition(" [")[0] for strain in STRAINS]
HEADS = "what", "use", "free linear model, 12 numbers", "the same with zeros, 14", "flexlink, 10 numbers"


class Run(NamedTuple):
    """A recording, and the run of the scene in which the joints follow the recorded angles."""

    t: Array
    recorder: Recorder
    strains: list[Array]
    model: list[Array]
    accelerations: Array


@kind
def laboratory_arm(
    case: Case,
    ringing: tuple[float, float],
    sought: tuple[FitParameter, ...],
    split: tuple[Split, ...],
    identify: bool = False,
    of: str = "",
) -> Iterator[Measured | Series]:
    """A laboratory's two-link arm: strains predicted in held-out recordings, against a linear model of the same order.

    On a part of a recording, `fl.fit` identifies 10 parameters of the arm (two root stiffnesses, one damping, two of
    the tilt, the second axis' position, two gains, two offsets). The linear model has 12 parameters, or 14 with
    offsets. Both models start from rest and are driven by the same accelerations. Both pass the same low-pass filter
    and minimize the same sum of squares of the same samples.

    Yield fits of both models in every window of every split.

    With `identify`, parameters are identified again, and compared with the stored ones; otherwise they are those of the
    scene and of the split. `ringing` are the frequencies with both drives at rest [Hz], the initial guess of the linear
    model. `of` names another specimen, in all quantities.
    """
    (scene,) = case.load_scenes()
    rows: list[tuple[str | float, ...]] = []
    identified: list[Scene] = []
    for each in split:
        varied = scene.varied(each.numbers)
        if identify:
            found = each.identified(varied, sought)
            yield from _named(of, _identified(varied, each, found))
            varied = two_link.with_sensors(varied, found)
            identified.append(varied)
        yield from _named(of, _of_split(varied, each, ringing, rows))
    if len(identified) > 1:
        yield from _named(of, _scattered(identified))
    yield Series("held out", case.title, table(HEADS, rows), "what", "", "fit [%]", group="use")


def _named(of: str, found: Iterator[Measured]) -> Iterator[Measured]:
    return (each._replace(quantity=of + each.quantity) for each in found)


def _of_split(
    scene: Scene, split: Split, ringing: tuple[float, float], rows: list[tuple[str | float, ...]]
) -> Iterator[Measured]:
    """Yield the fits of a split; append them to `rows`."""
    runs = {name: _run(scene, split, name) for name in dict.fromkeys(window.recording for window in split.windows)}
    first = runs[split.fitted.recording]
    seen = first.accelerations, first.strains, first.recorder, split.fitted.of(first.t), ringing
    linear = {name: two_link.linear_model(*seen, zeros=name.endswith("zeros")) for name in LINEAR}
    for window in split.windows:
        run, which = runs[window.recording], "identified on" if window is split.fitted else "held out"
        given = {name: list(model.strains(run.accelerations, run.recorder).T) for name, model in linear.items()}
        theirs = {name: _fits(run, window, strains) for name, strains in given.items()}
        own = _fits(run, window, run.model)
        for k, ours in enumerate(own):
            facts = {"situation": _situation(split, window, NAMES[k])}
            yield Measured(f"fit, {which}", ours, scene.name, varied=facts)
            for name, fits in theirs.items():
                yield Measured(f"fit of {name}, {which}", fits[k], scene.name, varied=facts)
                if window is not split.fitted:
                    yield Measured(f"ahead of {name}", ours - fits[k], scene.name, varied=facts)
            rows.append((facts["situation"], which, *(fits[k] for fits in theirs.values()), ours))
        for name, fits in theirs.items() if window is not split.fitted else ():
            facts = {"situation": _situation(split, window, "both strains")}
            yield Measured(f"ahead of {name}, both strains", (sum(own) - sum(fits)) / 2, scene.name, varied=facts)
    yield from _changed_by_a_finer_grid(scene, split, first)
    yield from _zeros(scene, split, first)


def _situation(split: Split, window: Window, strain: str) -> str:
    return f"{window.name}, {strain}" + (f"; identified on {split.fitted.name}" if window is not split.fitted else "")


def _changed_by_a_finer_grid(scene: Scene, split: Split, first: Run) -> Iterator[Measured]:
    """Yield how much the fits change if the number of hinges of both links is doubled and the step is halved."""
    hinges = {f"link.{link.name}.segments": 2 * link.segments - 1 for link in scene.arm.links}
    changes = {**hinges, "run.step": scene.run.fixed_step / 2}
    finer = _run(scene.varied(changes), split, split.fitted.recording)
    for window in (each for each in split.windows if each.recording == split.fitted.recording):
        pairs = zip(NAMES, _fits(finer, window, finer.model), _fits(first, window, first.model), strict=True)
        for name, fine, coarse in pairs:
            facts = {"situation": _situation(split, window, name)}
            yield Measured("fit, changed by a finer grid", abs(fine - coarse), scene.name, varied=facts)


def _zeros(scene: Scene, split: Split, first: Run) -> Iterator[Measured]:
    """Strains at the start, which the recorder sets to 0: gravity on the tilted arm should explain the offsets."""
    for k, (name, sensor) in enumerate(zip(NAMES, scene.sensor, strict=True)):
        note = f"Zero {sensor.bias:.3f} deg; at rest gravity gives {first.model[k][0] - sensor.bias:.3f} deg."
        off = abs(first.model[k][0] / sensor.bias)
        facts = {"situation": f"{name}; identified on {split.fitted.name}"}
        yield Measured("reading at the start / zero", off, scene.name, varied=facts, note=note)


def _run(scene: Scene, split: Split, recording: str) -> Run:
    end = max(window.end for window in split.windows if window.recording == recording)
    columns, accelerations = two_link.simulated(scene, recording, end)
    measured, n = two_link.recorded(recording), len(accelerations)
    t = measured["t [s]"][:n]
    strains, model = ([source[each][:n] for each in STRAINS] for source in (measured, columns))
    return Run(t, Recorder.of(scene, float(t[1] - t[0])), strains, model, accelerations)


def _fits(run: Run, window: Window, model: Sequence[Array]) -> list[float]:
    """Fit of each strain in a window [%]."""
    there = window.of(run.t)
    return [fit_percent(y[there], given[there]) for y, given in zip(run.strains, model, strict=True)]


def _identified(known: Scene, split: Split, found: fitted.Fitted) -> Iterator[Measured]:
    """Compare the parameters that `fl.fit` finds with the stored ones, and count those that the data determine."""
    sought = [one for one in found.numbers if one.path]
    for one in sought:
        (value,) = known.values_at(one.path)
        note = f"Found {one.value:.4g} ({one.low:.3g} … {one.high:.3g}), stored {value:.4g}: {one.verdict}."
        facts = {"situation": f"{one.path}; identified on {split.fitted.name}"}
        yield Measured("identified / stored − 1", abs(one.value / value - 1), known.name, varied=facts, note=note)
    count = sum(one.doubt is None for one in sought)
    facts = {"situation": f"identified on {split.fitted.name}"}
    yield Measured("parameters that the data determine", count, known.name, varied=facts)


def _scattered(identified: Sequence[Scene]) -> Iterator[Measured]:
    """Yield the standard deviation of the ringing over the parameters identified from different data."""
    found = [two_link_ringing.predicted(scene) for scene in identified]
    for name in found[0]:
        values = np.array([each[name] for each in found])
        note = f"Values: {', '.join(f'{value:.4g}' for value in values)}."
        scatter, facts = float(values.std(ddof=1)), {"situation": name}
        yield Measured("scatter of the ringing", scatter, identified[0].name, varied=facts, note=note)
