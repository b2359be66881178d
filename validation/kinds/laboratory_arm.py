"""A laboratory's two-link arm: strains predicted in held-out recordings, against a linear model of the same order.

On the first half of one recording, `fl.fit` identifies 10 parameters of the arm (two root stiffnesses, one damping, two
of the tilt, the second axis' position, two gains, two offsets). The linear model has 12 parameters, or 14 with offsets.
Both models start from rest and are driven by the same accelerations. Both pass the same low-pass filter and minimize
the same sum of squares of the same samples.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.identification.problem import FitParameter
from validation.case import Case, Measured
from validation.measured import two_link
from validation.measured.two_link import FITTED, HELD_OUT, STRAINS, Window, fit_percent
from validation.store import Series, table

LINEAR = "the linear model", "the linear model with zeros"
ALIKE = 0.1  # assumed noise of both strains [deg]; it is equal, so both have equal weight, as in the linear model
NAMES = [strain.partition(" [")[0] for strain in STRAINS]


class Run(NamedTuple):
    """A recording, and the run of the scene in which the joints follow the recorded angles."""

    t: Array
    h: float
    strains: list[Array]
    model: list[Array]
    accelerations: Array


def run(
    case: Case, ringing: tuple[float, float], sought: tuple[FitParameter, ...], identify: bool = False
) -> Iterator[Measured | Series]:
    """Yield fits of both models in every window; with `identify`, also repeat the identification of the parameters.

    `ringing` are the frequencies with both drives at rest [Hz], the initial guess of the linear model.
    """
    (scene,) = case.load_scenes()
    runs = {name: _run(scene, name) for name in dict.fromkeys(window.run for window in (FITTED, *HELD_OUT))}
    first = runs[FITTED.run]
    seen = first.accelerations, first.strains, first.h, FITTED.of(first.t), ringing
    linear = {name: two_link.linear_model(*seen, zeros=name.endswith("zeros")) for name in LINEAR}
    rows = []
    for window in (FITTED, *HELD_OUT):
        run, which = runs[window.run], "identified on" if window is FITTED else "held out"
        given = {name: list(model.strains(run.accelerations, run.h).T) for name, model in linear.items()}
        theirs = {name: _fits(run, window, strains) for name, strains in given.items()}
        for k, ours in enumerate(_fits(run, window, run.model)):
            facts = {"situation": f"{window.name}, {NAMES[k]}"}
            yield Measured(f"fit, {which}", ours, scene.name, varied=facts)
            for name, fits in theirs.items():
                yield Measured(f"fit of {name}, {which}", fits[k], scene.name, varied=facts)
                if window is not FITTED:
                    yield Measured(f"ahead of {name}", ours - fits[k], scene.name, varied=facts)
            rows.append((facts["situation"], which, *(fits[k] for fits in theirs.values()), ours))
    heads = "what", "use", "free linear model, 12 numbers", "the same with zeros, 14", "flexlink, 10 numbers"
    columns = table(heads, rows)
    yield Series("held out", case.title, columns, "what", "", "fit [%]", group="use")
    yield from _changed_by_a_finer_grid(scene, first)
    yield from _zeros(scene, first)
    if identify:
        yield from _identified(scene, sought)


def _changed_by_a_finer_grid(scene: Scene, first: Run) -> Iterator[Measured]:
    """Yield how much the fits change if the number of hinges of both links is doubled and the step is halved."""
    hinges = {f"link.{link.name}.segments": 2 * link.segments - 1 for link in scene.arm.links}
    finer = _run(scene.varied({**hinges, "run.step": scene.run.fixed_step / 2}), FITTED.run)
    for window in (each for each in (FITTED, *HELD_OUT) if each.run == FITTED.run):
        pairs = zip(NAMES, _fits(finer, window, finer.model), _fits(first, window, first.model), strict=True)
        for name, fine, coarse in pairs:
            facts = {"situation": f"{window.name}, {name}"}
            yield Measured("fit, changed by a finer grid", abs(fine - coarse), scene.name, varied=facts)


def _zeros(scene: Scene, first: Run) -> Iterator[Measured]:
    """Strains at the start, which the recorder sets to 0: gravity on the tilted arm should explain the offsets."""
    for k, (name, sensor) in enumerate(zip(NAMES, scene.sensor, strict=True)):
        note = f"Zero {sensor.bias:.3f} deg; at rest gravity gives {first.model[k][0] - sensor.bias:.3f} deg."
        off = abs(first.model[k][0] / sensor.bias)
        yield Measured("reading at the start / zero", off, scene.name, varied={"situation": name}, note=note)


def _run(scene: Scene, name: str) -> Run:
    end = max(window.end for window in (FITTED, *HELD_OUT) if window.run == name)
    columns, accelerations = two_link.simulated(scene, name, end)
    measured, n = two_link.recorded(name), len(accelerations)
    t = measured["t [s]"][:n]
    strains, model = ([source[each][:n] for each in STRAINS] for source in (measured, columns))
    return Run(t, float(t[1] - t[0]), strains, model, accelerations)


def _fits(run: Run, window: Window, model: Sequence[Array]) -> list[float]:
    """Fit of each strain in a window [%]."""
    there = window.of(run.t)
    return [fit_percent(y[there], given[there]) for y, given in zip(run.strains, model, strict=True)]


def _identified(scene: Scene, sought: tuple[FitParameter, ...]) -> Iterator[Measured]:
    """Compare the parameters that `fl.fit` finds on the first half of a recording with the scene's parameters."""
    with tempfile.TemporaryDirectory() as folder:
        path = two_link.write_renamed(FITTED.run, Path(folder))
        known: dict[str, Any] = {"motion": two_link.led_by(path), "run.duration": FITTED.end}
        recording = fl.fits.FitRun(
            name=FITTED.name,
            file=str(path),
            window=(FITTED.start, FITTED.end),
            compare=STRAINS,
            gain=STRAINS,
            bias=STRAINS,
            noise=dict.fromkeys(STRAINS, ALIKE),
            set=known,
        )
        found = fl.fit(fl.fits.FitProblem(scene=scene, parameter=sought, run=(recording,), noise="white"))
    for each in sought:
        (stored,), value = scene.values_at(each.path), found[each.path].value
        note = f"Found {value:.4g}, in the scene {stored:.4g}."
        yield Measured(
            "identified / stored − 1", abs(value / stored - 1), scene.name, varied={"measure": each.path}, note=note
        )
