"""Energy and power balance of the run, which shows the effect of the discretisation on the energy."""

import numpy as np

from flexlink.dynamics import rounding
from flexlink.pages.colours import BLUE, CYCLE, INK
from flexlink.pages.numbers import number, percent
from flexlink.pages.part import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import stacked_axes, tidy_linear
from flexlink.pages.verdict import State, Verdict
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
    return Part((text, meant), (verdict,), (_picture(study),))


def _picture(study: Study) -> Picture:
    run = study.run
    assert run.work is not None
    bends = study.bends
    _, axes = stacked_axes(3 if bends else 2, 1.8)
    parts = {"kinetic": run.energy.kinetic, "gravity": run.energy.gravity, "elastic": run.energy.elastic}
    columns = {"t [s]": run.t}
    for (name, values), colour in zip(parts.items(), CYCLE, strict=False):
        columns[f"{name} [J]"] = np.asarray(values) - np.asarray(values)[0]
        if name != "elastic":
            axes[0].plot(run.t, columns[f"{name} [J]"], color=colour, label=name)
        elif bends:  # on a separate panel, as it is often thousands of times smaller than the other energies
            axes[1].plot(run.t, columns[f"{name} [J]"], color=colour)
            axes[1].set_ylabel("elastic, change [J]")
            tidy_linear(axes[1])
    axes[0].plot(run.t, run.work, color=INK, linestyle="--", label="work W")
    axes[0].set_ylabel("change [J]")
    axes[-1].plot(run.t, run.imbalance, color=BLUE)
    axes[-1].set_ylabel("energy error [J]")
    tidy_linear(axes[-1])
    columns |= {"work [J]": run.work, "imbalance [J]": run.imbalance}
    middle = " Middle: elastic energy on a separate scale." if bends else ""
    caption = f"Top: change of the energies since the start, and work W done on the arm.{middle} Bottom: energy error."
    return picture_of("energy", "Energy balance", caption, axes, "time [s]", columns, each=True)
