"""flexarm-bench: cases, judge, liars, solvers of other packages, and what the package may import."""

import ast
import csv
import dataclasses
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from flexarm_bench import Answer, BenchError, Benchmark, Cannot, Case, judge, load_benchmarks
from flexarm_bench.__main__ import main
from flexarm_bench.entries import GROUP, OWN, find, names
from flexarm_bench.files import write_blank
from flexarm_bench.judge import ACCEPTED, CANNOT, FAILED, NOT_ACCEPTED, error_of
from flexarm_bench.page import as_csv, sheet
from flexarm_bench.units import Units

import flexlink as fl
from tests.conftest import ROOT
from tests.support.words import refused
from validation.case import STUDY_SCENES

BENCH = ROOT / "validation" / "bench"
PACKAGE = BENCH / "flexarm_bench"
BENCHMARKS = {each.name: each for each in load_benchmarks()}
EVERY = [pytest.param(each, id=name) for name, each in BENCHMARKS.items()]
EXAMPLE = BENCH / "flexarm_bench" / "examples" / "elastica_by_scipy.py"
SEED = 7
MINE = """def run(case, settings):
    return [settings["factor"] * case.force[1], 0.0, 0.0]
"""
OTHER = """class Solver:
    def run(self, case, settings):
        return [settings["factor"] * case.force[1], 0.0, 0.0]
"""


def exact_of(case: Case) -> np.ndarray:
    """The stored values of a case, as a liar would read them."""
    parts = {part.part: reference.values(part) for part, reference in BENCHMARKS[case.name].parts}
    return parts[case.part]


def verdicts(run, name: str, units: Units | None = None, **settings: float) -> list[str]:
    return [each.verdict for each in judge("mine", run, BENCHMARKS[name], settings, units)]


def test_there_are_cases_of_every_kind():
    kinds = [each.ask for each in BENCHMARKS.values()]
    assert len(BENCHMARKS) >= 12
    assert {kind: kinds.count(kind) >= 2 for kind in kinds} == dict.fromkeys(
        ("statics", "buckling", "frequencies", "motion"), True
    )


@pytest.mark.parametrize("benchmark", EVERY)
def test_every_case_has_exact_values_and_a_source_and_a_reason(benchmark: Benchmark):
    assert benchmark.source and benchmark.reason and benchmark.about
    assert len({case.part for case, _ in benchmark.parts}) == len(benchmark.parts)
    for case, reference in benchmark.parts:
        values = reference.values(case)
        assert values.shape == case.shape
        assert np.isfinite(values).all()
        assert error_of(case, values, values) == 0.0
        if case.ask == "motion":  # the largest at any time: here at the first one, 5 m away
            values[0] += [3.0, 4.0, 0.0][: values.shape[1]]
            assert error_of(case, values, reference.values(case)) == pytest.approx(5.0, rel=1e-12)


@pytest.mark.parametrize("name", [name for name, each in BENCHMARKS.items() if each.ask == "motion"])
def test_a_motion_is_asked_for_at_the_times_of_its_reference(name):
    ((case, reference),) = BENCHMARKS[name].parts
    stored = reference.document["reference"]
    assert np.allclose(case.times, stored.get("t", stored.get("t_s")), atol=1e-9)


@pytest.mark.parametrize("path", sorted((PACKAGE / "references").rglob("*.json")), ids=lambda path: path.stem)
def test_every_reference_file_is_used(path):
    used = {reference.file for each in BENCHMARKS.values() for _, reference in each.parts}
    assert path.relative_to(PACKAGE / "references").with_suffix("").as_posix() in used


def test_no_reference_of_the_package_is_stored_in_the_study_again():
    own = {path.relative_to(PACKAGE / "references") for path in (PACKAGE / "references").rglob("*.json")}
    study = ROOT / "validation" / "reference"
    assert own.isdisjoint(path.relative_to(study) for path in study.rglob("*.json"))


SCENES = {
    "torque_pulse": "torque_pulse", "spin_up": "spin_up", "flexible_pendulum": "flexible_pendulum",
    "three_links_fall": "three_link_fall", "clamped": "unit_beam", "princeton": "princeton_beam",
    "lateral_buckling": "deep_beam",
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_the_arm_of_a_case_is_that_of_the_study(name):
    from flexarm_bench.solvers import with_flexlink  # noqa: PLC0415

    case, _ = BENCHMARKS[name].parts[0]
    mine = fl.lump(with_flexlink._scene(case, "midpoint", 6, 1e-3))
    scene = fl.load_scene(STUDY_SCENES / f"{SCENES[name]}.toml")
    ours = fl.lump(scene.varied({"link.*.lumping": "midpoint", "link.*.segments": 7}))
    assert mine.n == ours.n
    bends = mine.stiffness < 1e5 * np.median(mine.stiffness)  # the scene of a deep beam is nearly rigid in its plane
    assert np.allclose(mine.stiffness[bends], ours.stiffness[bends], rtol=1e-6)
    assert np.allclose(mine.damping[bends], ours.damping[bends], rtol=1e-6)
    if case.ask in {"frequencies", "motion"}:
        q = np.full(mine.n, 0.1)
        assert np.allclose(fl.mass_matrix(mine, q), fl.mass_matrix(ours, q), rtol=1e-6)
        assert np.allclose(fl.gravity_torque(mine, q), fl.gravity_torque(ours, q), rtol=1e-6)


@pytest.mark.parametrize("benchmark", EVERY)
def test_a_thousandth_off_is_not_accepted_and_the_exact_answer_is(benchmark: Benchmark):
    def off(case, settings):
        return exact_of(case) * settings["factor"]

    assert set(verdicts(off, benchmark.name, factor=1 + 1e-3)) == {NOT_ACCEPTED}
    assert set(verdicts(off, benchmark.name, factor=1 - 1e-3)) == {NOT_ACCEPTED}
    assert set(verdicts(off, benchmark.name, factor=1.0)) == {ACCEPTED}


@pytest.mark.parametrize("benchmark", EVERY)
def test_one_wrong_value_is_enough(benchmark: Benchmark):
    def last_is_off(case, settings):
        values = exact_of(case)
        values.flat[-1] += 2 * benchmark.accepted * max(1.0, np.abs(values).max())
        return values

    assert set(verdicts(last_is_off, benchmark.name)) == {NOT_ACCEPTED}


@pytest.mark.parametrize("benchmark", EVERY)
def test_a_constant_is_not_accepted(benchmark: Benchmark):
    for value in (0.0, 1.0):
        assert ACCEPTED not in verdicts(lambda case, _, value=value: np.full(case.shape, value), benchmark.name)


@pytest.mark.parametrize("benchmark", EVERY)
def test_stored_exact_values_are_not_accepted_in_other_units(benchmark: Benchmark):
    for seed in range(4):
        assert ACCEPTED not in verdicts(lambda case, _: exact_of(case), benchmark.name, Units.drawn(seed))


@pytest.mark.parametrize("benchmark", EVERY)
def test_a_solver_gets_no_exact_values(benchmark: Benchmark):
    for case, reference in benchmark.parts:
        fields = {each.name for each in dataclasses.fields(case)}
        assert fields.isdisjoint({"reference", "exact", "accepted"})
        shown = re.findall(r"[-\d.e]{6,}", repr(dataclasses.replace(case, times=())))
        given = [abs(float(number)) for number in shown]
        values = np.abs(reference.values(case)).ravel()
        assert not any(np.isclose(value, given, rtol=1e-6).any() for value in values if value not in {0.0, 1.0})


@pytest.mark.slow
def test_an_answer_does_not_depend_on_the_units():
    run = find("pinocchio").run
    for name in ("columns", "follower_force", "hanging"):
        errors = [
            [each.error for each in judge("p", run, BENCHMARKS[name], {"hinges": 8}, Units.drawn(s))] for s in (1, 2)
        ]
        assert np.allclose(*errors, rtol=1e-3, atol=1e-9)


def test_a_solver_that_cannot_or_fails_has_a_verdict_with_the_reason():
    reason = "it has no columns"

    def wrong(case, settings):
        if case.part == "Euler":
            raise Cannot(reason)
        raise ZeroDivisionError("by\nzero")

    line = wrong.__code__.co_firstlineno + 3
    found = f"{ZeroDivisionError.__name__}: by zero ({Path(__file__).name}:{line})"
    first, second = judge("wrong", wrong, BENCHMARKS["columns"])
    assert (first.verdict, first.reason, first.passed) == (CANNOT, reason, None)
    assert (second.verdict, second.reason, second.passed) == (FAILED, found, False)


@pytest.mark.parametrize("values", [[1.0, 2.0], [np.nan], "nothing"])
def test_an_answer_of_the_wrong_form_fails(values):
    assert set(verdicts(lambda case, _: values, "columns")) == {FAILED}


def test_the_note_of_an_answer_is_in_the_table():
    found = list(judge("n", lambda case, _: Answer(exact_of(case), "by heart"), BENCHMARKS["columns"]))
    rows = list(csv.DictReader(as_csv(found).splitlines()))
    assert [row["note"] for row in rows] == ["by heart"] * 2


@pytest.mark.parametrize("name", ["pinocchio", "mujoco"])
def test_programs_of_joints_are_accepted(name):
    run = find(name).run
    for case, hinges in (("clamped", 16), ("pinned", 16), ("columns", 48)):
        found = list(judge(name, run, BENCHMARKS[case], {"hinges": hinges}, Units.drawn(SEED)))
        assert [each.words for each in found] == [ACCEPTED] * len(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "case"), [("mujoco", "three_links_fall"), ("mujoco", "torsion"), ("pinocchio", "spin_up")]
)
def test_programs_of_joints_are_accepted_in_longer_cases(name, case):
    assert set(verdicts(find(name).run, case, Units.drawn(SEED))) == {ACCEPTED}


@pytest.mark.slow
@pytest.mark.parametrize("case", ["oblique_force", "lateral_buckling", "spinning", "two_links_fall", "torque_pulse"])
def test_flexlink_is_accepted(case):
    assert set(verdicts(find("flexlink").run, case, Units.drawn(SEED))) == {ACCEPTED}


def test_a_program_that_is_not_installed_cannot(monkeypatch):
    monkeypatch.setitem(sys.modules, "flexarm_bench.solvers.with_exudyn", None)
    assert set(verdicts(find("exudyn").run, "columns")) == {CANNOT}


@pytest.mark.slow
def test_the_example_is_short_and_accepted(capsys):
    assert EXAMPLE.read_text("utf-8").count("\n") <= 60
    assert set(verdicts(find(str(EXAMPLE)).run, "elastica", Units.drawn(SEED))) == {ACCEPTED}
    assert set(verdicts(find(str(EXAMPLE)).run, "princeton")) == {CANNOT}
    assert main(["example"]) == 0
    assert capsys.readouterr().out == EXAMPLE.read_text("utf-8")


def test_a_solver_of_another_package_is_found_by_its_entry_point(tmp_path, monkeypatch):
    (tmp_path / "other_arm.py").write_text(OTHER)
    info = tmp_path / "other_arm-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other-arm\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\nother = other_arm:Solver\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "other" in names()
    assert verdicts(find("other").run, "elastica", factor=0.0) == [NOT_ACCEPTED] * 5


def test_mistakes_in_the_name_of_a_solver_are_named(tmp_path):
    (tmp_path / "empty.py").write_text("x = 1\n")
    (tmp_path / "broken.py").write_text("import nothing_of_this_name\n")
    (tmp_path / "folder").mkdir()
    for wanted in ("nobody", "none.py", *(str(tmp_path / each) for each in ("empty.py", "broken.py", "folder"))):
        with refused(BenchError, "test-bench"):
            find(wanted)
    with refused(BenchError, "test-bench"):
        load_benchmarks("nothing*")


def fill(folder: Path, benchmark: Benchmark, factor: float) -> None:
    file = write_blank(folder, benchmark)
    heads, *lines = csv.reader(file.open(encoding="utf-8"))
    rows = np.concatenate([np.atleast_2d(reference.values(case)) for case, reference in benchmark.parts])
    filled = [[line[0], *map(str, row)] for line, row in zip(lines, (rows * factor).tolist(), strict=True)]
    with file.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out).writerows([heads, *filled])


@pytest.mark.parametrize("name", ["elastica", "columns", "clamped", "spin_up"])
def test_files_are_written_filled_in_and_judged(tmp_path, name, capsys):
    benchmark = BENCHMARKS[name]
    for factor, code in ((1.0, 0), (1.001, 1)):
        fill(tmp_path / "mine", benchmark, factor)
        assert main(["run", "--solver", str(tmp_path / "mine"), name]) == code
    write_blank(tmp_path / "mine", benchmark)
    entry = find(str(tmp_path / "mine"))
    assert entry.stored
    assert set(verdicts(entry.run, name)) == {CANNOT}
    assert set(verdicts(entry.run, "pinned")) == {CANNOT}


@pytest.mark.parametrize(
    "text",
    [
        "part,factor [N]\nEuler,2\n",
        "part,factor [1]\nEuler,two\n",
        "part,factor [1]\nEuler,2,3\n",
        "part,factor [1]\nEuler,2\n",
        "",
    ],
)
def test_a_mistake_in_a_file_is_named(tmp_path, text):
    (tmp_path / "columns.csv").write_text(text)
    found = list(judge("files", find(str(tmp_path)).run, BENCHMARKS["columns"]))
    assert found[-1].verdict == FAILED
    assert "columns.csv" in found[-1].reason


def test_the_page_has_every_case_and_solver(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(MINE)
    code = main([
        "run", "--solver", str(tmp_path / "mine.py"), "--solver", str(EXAMPLE), "--set", "factor=0", "--seed", "3",
        "-o", str(tmp_path / "out"), "elastica", "columns",
    ])  # fmt: skip
    assert code == 1
    page = (tmp_path / "out" / "results.md").read_text("utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| [")]
    assert [row[0].partition("]")[0] for row in rows] == ["[columns", "[elastica"]
    assert [cell.split()[0] for row in rows for cell in row[2:]] == ["✗", "cannot:", "✗", "✓"]
    assert len(list(csv.reader((tmp_path / "out" / "results.csv").open()))) == 1 + 2 * 7
    assert {path.stem for path in (tmp_path / "out" / "sheets").iterdir()} == {"elastica", "columns"}
    assert re.findall(r"seed (\d+)", capsys.readouterr().out) == ["3", "3"]


@pytest.mark.parametrize("benchmark", EVERY)
def test_every_case_has_a_data_sheet(benchmark: Benchmark):
    text = sheet(benchmark)
    for wanted in (benchmark.title, benchmark.source, benchmark.error, f"{benchmark.accepted:g}", benchmark.reason):
        assert wanted in text
    for case, reference in benchmark.parts:
        assert reference.file in text or case is not benchmark.parts[0][0]
        if case.ask != "motion":
            assert all(f"{value:.10g}" in text for value in reference.values(case))
    assert all(f"link {link.name}" in text for link in benchmark.parts[0][0].links)


def test_the_commands_list_write_and_refuse(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "exudyn", None)
    monkeypatch.delitem(sys.modules, "flexarm_bench.solvers.with_exudyn", raising=False)
    assert main(["list"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in [*BENCHMARKS, *OWN])
    assert "exudyn (" in shown, "its program is missing"
    assert main(["sheets", "-o", str(tmp_path / "sheets"), "motion"]) == 0
    assert len(list((tmp_path / "sheets").iterdir())) == 5
    assert main(["blank", str(tmp_path / "mine"), "motion"]) == 0
    assert len(list((tmp_path / "mine").iterdir())) == 5
    capsys.readouterr()
    assert main(["run", "--solver", "nobody"]) == 2
    assert main(["run", "--solver", str(EXAMPLE), "--set", "factor", "columns"]) == 2
    assert capsys.readouterr().err.count("flexarm-bench: ") == 2


def test_the_solver_in_the_readme_runs(tmp_path, capsys):
    blocks = re.findall(r"```python\n(.*?)```", (BENCH / "README.md").read_text("utf-8"), flags=re.DOTALL)
    (tmp_path / "my_solver.py").write_text(blocks[0])
    run = find(str(tmp_path / "my_solver.py")).run
    assert set(verdicts(run, "elastica", Units.drawn(SEED))) == {NOT_ACCEPTED}
    small = next(judge("linear", run, BENCHMARKS["elastica"]))
    assert small.error < 0.05  # the linear theory, under the smallest load
    assert set(verdicts(run, "pinned")) == {CANNOT}


def imports(path: Path) -> set[str]:
    """First names of all modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found - set(sys.stdlib_module_names) - {"flexarm_bench"}


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: path.stem)
def test_the_package_imports_numpy_and_each_solver_its_program(path):
    programs = {
        "with_flexlink": {"flexlink"}, "with_pinocchio": {"pinocchio", "scipy"}, "with_mujoco": {"mujoco"},
        "with_exudyn": {"exudyn"}, "with_cosseratbench": {"cosseratbench"}, "elastica_by_scipy": {"scipy"},
    }  # fmt: skip
    assert imports(path) <= {"numpy"} | programs.get(path.stem, set())


def test_the_package_runs_without_flexlink():
    code = (
        "import sys; sys.modules.update(dict.fromkeys(['flexlink', 'validation', 'reports', 'scipy']));"
        f"sys.path.insert(0, {str(BENCH)!r}); from flexarm_bench.__main__ import main; sys.exit(main(['list']))"
    )
    subprocess.run([sys.executable, "-I", "-c", code], check=True, capture_output=True, cwd=ROOT.parent)


def test_the_distribution_contains_all_data_and_needs_numpy_only():
    project = tomllib.loads((BENCH / "pyproject.toml").read_text("utf-8"))
    assert [re.split(r"\W", name)[0] for name in project["project"]["dependencies"]] == ["numpy"]
    patterns = project["tool"]["setuptools"]["package-data"]["flexarm_bench"]
    files = [path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*") if path.suffix in {".toml", ".json"}]
    assert len(files) > len(BENCHMARKS)
    reached = {str(path) for pattern in patterns for path in PACKAGE.glob(pattern)}
    assert {str(PACKAGE / name) for name in files} <= reached
