"""Accuracy of the chosen model relative to finer models, and accuracy and cost of alternative models."""

import math
from collections.abc import Sequence

import numpy as np

from flexlink.advice.verdict import length
from flexlink.pages.colours import BLUE, CYCLE, GREY, INK, MARKERS
from flexlink.pages.numbers import number, percent
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import legend_over, stacked_axes
from flexlink.pages.tables import Table, table_csv
from flexlink.pages.verdict import State, Verdict
from flexlink.scene_report.refinement import ENOUGH, Choice, Refinement
from flexlink.scene_report.study import Study


def made(study: Study) -> Part | None:
    """Build the chapter."""
    if study.scene.run.duration == 0 or not study.moves:
        return None
    about = Refinement(study)
    choices = about.choices()
    pictures = [picture for picture in (_in_time(about), _prices(choices)) if picture is not None]
    sentences = (*_hinge_error(about), _step_error(about), _costs(about, choices))
    own = choices[0].seconds
    ties = ", without ties" if study.scene.ties else ""
    cost = f"CPU time of the steps{ties}: {number(study.scene.run.duration / own)} × real-time speed."
    verdicts = _verdict(about), Verdict("Cost", "info", _seconds(own), cost)
    return Part(tuple(filter(None, sentences)), verdicts, tuple(pictures), (_table(about, choices),))


def _hinge_error(about: Refinement) -> list[str]:
    if not any(about.model):
        return ["All links are rigid: there are no hinges to refine."]
    if about.gives_state:
        return ["Tip error from the number of hinges: unknown, because initial.q fixes that number."]
    if (limit := about.limit) is None:
        outcomes = {factor: about.runner.run(about.cut(factor), about.strict) for factor in (1.0, 2.0, 4.0)}
        reasons = {factor: outcome.reason for factor, outcome in outcomes.items() if not outcome.completed}
        early = "; ".join(f"{factor:g} times the hinges: {why}" for factor, why in reasons.items())
        return [f"Tip error from the number of hinges: unknown, because too few other runs completed ({early})."]
    if not about.is_accurate:
        until = about.accurate_until(ENOUGH)
        return [
            f"Tip error from the number of hinges: unknown. More hinges still move the tip by {_length(limit.error)}, "
            f"as in motion that amplifies small errors. Until {number(until)} s the two finest models differ by less "
            f"than {percent(ENOUGH)} of the tip’s travel; to get an estimate, shorten the run to that time "
            "(run.duration)."
        ]
    order = f"observed order {number(limit.order, 2)}, " if math.isfinite(limit.order) else ""
    return [
        f"Tip error from the number of hinges: {_length(about.of_hinges)}, "
        f"{percent(about.of_hinges / about.study.travel)} of the tip’s travel, without the error of the steps, "
        f"relative to the converged model ({order}known to ±{_length(limit.error, '')}). Data of joints, loads and "
        "materials are not checked here; that requires measurements."
    ]


def _step_error(about: Refinement) -> str:
    own = "" if about.run.stated is None else f" The run’s own estimate, made to be larger: {about.run.stated}."
    if math.isnan(about.of_steps):
        what = "tolerance" if about.scene.run.controlled else "step"
        return f"Tip error from the time steps: unknown, because the run with a smaller {what} did not complete.{own}"
    return f"Tip error from the time steps: {_step_length(about)}, relative to a run with smaller errors.{own}"


def _step_length(about: Refinement) -> str:
    """The error of the steps, or, if it is smaller, that of the run it is measured with."""
    resolved = about.converged.error
    return f"below {_length(resolved, '')}" if about.of_steps < resolved else _length(about.of_steps)


def _costs(about: Refinement, choices: Sequence[Choice]) -> str:
    own, duration, ties = choices[0], about.scene.run.duration, "ties, " if about.scene.ties else ""
    sentences = [
        f"CPU time of the steps on this machine, without {ties}set-up and checks: {_seconds(own.seconds)} "
        f"({number(duration / own.seconds)} × real-time speed)."
    ]
    known = [one for one in choices[1:] if math.isfinite(one.error) and one.outcome.completed]
    cheaper = [one for one in known if one.seconds < own.seconds]
    if math.isfinite(own.error) and known:
        better = [one for one in known if one.error < 0.9 * own.error]  # clearly smaller errors, not nearly equal ones
        if cheaper:
            best = min(cheaper, key=lambda one: one.error)
            cost = f"{_seconds(best.seconds)}, tip error {_length(best.error)}"
            sentences.append(f"Best cheaper choice: {best.label} ({cost}).")
        if better:
            least = min(better, key=lambda one: one.seconds)
            sentences.append(
                f"Cheapest more accurate choice: {least.label} ({_seconds(least.seconds)}, tip error "
                f"{_length(least.error)})."
            )
        if not about.scene.ties:
            sentences.append("To find the cheapest model for a given tolerance, use flexlink advise.")
    return " ".join(sentences)


def _verdict(about: Refinement) -> Verdict:
    error = about.error(about.run.tip) if any(about.model) else about.of_steps
    if math.isnan(error):
        return Verdict("Model error", "doubt", "unknown", "For the reason, see “Accuracy and cost”.")
    share = error / about.study.travel
    doubts = about.run.warnings
    state: State = "pass" if share <= ENOUGH and not doubts else "doubt"
    parts = f"hinges ({_length(about.of_hinges)}) and steps ({_step_length(about)})"
    what = parts if any(about.model) else "steps"
    warned = " The run gave warnings: see “Motion”." if doubts else ""
    text = f"Tip error from {what}: {percent(share)} of the tip’s travel.{warned}"
    return Verdict("Model error", state, _length(error), text)


def _table(about: Refinement, choices: Sequence[Choice]) -> Table:
    heads = ("choice", "degrees of freedom", "steps", "tip error [m]", "CPU time [s]", "× real time", "remark")
    duration = about.scene.run.duration
    lines = tuple(
        (one.label, one.n or None, one.stepping, one.error if math.isfinite(one.error) else None,
         one.seconds or None, duration / one.seconds if one.seconds else None,
         "" if one.outcome.completed else one.outcome.reason)
        for one in choices
    )  # fmt: skip
    return Table("choices", "This scene and alternatives", heads, lines)


def _in_time(about: Refinement) -> Picture | None:
    """Plot the tip's distance from the limit along the run, for every discretisation."""
    if about.limit is None or not about.is_accurate:
        return None
    _, (axes,) = stacked_axes(1, 3.2)
    columns: dict[str, np.ndarray] = {"t [s]": about.run.t}
    curves = {"this scene": about.run.tip}
    for factor, outcome in about.cuts.items():
        if factor != 1.0:
            curves[about.times_the_hinges(factor, f"{factor:g} ×")] = outcome.tip
    for place, (label, tip) in enumerate(curves.items()):
        off = np.linalg.norm(tip - about.limit.tip, axis=1)
        columns[f"{label} [m]"] = off
        seen = off > 0
        axes.plot(about.run.t[seen], off[seen], color=INK if place == 0 else CYCLE[place - 1], label=label)
    axes.axhline(about.limit.error, color=GREY, linestyle="--", linewidth=1.0, label="uncertainty")
    errors = np.concatenate([column for name, column in columns.items() if name != "t [s]"])
    top, low = float(errors.max()), float(np.quantile(errors, 0.1))  # leave out the start, where all runs agree
    axes.set(yscale="log", ylabel="tip error [m]")
    axes.set_ylim(max(0.3 * low, 1e-6 * top), 2 * max(top, about.limit.error))
    caption = "Tip error along the run, relative to the converged model. Dashed: uncertainty of that model."
    return picture_of("convergence", "Convergence with the number of hinges", caption, [axes], "time [s]", columns)


def _prices(choices: Sequence[Choice]) -> Picture | None:
    """Plot the tip error over the CPU time of all choices."""
    known = [one for one in choices if math.isfinite(one.error) and one.error > 0 and one.seconds > 0]
    if len(known) < 2:
        return None
    figure, (axes,) = stacked_axes(1, 3.8)
    looks = ((INK, "*"), *zip((*CYCLE, GREY, INK, BLUE), (*MARKERS, "X", "<", ">"), strict=True))
    for place, one in enumerate(known):
        colour, marker = looks[place % len(looks)]
        axes.plot([one.seconds], [one.error], marker, color=colour, markersize=7 if place else 11, label=one.label)
    axes.set(xscale="log", yscale="log", xlabel="CPU time [s]", ylabel="tip error [m]")
    legend_over(axes, figure=figure)
    csv = table_csv(("choice", "CPU time [s]", "tip error [m]"), [(one.label, one.seconds, one.error) for one in known])
    caption = "Lower is more accurate; further left is cheaper. CPU time = evaluations × time per evaluation."
    return Picture("price_list", "Accuracy against CPU time", figure, caption, csv)


def _length(metres: float, below: str = "below ") -> str:
    return f"{below}1 nm" if metres < 1e-9 else length(metres)


def _seconds(seconds: float) -> str:
    return f"{number(seconds)} s" if seconds >= 0.1 else f"{number(1e3 * seconds)} ms"
