"""Compare other engines, which load the exported arm, term by term at many states and step by step in the run."""

from collections.abc import Iterable, Sequence

from flexlink.common.errors import FlexlinkError, MissingDependencyError, how_to_install
from flexlink.describe.schemes.methods import method
from flexlink.diagnosis.comparison import compare
from flexlink.diagnosis.diagnosis import Diagnosis
from flexlink.diagnosis.trajectories import MEANINGFUL_TOLERANCE, RunDifference, compare_trajectories, in_fixed_steps
from flexlink.engines import ENGINES
from flexlink.pages.colours import engine_name
from flexlink.pages.numbers import number
from flexlink.pages.page import Part
from flexlink.pages.tables import Table
from flexlink.pages.verdict import State, Verdict
from flexlink.scene_report.study import Study

STATES = 60  # number of states at which terms are compared


def made(study: Study) -> Part:
    """Build the chapter."""
    diagnoses, missing = _diagnoses(study)
    runs, about_runs, why = _runs(study)
    sentences = [
        f"Every installed engine loads this arm from its exported file. Terms are compared at {STATES} states, half "
        "of them random. The largest difference is divided by the rounding bound; a ratio of at most 1 means that the "
        "results agree to within rounding.",
        "Terms: mass matrix M; torques of gravity T_G, of gravity with centrifugal and Coriolis forces T_GC, of "
        "springs T_FL, and of friction T_FR; accelerations q̈.",
        about_runs,
        *(f"{engine_name(each.engine)}: {note}." for each in diagnoses for note in each.notes),
        *(str(each) for each in diagnoses if not each.passed),
        *why,
        *missing,
    ]
    tables = (*([_terms(diagnoses)] if diagnoses else []), *([_of_runs(runs)] if runs else []))
    return Part(tuple(filter(None, sentences)), (_verdict(diagnoses, runs),), tables=tables)


def _diagnoses(study: Study) -> tuple[list[Diagnosis], list[str]]:
    found, missing, failed = list[Diagnosis](), list[str](), dict[str, list[str]]()
    for name in ENGINES:
        if name == "native":
            continue
        try:
            found += compare(study.scene, engines=[name], samples=STATES).diagnoses
        except MissingDependencyError:
            missing.append(f"{engine_name(name)} is not installed: {how_to_install(ENGINES[name].extra)}.")
        except FlexlinkError as error:
            failed.setdefault(str(error), []).append(name)
    return found, missing + [f"{_named(names)}: comparison failed: {why}." for why, names in failed.items()]


def _runs(study: Study) -> tuple[Sequence[RunDifference], str, Sequence[str]]:
    """Return the compared runs, a sentence about them, and the reasons for missing ones."""
    scene = study.scene
    try:
        duration = _affordable(study)
        found = compare_trajectories(scene, duration=duration)
    except MissingDependencyError:
        return [], "", []
    except FlexlinkError as error:
        return [], f"Runs were not compared: {error}.", []
    part = "the whole run" if duration == scene.run.duration else f"the first {number(duration)} s of the run"
    sentence = f"Runs are compared over {part}, with the same method and step in every engine ({found.steps})."
    why = [f"Not compared: {reason}." for reason in found.refused]
    why += [f"{engine_name(row.engine)}: {row.diverged}." for row in found.rows if row.diverged]
    if any(row.explained > MEANINGFUL_TOLERANCE for row in found.rows):
        why.append("This motion amplifies rounding errors, so the comparison of terms is more meaningful.")
    return found.rows, sentence, why


def _affordable(study: Study) -> float:
    """Return the longest duration [s], a multiple of the sample spacing, that fits an engine's evaluation budget."""
    run = in_fixed_steps(study.scene, study.chain)[0].run
    evaluations = 8_000  # budget of one run; an evaluation from Python takes 0.1 ms
    samples = int(evaluations / method(run.method).stages * run.fixed_step / run.spacing)
    return min(run.duration, max(samples, 1) * run.spacing)


def _terms(diagnoses: Sequence[Diagnosis]) -> Table:
    quantities = list(dict.fromkeys(row.quantity for each in diagnoses for row in each.rows))
    lines = []
    for each in diagnoses:
        errors = {row.quantity: row.error for row in each.rows}
        lines.append((engine_name(each.engine), *map(errors.get, quantities), "agrees" if each.passed else "DIFFERS"))
    heads = ("engine", *quantities, "verdict")
    return Table("terms", "Terms of the equation of motion: difference / rounding bound", heads, tuple(lines))


def _of_runs(rows: Sequence[RunDifference]) -> Table:
    heads = ("engine", "angles [rad]", "rates [rad/s]", "tip [m]", "rounding bound [rad]", "worst joint", "verdict")
    lines = tuple(
        (engine_name(row.engine), row.q, row.qd, row.tip, row.explained, f"{row.joint} at {row.time:g} s",
         "agrees" if row.passed else "DIFFERS")
        for row in rows
    )  # fmt: skip
    return Table("runs", "Runs: largest difference from flexlink", heads, lines)


def _named(engines: Iterable[str]) -> str:
    return ", ".join(map(engine_name, engines))


def _verdict(diagnoses: Sequence[Diagnosis], runs: Sequence[RunDifference]) -> Verdict:
    good = [each.engine for each in diagnoses if each.passed]
    bad = sorted({*(each.engine for each in diagnoses if not each.passed), *(r.engine for r in runs if not r.passed)})
    state: State = "fail" if bad else "pass" if good else "doubt"
    word = {"fail": "differ", "pass": "agree", "doubt": "not compared"}[state]
    text = f"Results differ from flexlink’s in {_named(bad)}." if bad else ""
    if good and not bad:
        run = f"; same run in {_named(row.engine for row in runs)}" if runs else ""
        text = f"Same terms of the equation of motion in {_named(good)}{run}."
    return Verdict("Engines", state, word, text or "No other engine could be compared.")
