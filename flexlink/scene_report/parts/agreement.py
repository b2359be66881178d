"""Other engines with the exported arm: term by term at many states, and the run itself, step by step."""

from __future__ import annotations

from collections.abc import Sequence

from flexlink.common.errors import FlexlinkError, MissingDependencyError
from flexlink.describe.schemes.methods import method
from flexlink.diagnosis.comparison import compare
from flexlink.diagnosis.diagnosis import Diagnosis
from flexlink.diagnosis.trajectories import LITTLE, RunDifference, compare_trajectories, in_fixed_steps
from flexlink.engines import ENGINES
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from flexlink.pages.verdict import State, Verdict
from flexlink.scene_report.part import Part
from flexlink.scene_report.study import Study

SAMPLES = 60  # states
EVALUATIONS = 8_000
"""Of the equation of motion in an engine's run, at most: in Python one takes a tenth of a millisecond."""

OTHERS = tuple(name for name in ENGINES if name != "native")


def made(study: Study) -> Part:
    """The chapter."""
    diagnoses, without = _diagnoses(study)
    runs, of_runs, why = _runs(study)
    sentences = [
        "Every engine that is installed loads the exported file of this arm. Term by term: the largest difference at "
        f"{SAMPLES} states, half of them drawn at random, in units of what rounding explains, so that up to 1 two "
        "right programs may differ.",
        of_runs,
        *(str(each) for each in diagnoses if not each.passed),
        *why,
        *without,
    ]
    tables = []
    if diagnoses:
        tables.append(_terms(diagnoses))
    if runs:
        tables.append(_of_runs(runs))
    return Part(tuple(filter(None, sentences)), (_verdict(diagnoses, runs),), tables=tuple(tables))


def _diagnoses(study: Study) -> tuple[list[Diagnosis], list[str]]:
    found: list[Diagnosis] = []
    without = []
    for name in OTHERS:
        try:
            found += compare(study.scene, engines=[name], samples=SAMPLES).diagnoses
        except MissingDependencyError:
            without.append(f"{name} is not installed: python -m pip install 'flexlink[{ENGINES[name].extra}]'.")
        except FlexlinkError as error:
            without.append(f"{name} could not be compared: {error}.")
    return found, without


def _runs(study: Study) -> tuple[Sequence[RunDifference], str, Sequence[str]]:
    """What became of the runs, a sentence about them, and why some are not there."""
    scene = study.scene
    try:
        duration = _affordable(study)
        found = compare_trajectories(scene, duration=duration)
    except MissingDependencyError:
        return [], "", []
    except FlexlinkError as error:
        return [], f"Runs could not be compared: {error}.", []
    part = "the whole run" if duration == scene.run.duration else f"the first {number(duration)} s of the run"
    said = f"Over {part}, all in the same steps ({found.steps}): the largest differences of any angle, and of the tip."
    why = [f"Not compared: {reason}." for reason in found.refused]
    why += [f"{row.engine}: {row.diverged}." for row in found.rows if row.diverged]
    if any(row.explained > LITTLE for row in found.rows):
        why.append("This motion multiplies rounding so far that agreement of the runs says little.")
    return found.rows, said, why


def _affordable(study: Study) -> float:
    """As much of the run [s], in whole samples, as engines do in so many evaluations."""
    run = in_fixed_steps(study.scene, study.chain)[0].run
    samples = int(EVALUATIONS / method(run.method).stages * run.step / run.sample)
    return min(run.duration, max(samples, 1) * run.sample)


def _terms(diagnoses: Sequence[Diagnosis]) -> Table:
    quantities = list(dict.fromkeys(row.quantity for each in diagnoses for row in each.rows))
    lines = []
    for each in diagnoses:
        errors = {row.quantity: row.error for row in each.rows}
        lines.append((each.engine, *(errors.get(name) for name in quantities), "agrees" if each.passed else "DIFFERS"))
    heads = ("engine", *(f"of {name}" for name in quantities), "in all")
    return Table("terms", "Terms of the equation of motion, differences over rounding", heads, tuple(lines))


def _of_runs(rows: Sequence[RunDifference]) -> Table:
    heads = ("engine", "angles [rad]", "rates [rad/s]", "tip [m]", "agrees up to [rad]", "worst joint", "in all")
    lines = tuple(
        (row.engine, row.q, row.qd, row.tip, row.explained, f"{row.joint} at {row.time:g} s",
         "agrees" if row.passed else "DIFFERS")
        for row in rows
    )  # fmt: skip
    return Table("runs", "Runs, largest differences from ours", heads, lines)


def _verdict(diagnoses: Sequence[Diagnosis], runs: Sequence[RunDifference]) -> Verdict:
    good = [each.engine for each in diagnoses if each.passed]
    bad = sorted({*(each.engine for each in diagnoses if not each.passed), *(r.engine for r in runs if not r.passed)})
    state: State = "fail" if bad else "pass" if good else "doubt"
    word = {"fail": "differ", "pass": "agree", "doubt": "none installed"}[state]
    text = f"{', '.join(bad)} give other numbers than flexlink." if bad else ""
    if good and not bad:
        run = f"; the run in {', '.join(row.engine for row in runs)}" if runs else ""
        text = f"Every term of the equation of motion in {', '.join(good)}{run}."
    return Verdict("Engines", state, word, text or "No other engine has computed this arm.")
