"""A laboratory's two-link arm: strains predicted in held-out recordings, beside a free linear model of that order.

What is identified is said: of the arm two roots, one damping and two gains, 5 numbers, by `fl.fit` on the first half of
one recording; of the linear model 12, on the same.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.measured import two_link
from validation.measured.two_link import FITTED, HELD_OUT, STRAINS, Window, fit_percent
from validation.store import Series, table


class Sought(Spec, frozen=True):
    """A number that is identified, and its bounds."""

    path: str
    between: tuple[float, float]


class Run(NamedTuple):
    """A recording beside the scene's run with the recorded angles."""

    t: Array
    h: float
    strains: list[Array]
    model: list[Array]
    accelerations: Array


def run(
    case: Case, ringing: tuple[float, float], sought: tuple[Sought, ...], identify: bool = False
) -> Iterator[Measured | Series]:
    """Fits of both models in every window; with `identify` the numbers found anew, beside the scene's.

    `ringing` are the frequencies with both drives at rest [Hz], where the linear model begins.
    """
    (scene,) = case.load_scenes()
    runs = {name: _run(scene, name) for name in dict.fromkeys(window.run for window in (FITTED, *HELD_OUT))}
    first = runs[FITTED.run]
    linear = two_link.linear_model(first.accelerations, first.strains, first.h, FITTED.of(first.t), ringing)
    rows = []
    for window in (FITTED, *HELD_OUT):
        which = "identified on" if window is FITTED else "held out"
        for name, ours, theirs in _fits(runs[window.run], window, linear):
            facts = {"situation": f"{window.name}, {name}"}
            yield Measured(f"fit, {which}", ours, scene.name, varied=facts)
            yield Measured(f"fit of the linear model, {which}", theirs, scene.name, varied=facts)
            if window is not FITTED:
                same = "same recording" if window.run == FITTED.run else "another recording"
                yield Measured(f"ahead of the linear model, {same}", ours - theirs, scene.name, varied=facts)
            rows.append((f"{window.name}, {name}", which, theirs, ours))
    finer = _run(scene.varied(_finer(scene)), FITTED.run)
    for window in (each for each in (FITTED, *HELD_OUT) if each.run == FITTED.run):
        pairs = zip(_fits(finer, window, linear), _fits(first, window, linear), strict=True)
        for (name, fine, _), (_, coarse, _) in pairs:
            facts = {"situation": f"{window.name}, {name}"}
            yield Measured("fit, changed by a finer grid", abs(fine - coarse), scene.name, varied=facts)
    columns = table(("what", "use", "free linear model, 12 numbers", "flexlink, 5 numbers"), rows)
    yield Series("held out", case.title, columns, "what", "", "fit [%]", group="use")
    if identify:
        yield from _identified(scene, sought)


def _finer(scene: Scene) -> dict[str, float | int]:
    """Twice the hinges of both links, and half the step."""
    hinges = {f"link.{link.name}.segments": 2 * link.segments - 1 for link in scene.arm.links}
    return {**hinges, "run.step": scene.run.fixed_step / 2}


def _run(scene: Scene, name: str) -> Run:
    end = max(window.end for window in (FITTED, *HELD_OUT) if window.run == name)
    columns, accelerations = two_link.simulated(scene, name, end)
    measured, n = two_link.recorded(name), len(accelerations)
    t = measured["t [s]"][:n]
    strains, model = ([source[each][:n] for each in STRAINS] for source in (measured, columns))
    return Run(t, float(t[1] - t[0]), strains, model, accelerations)


def _fits(run: Run, window: Window, linear: two_link.LinearModel) -> Iterator[tuple[str, float, float]]:
    """Of each strain its name, the fit of the scene and that of the linear model [%]."""
    there, free = window.of(run.t), linear.strains(run.accelerations, run.h)
    for k, name in enumerate(STRAINS):
        y = run.strains[k][there]
        yield name.partition(" [")[0], fit_percent(y, run.model[k][there]), fit_percent(y, free[there, k])


def _identified(scene: Scene, sought: tuple[Sought, ...]) -> Iterator[Measured]:
    """What `fl.fit` finds on the first half, beside the numbers of the scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = two_link.write_renamed(FITTED.run, Path(folder))
        known: dict[str, Any] = {"motion": two_link.led_by(path), "run.duration": FITTED.end}
        recording = fl.FitRun(
            name=FITTED.name,
            file=str(path),
            window=(FITTED.start, FITTED.end),
            compare=STRAINS,
            gain=STRAINS,
            set=known,
        )
        parameters = tuple(fl.FitParameter(path=each.path, between=each.between) for each in sought)
        found = fl.fit(fl.FitProblem(scene=scene, parameter=parameters, run=(recording,)))
    for each in sought:
        (stored,), value = scene.values_at(each.path), found[each.path].value
        note = f"Found {value:.4g}, in the scene {stored:.4g}."
        yield Measured(
            "identified / stored − 1", abs(value / stored - 1), scene.name, varied={"measure": each.path}, note=note
        )
