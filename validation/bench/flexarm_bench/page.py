"""Write results: a table of all cases and solvers, all verdicts as CSV, and a data sheet for each benchmark."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from flexarm_bench.benchmark import Benchmark, Reference, described
from flexarm_bench.case import Case
from flexarm_bench.judge import ACCEPTED, CANNOT, Verdict

HEADS = ("solver", "case", "part", "error", "accepted", "verdict", "CPU time [s]", "note")
SHEETS = "sheets"
SYMBOLS = {"passed": "✓", "failed": "✗"}
ASKED = {
    "statics": "Displacement of the tip from the straight, unloaded arm: x, y, z [m].",
    "buckling": "The factor on all loads at which the arm buckles; it stays straight until then.",
    "frequencies": "The lowest angular frequencies above zero [rad/s].",
    "motion": "x and y of the tip at all times [m].",
}


def write(folder: Path, benchmarks: Sequence[Benchmark], verdicts: Sequence[Verdict], conditions: str) -> Path:
    """Write `results.md`, `results.csv` and `sheets/CASE.md`; return the first."""
    (folder / SHEETS).mkdir(parents=True, exist_ok=True)
    (folder / "results.csv").write_text(as_csv(verdicts), encoding="utf-8")
    for each in benchmarks:
        (folder / SHEETS / f"{each.name}.md").write_text(sheet(each, verdicts), encoding="utf-8")
    path = folder / "results.md"
    path.write_text("\n".join(_page(benchmarks, verdicts, conditions)) + "\n", encoding="utf-8")
    return path


def as_csv(verdicts: Iterable[Verdict]) -> str:
    """All verdicts, one a line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADS)
    for each in verdicts:
        numbers = [_number(each.error), f"{each.accepted:g}"]
        row = (each.solver, each.case, each.part, *numbers, each.words, _number(each.seconds), each.note)
        writer.writerow(row)
    return text.getvalue()


def _page(benchmarks: Sequence[Benchmark], verdicts: Sequence[Verdict], conditions: str) -> Iterator[str]:
    solvers = list(dict.fromkeys(each.solver for each in verdicts))
    yield "# flexarm-bench: results\n"
    yield f"{conditions} Each cell: ✓ accepted or ✗ not, the largest error of all parts, the CPU time of all parts.\n"
    yield from _table(("case", "accepted", *solvers), (_line(each, solvers, verdicts) for each in benchmarks))
    yield ""
    yield from (f"- {name}: {summary(name, verdicts)}" for name in solvers)


def _line(benchmark: Benchmark, solvers: Iterable[str], verdicts: Iterable[Verdict]) -> list[str]:
    own = [each for each in verdicts if each.case == benchmark.name]
    cells = [_cell([each for each in own if each.solver == name]) for name in solvers]
    return [f"[{benchmark.name}]({SHEETS}/{benchmark.name}.md)", f"{benchmark.accepted:g}", *cells]


def _cell(found: Sequence[Verdict]) -> str:
    answered = [each for each in found if each.verdict != CANNOT]
    if not answered:
        return found[0].words if found else "not run"
    bad = [each for each in answered if not each.passed]
    without = f"; {len(found) - len(answered)} of {len(found)} parts: {CANNOT}" if len(answered) < len(found) else ""
    wrong = f"; {bad[0].words}" if bad and math.isnan(bad[0].error) else ""
    error = max((each.error for each in answered if not math.isnan(each.error)), default=math.nan)
    seconds = sum(each.seconds for each in answered if not math.isnan(each.seconds))
    return f"{SYMBOLS['failed' if bad else 'passed']} {_number(error)}, {seconds:.2g} s{wrong}{without}"


def summary(solver: str, verdicts: Iterable[Verdict]) -> str:
    """Count of a solver's verdicts, in words."""
    own = [each for each in verdicts if each.solver == solver]
    passed, cannot = (sum(each.verdict == verdict for each in own) for verdict in (ACCEPTED, CANNOT))
    return f"{passed} of {len(own)} answers accepted, {len(own) - passed - cannot} not, {cannot} cannot be given"


def sheet(benchmark: Benchmark, verdicts: Iterable[Verdict] = ()) -> str:
    """Data sheet of a benchmark in the form of the IFToMM library: problem, reference, error, results."""
    return "\n".join(_sheet(benchmark, [each for each in verdicts if each.case == benchmark.name])) + "\n"


def _sheet(benchmark: Benchmark, verdicts: Sequence[Verdict]) -> Iterator[str]:
    first, reference = benchmark.parts[0]
    yield f"# {benchmark.title}\n\n{benchmark.about}\n"
    yield f"- Name: `{benchmark.name}`\n- Source: {benchmark.source}\n- To be computed: {ASKED[benchmark.ask]}"
    yield f"- Error: {benchmark.error}\n- Accepted error: {benchmark.accepted:g}. {benchmark.reason}\n"
    yield "## Arm\n\nSI units, angles in rad; what is not listed is zero, and a stiffness without value is infinite.\n"
    for link in first.links:
        yield from _table(
            (f"link {link.name}", "value"), ([key, str(value)] for key, value in described(link, ["name"]))
        )
        yield ""
    common = described(first, ["name", "part", "links", "times", "ask"])
    if benchmark.ask == "motion":
        t = first.times
        common = [*common, ("times", f"{len(t)} from 0 to {t[-1]:g} s, every {t[1]:g} s")]
    yield from _table(("case", "value"), ([key, str(value)] for key, value in common)) if common else ()
    yield from _parts(benchmark)
    yield from _reference(reference)
    if verdicts:
        yield "\n## Results\n"
        rows = ([v.solver, v.part, _number(v.error), v.words, _number(v.seconds), v.note] for v in verdicts)
        yield from _table(("solver", "part", "error", "verdict", "CPU time [s]", "settings"), rows)


def _parts(benchmark: Benchmark) -> Iterator[str]:
    if benchmark.ask == "motion":
        return
    yield "\n## Parts and exact values\n"
    first = benchmark.parts[0][0]
    rows = ([case.part, "; ".join(_differences(first, case)), _exact(case, ref)] for case, ref in benchmark.parts)
    yield from _table(("part", "differs from the first by", "exact"), rows)


def _differences(first: Case, case: Case) -> Iterator[str]:
    """What differs between a part and the first part."""
    pairs = [("", first, case), *((f"{b.name}: ", a, b) for a, b in zip(first.links, case.links, strict=True))]
    for name, before, now in pairs:
        old = vars(before)
        for key, value in vars(now).items():
            if key not in ("part", "links") and old[key] != value:
                yield f"{name}{key} = {value}"


def _exact(case: Case, reference: Reference) -> str:
    return ", ".join(f"{value:.10g}" for value in reference.values(case))


def _reference(reference: Reference) -> Iterator[str]:
    document = reference.document
    yield f"\n## Reference\n\nFile `references/{reference.file}.json`, at {' / '.join(map(str, reference.at))}.\n"
    for key in ("source", "provenance", "digits_trusted"):
        if key in document:
            yield f"- {key.replace('_', ' ')}: {document[key]}"


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    heads = list(heads)
    yield f"| {' | '.join(heads)} |"
    yield f"|{'---|' * len(heads)}"
    for row in rows:
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.2e}"
