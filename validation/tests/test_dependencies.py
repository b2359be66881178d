"""What a case depends on, found in the text of modules, against what cases use when they run."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.words import reviewed
from validation import dependencies, sources
from validation.case import ALL, Case, load_cases
from validation.imports import Project

ROOT = Path(__file__).parents[2]

MODULES = {
    "lib": "import lib.always",
    "lib.always": "",
    "lib.deep": "",
    "lib.deep.solver": "import numpy",
    "lib.cli": "",
    "lib.cli.main": "import importlib; importlib.import_module(f'lib.cli.{name}')",
    "lib.cli.run": "",
    "lib.__main__": "from lib.cli import main",
    "lib.tables": "PLACES = {'one': 'lib.plugin'}",
    "lib.plugin": "",
    "lib.shown": "",
    "study": "",
    "study.lazy": "import lib as short\ndef run(): return short.solve()",
    "study.named": "from lib import solve",
    "study.late": "def run():\n    from study import named",
    "study.typed": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import lib.shown",
    "study.table": "from lib.tables import PLACES",
    "study.command": "COMMAND = [python, '-m', 'lib', 'simulate']",
    "study.script": "SCRIPT = 'import sys, lib\\nprint(lib.solve())'",
    "study.prose": '"""import lib.shown"""\nTEXT = "import duties of lib.shown"',
}
LIB = {"lib", "lib.always"}
SOLVER = LIB | {"lib.deep", "lib.deep.solver"}


@pytest.fixture
def project(tmp_path: Path) -> Project:
    files = {name: tmp_path / f"{name}.py" for name in MODULES}
    for name, text in MODULES.items():
        files[name].write_text(text, encoding="utf-8")
    (tmp_path / "lib.pyi").write_text("from lib.deep.solver import solve as solve", encoding="utf-8")
    return Project(files)


@pytest.mark.parametrize(("module", "imported"), [
    ("lazy", SOLVER),
    ("named", SOLVER),
    ("late", SOLVER | {"study.named"}),
    ("typed", set()),
    ("table", LIB | {"lib.tables", "lib.plugin"}),
    ("command", LIB | {"lib.__main__", "lib.cli", "lib.cli.main", "lib.cli.run"}),
    ("script", SOLVER),
    ("prose", set()),
])  # fmt: skip
def test_imports_are_found_at_the_top_inside_functions_by_name_and_in_commands(project, module, imported) -> None:
    assert project.closure(f"study.{module}") == imported | {"study", f"study.{module}"}


def test_an_unknown_module_has_no_imports(project: Project) -> None:
    assert project.closure("study.gone") == set()


@pytest.fixture(scope="module")
def known() -> dict[str, Case]:
    return {case.name: case for case in load_cases(*ALL)}


@pytest.fixture(scope="module")
def files(known: dict[str, Case]) -> dict[str, dict[str, str]]:
    return dependencies.of_cases(known.values())


@pytest.mark.slow
@pytest.mark.parametrize(("file", "touched", "not_touched"), [
    ("flexlink/kernels/bodies/rne.py", {"speed_calls", "pointwise", "sweep_killed"}, {"order_conditions"}),
    ("flexlink/identification/fit.py", {"fits_continuous_beam"}, {"speed_calls", "convergence_float64", "extremes"}),
    ("flexlink/cli/simulate.py", {"speed_start", "sweep_killed"}, {"speed_calls", "pointwise"}),
    ("flexlink/describe/data/methods/RK4.toml", {"convergence_float64"}, set()),
    ("validation/kinds/drag.py", {"physics_drag"}, {"speed_calls", "physics_damping"}),
    ("validation/measuring.py", {"physics_drag", "order_conditions", "speed_start"}, set()),
    ("validation/reference/trade/crane.json", {"speed_trade-crane"}, {"physics_drag", "pointwise"}),
    ("validation/reference/hencky_closed_forms.json", {"physics_finite_chains"}, {"physics_drag"}),
    (f"{dependencies.REFERENCES}spinup_kane_simo.json", {"physics_spin_up", "data_sheets"}, {"physics_drag"}),
    ("validation/scenes/trade/scenes.toml", {"speed_trade-crane"}, {"speed_calls"}),
    ("validation/measured/data/two_link_fsf.csv", {"measured_two_link"}, {"pointwise"}),
    ("validation/cases/physics_drag.toml", {"physics_drag"}, {"pointwise", "speed_trade-crane"}),
    ("validation/cases/speed_trade.toml: crane", {"speed_trade-crane"}, {"speed_trade-t3"}),
    ("models/paper_fig5.toml", {"trajectory_paper_fig5"}, {"physics_drag"}),
])  # fmt: skip
def test_a_file_touches_the_cases_that_use_it(files, file, touched, not_touched) -> None:
    cases = {case for case, own in files.items() if file in own}
    assert touched <= cases
    assert not not_touched & cases


def test_what_only_displays_results_and_the_version_touch_nothing(files: dict[str, dict[str, str]]) -> None:
    every = {path for own in files.values() for path in own}
    without_effect = {*sources.WITHOUT_EFFECT, "flexlink/pages/style.py", "validation/runner.py", "reports/same.py"}
    assert all((ROOT / path).is_file() for path in without_effect)
    assert not without_effect & every


def test_hashes_depend_on_contents_only(files: dict[str, dict[str, str]]) -> None:
    own = files["pointwise"]
    again, other = dict(reversed(own.items())), own | {"models/t3_spatial.toml": "other"}
    assert dependencies.key(own) == dependencies.key(again) != dependencies.key(other)
    assert len({dependencies.key(each) for each in files.values()}) == len(files)


@pytest.mark.parametrize(("now", "words"), [
    ({"a": "1", "b": "2"}, ""),
    ({"a": "1", "b": "3"}, "b changed"),
    ({"a": "1", "b": "3", "c": "4"}, "b changed, and 1 other file"),
    ({"a": "1", "b": "2", "c": "4"}, "c is new"),
    ({"a": "1"}, "b is gone"),
])  # fmt: skip
def test_changes_are_described_by_the_first_file(now: dict[str, str], words: str) -> None:
    found = dependencies.changes(now, {"a": "1", "b": "2"})
    assert found == words
    if found:
        reviewed("validation: what changed", found)


def test_only_data_sheets_use_other_cases() -> None:
    kinds = (ROOT / "validation" / "kinds").glob("*.py")
    users = {path.stem for path in kinds if "load_cases" in path.read_text(encoding="utf-8")}
    assert users == {dependencies.SHEETS}


@pytest.mark.slow
@pytest.mark.parametrize("case", ["robots"])
def test_a_case_uses_no_file_on_which_it_does_not_depend(files: dict[str, dict[str, str]], case: str) -> None:
    command = [sys.executable, str(ROOT / "validation" / "tests" / "opened.py"), case]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT, env=None)
    used = set(shown.stdout.split()) & set(sources.digests())
    assert len(used) > 100
    assert used - set(files[case]) == set()
