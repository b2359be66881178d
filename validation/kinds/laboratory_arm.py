"""A laboratory's two-link arm: strains predicted in held-out recordings, against a linear model of the same order.

On a part of a recording, `fl.fit` identifies 10 parameters of the arm (two root stiffnesses, one damping, two of the
tilt, the second axis' position, two gains, two offsets). The linear model has 12 parameters, or 14 with offsets. Both
models start from rest and are driven by the same accelerations. Both pass the same low-pass filter and minimize the
same sum of squares of the same samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.identification.fitted import Fitted
from flexlink.identification.problem import FitParameter
from validation.case import Case, Measured
from validation.measured import two_link, two_link_ringing
from validation.measured.two_link import STRAINS, Recorder, Split, Window, fit_percent
from validation.store import Series, table

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


def run(
    case: Case,
    ringing: tuple[float, float],
    sought: tuple[FitParameter, ...],
    split: tuple[Split, ...],
    identify: bool = False,
    of: str = "",
) -> Iterator[Measured | Series]:
    """Yield fits of both models in every window of every split.

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


def _identified(stored: Scene, split: Split, found: Fitted) -> Iterator[Measured]:
    """Compare the parameters that `fl.fit` finds with the stored ones, and count those that the data determine."""
    sought = [one for one in found.numbers if one.path]
    for one in sought:
        (value,) = stored.values_at(one.path)
        note = f"Found {one.value:.4g} ({one.low:.3g} … {one.high:.3g}), stored {value:.4g}: {one.verdict}."
        facts = {"situation": f"{one.path}; identified on {split.fitted.name}"}
        yield Measured("identified / stored − 1", abs(one.value / value - 1), stored.name, varied=facts, note=note)
    count = sum(one.doubt is None for one in sought)
    facts = {"situation": f"identified on {split.fitted.name}"}
    yield Measured("parameters that the data determine", count, stored.name, varied=facts)


def _scattered(identified: Sequence[Scene]) -> Iterator[Measured]:
    """Yield the standard deviation of the ringing over the parameters identified from different data."""
    found = [two_link_ringing.predicted(scene) for scene in identified]
    for name in found[0]:
        values = np.array([each[name] for each in found])
        note = f"Values: {', '.join(f'{value:.4g}' for value in values)}."
        scatter, facts = float(values.std(ddof=1)), {"situation": name}
        yield Measured("scatter of the ringing", scatter, identified[0].name, varied=facts, note=note)
