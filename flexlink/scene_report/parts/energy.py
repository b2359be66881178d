"""Energy and power balance of the run, which shows the effect of the discretisation on the energy."""

import numpy as np

from flexlink.dynamics import rounding
from flexlink.pages.numbers import number, percent
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import stacked_axes, tidy_linear
from flexlink.pages.verdict import State, Verdict
from flexlink.results.plotting import panels
from flexlink.results.trajectory import Trajectory
from flexlink.scene_report.study import Study


def made(study: Study) -> Part | None:
    """Build the chapter."""
    run = study.run
    if len(run.t) < 2:
        return None
    imbalance, exchanged = np.abs(run.imbalance), float(run.exchanged[-1])
    worst = int(np.argmax(imbalance))
    share = float(imbalance[worst]) / exchanged if exchanged > 0 else 0.0
    assert run.work is not None
    once = rounding.of_energy_balance(run.chain, run.energy.parts, run.work, run.q)  # rounding error of one evaluation
    steps = run.steps.taken if run.steps is not None else 0
    nothing = 1e6  # the arm counts as at rest if it exchanges less energy than this multiple of the rounding error
    still = exchanged <= nothing * float(once[-1])
    of = f", {percent(share)} of the {number(exchanged)} J exchanged"
    of = "; the arm is at rest and exchanges no energy" if still else of
    text = f"Largest energy error: {number(imbalance[worst])} J at {number(run.t[worst])} s{of}."
    meant = (
        "Energy error = E − E(0) − W. E: kinetic, gravity and elastic energy. W: work of drives, friction, damping and "
        "tip wrench, integrated with the run’s own method. Causes of the error: time steps and rounding."
    )
    good = 1e-3  # acceptable fraction of the exchanged energy; the run fails from a fraction of 0.1 on
    state: State = "pass" if share <= good or still or bool((imbalance <= (1 + steps) * once).all()) else "doubt"
    verdict = Verdict("Energy", state, "balanced" if state == "pass" else "poorly balanced", text)
    return Part((text, meant), (verdict,), (_picture(run),))


def _picture(run: Trajectory) -> Picture:
    drawn = [draw for name, draw in panels(run) if name in ("energy", "elastic", "balance")]
    _, axes = stacked_axes(len(drawn), 1.8)
    for draw, panel in zip(drawn, axes, strict=True):
        draw(panel)
        tidy_linear(panel)
    columns = {name: column for name, column in run.columns.items() if name == "t [s]" or name.endswith("[J]")}
    caption = (
        "Top: change of the energies since the start; that of the total is the work W and the energy error (bottom)."
    )
    return picture_of("energy", "Energy balance", caption, axes, "time [s]", columns, each=True)
