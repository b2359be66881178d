"""At startup, only the modules that the command or the public name needs are imported."""

import ast
import gc
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import flexlink as fl
from flexlink.cli.main import main
from tests.conftest import ROOT

PAPER = str(ROOT / "models" / "paper_fig5.toml")
COMMANDS = {path.stem for path in (ROOT / "flexlink" / "cli").glob("*.py")} - {"__init__", "main", "shared", "terminal"}
HEAVY = {"numba", "llvmlite", "numpy", "scipy", "msgspec", "matplotlib", "tomllib", "importlib.metadata"}


def loaded(code: str, *arguments: str) -> set[str]:
    """Modules loaded at the end of a process that runs this code."""
    code = f"import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); {code}"
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return set(done.stderr.splitlines()[-1].split())


def loaded_by(*arguments: str) -> set[str]:
    """Modules loaded at the end of a command."""
    return loaded("from flexlink.cli.main import main; main()", *arguments)


def commands(modules: set[str]) -> set[str]:
    return {name for name in COMMANDS if f"flexlink.cli.{name}" in modules}


def rooms(modules: set[str]) -> set[str]:
    return {name.split(".")[1] for name in modules if name.startswith("flexlink.")}


def test_the_library_loads_only_its_errors() -> None:
    modules = loaded("import flexlink")
    assert modules & HEAVY == set()
    assert rooms(modules) == {"common", "errors", "results"}
    results = "flexlink.results."
    assert {name.removeprefix(results) for name in modules if name.startswith(results)} == {"stop_reasons"}


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], ["nonsense"]], ids=" ".join)
def test_help_loads_no_command(arguments: list[str]) -> None:
    modules = loaded_by(*arguments)
    assert modules & HEAVY == set()
    assert commands(modules) == set()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["info", "simulate"])
def test_a_command_loads_no_other_command_and_no_unused_package(command: str) -> None:
    modules = loaded_by(command, PAPER)
    assert commands(modules) == {command} | ({"modes"} if command == "info" else set())
    others = {"advice", "diagnosis", "engines", "fits", "identification", "pages", "robots", "scene_report", "sweeps"}
    assert rooms(modules) & others == set()
    assert modules & {"matplotlib", "scipy.signal", "scipy.sparse", "scipy.interpolate", "scipy.special"} == set()


@pytest.mark.slow
def test_the_help_of_a_command_loads_only_that_command() -> None:
    modules = loaded_by("robots", "--help")
    assert commands(modules) == {"robots"}


@pytest.mark.slow
def test_a_fit_imports_filters_and_statistics_only_when_it_runs() -> None:
    modules = loaded("import flexlink as fl; fl.fit; fl.fits.FitProblem")
    assert modules & {"scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate"} == set()


def test_public_names_equal_those_seen_by_type_checkers() -> None:
    stub = ast.parse(Path(fl.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    seen = [(str(node.module), node.names[0].name) for node in stub.body if isinstance(node, ast.ImportFrom)]
    for module, name in seen:
        inside = getattr(importlib.import_module(module), name, None)
        public = inspect.unwrap(getattr(fl, name))  # a check of its calls may be around it
        assert public is (inside or importlib.import_module(f"{module}.{name}"))
    assert sorted({name for _, name in seen} - {"__version__"}) == sorted(fl.__all__)


@pytest.mark.slow
def test_garbage_collection_runs_in_a_command_and_is_restored_for_its_caller(capsys) -> None:
    code = (
        "import gc, sys; from flexlink.cli import main, modes\n"
        "modes.run_command = lambda _: print('collects' if gc.isenabled() else 'does not') or 0\n"
        "main.main()"
    )
    done = subprocess.run([sys.executable, "-c", code, "modes", PAPER], capture_output=True, text=True, check=True)
    assert done.stdout == "collects\n"
    before = gc.get_freeze_count()
    assert main(["info", "nowhere.toml"]) == 2
    assert gc.isenabled()
    assert gc.get_freeze_count() <= before  # frozen objects may end, such as caches of the import system
