"""Natural frequencies and mode shapes about the static equilibrium, driven joints locked or ties closed."""

import numpy as np

from flexlink.dynamics.vibration.modal import Modes, modes
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH
from flexlink.pages.tables import Cell, Table, table_csv
from flexlink.pages.verdict import Fact
from flexlink.results.convergence import resolved
from flexlink.results.plotting import path_of, plot_modes
from flexlink.scene_report.study import Study


def made(study: Study) -> Part | None:
    """Build the chapter."""
    if not study.bends and not study.scene.ties:
        return None
    chain, rest = study.chain, study.rest
    found = modes(chain, rest.q, locked=study.held, ties=study.scene, **study.load)
    sentences = [f"{_first(found)} Small vibrations about the static equilibrium, {study.holding}."]
    if not found.stable:
        sentences.append("The equilibrium is unstable: at least one mode grows.")
    fine = resolved(found, chain)
    if not all(fine):
        few = f"From mode {1 + fine.index(False)} on, some links have fewer than two hinges per half-wave."
        sentences.append(f"{few} These frequencies depend on the number of segments; more segments resolve them.")
    heads = ("mode", "frequency [Hz]", "damping ratio", "kind", "tip moves most along", "resolved by the hinges")
    lines = tuple((*_line(found, k), "yes" if fine[k] else "no") for k in range(len(found.eigenvalues)))
    table = Table("modes", "Natural frequencies", heads, lines, to_look_up=len(lines) > 12)
    return Part(tuple(sentences), facts=_facts(study, found), pictures=(_picture(study, found),), tables=(table,))


def _first(found: Modes) -> str:
    if "elastic" not in found.kinds:
        return "No mode is elastic: only loads, not springs, restore the arm."
    k = found.kinds.index("elastic")
    ratio = number(float(found.damping_ratios[k]))
    return f"First elastic frequency: {number(float(found.hertz[k]))} Hz, damping ratio {ratio}."


def _facts(study: Study, found: Modes) -> tuple[Fact, ...]:
    """Return the first two elastic frequencies, for the first screen of the page."""
    hertz = [float(f) for f, kind in zip(found.hertz, found.kinds, strict=True) if kind == "elastic"][:2]
    if not hertz:
        return ()
    named = "frequencies" if len(hertz) > 1 else "frequency"
    return (Fact(f"{'; '.join(map(number, hertz))} Hz", f"First elastic {named}, {study.holding}"),)


def _line(found: Modes, k: int) -> tuple[Cell, ...]:
    tip = np.abs(found.paths[k, -1])
    axis = "xyz"[int(np.argmax(tip))] if tip.any() else ""
    return k + 1, float(found.hertz[k]), float(found.damping_ratios[k]), found.kinds[k], axis


def _picture(study: Study, found: Modes) -> Picture:
    shown = min(4, len(found.eigenvalues))
    figure = plot_modes(found, study.chain, shown, WIDTH)
    for panel in figure.axes:
        panel.set(xticks=[], yticks=[])
    lines = [(k + 1, body, *p) for k in range(shown) for body, p in enumerate(path_of(found, k).tolist())]
    csv = table_csv(("mode", "body", "x", "y", "z"), lines)
    caption = "Grey: equilibrium. Blue: mode shape, amplitude not to scale. Dashed: too few hinges for this mode."
    return Picture("shapes", "Lowest modes", figure, caption, csv)
