"""Code size metrics may fall but not rise: a change that lowers a metric also lowers its limit here.

A file mentions a feature if one of its words is in code, comments or docstrings.
"""

import ast
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import flexlink as fl

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
CONTRACTS = PROJECT["tool"]["importlinter"]["contracts"]
BARS = {
    "layers of imports": 10, "classes": 405, "constants": 437, "public names": 76, "files of more than 500 lines": 0,
    "functions of more than 60 lines of code": 1, "lines of contracts": 56, "lines": 67_880, "files": 420,
    "longest chain of imports": 34, "files that simulate imports": 149, "depth of simulate": 24,
}  # fmt: skip
COMPILES = "kernels compile in two thirds of the time, and a wheel has one archive for all processors"
LOOPS = (
    "ties: loops, cylinders, stops, ropes, in runs, statics, modes and MJCF; runs start from what earlier runs prepared"
)
CURVED = "links that are curved, twisted or warm on one side at rest"
ADJOINT = "gradients of runs by all torques and the initial state, for arms in a plane and in space"
WRONG = "fits compare residuals with noise from elsewhere, and try physical causes; intervals of uncertain inputs"
SUMMED = "sweeps sum up statistics of their members"
READING = "reports have intervals, and a number fitted to one reading predicts others"
RAISED = {
    "public names": (3, f"to_fmu writes an arm for simulators of whole machines; {ADJOINT}; Dynamics, in loops"),
    "lines of contracts": (7, "fits, sweeps, reports, advice and robots call the library, not its kernels"),
    "classes": (28, f"{COMPILES}; {LOOPS}; names of ties; {CURVED}; FMUs; {ADJOINT}; {WRONG}; {SUMMED}; solid films"),
    "constants": (29, f"{COMPILES}; {LOOPS}; {WRONG}; {SUMMED}"),
    "lines": (620, f"{COMPILES}; {LOOPS}"), "files": (16, f"{LOOPS}; {ADJOINT}; {WRONG}; {SUMMED}; {READING}"),
    "files that simulate imports": (6, f"{LOOPS}; uncertain inputs of a scene"),
}  # fmt: skip
"""By how much a limit may be exceeded, and the reason."""
HOPS = 8
"""Calls from `simulate` to the equation of motion, as a debugger shows them."""
SHALLOW = """
import sys
import flexlink as fl

def look(frame, event, argument):
    if event == "call" and frame.f_code.co_name in ("planar", "articulated"):
        calls = 0
        while frame.f_code is not fl.simulate.__code__:
            frame, calls = frame.f_back, calls + 1
        print(calls)
        sys.exit()

scene = fl.load_scene(sys.argv[1]).varied({"run": fl.RunSettings(step=1e-5, sample=1e-5, duration=1e-5)})
sys.setprofile(look)
fl.simulate(scene)
"""
FEATURES = {
    "slides": ("slides|prismatic", 76), "couplings": ("coupl", 59), "branches": ("branch", 36),
    "free base": ("free.base", 32), "rotation springs": ("rotation.spring", 21), "drag": ("drag", 25),
}  # fmt: skip


@cache
def sources(folder: str) -> dict[Path, str]:
    return {path: path.read_text("utf-8") for path in sorted((ROOT / folder).rglob("*.py"))}


def definitions_in(part: ast.AST) -> Iterator[ast.ClassDef | ast.FunctionDef]:
    """Classes and functions; only statements are visited, since expressions contain no definitions."""
    for child in ast.iter_child_nodes(part):
        if isinstance(child, ast.ClassDef | ast.FunctionDef):
            yield child
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield from definitions_in(child)


def length(node: ast.FunctionDef) -> int:
    """Lines of a function without comments, blank lines and its docstring."""
    if (node.end_lineno or 0) - node.lineno < 60:
        return 0
    text = ast.unparse(node)
    return text.count("\n") + 1 - (ast.get_docstring(node, clean=False) or "").count("\n")


def counts() -> dict[str, int]:
    """The code size metrics."""
    every = sources("flexlink")
    trees = [ast.parse(text) for text in every.values()]
    definitions = [each for tree in trees for each in definitions_in(tree)]
    constants = (
        target.id for tree in trees for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in ast.walk(node) if isinstance(target, ast.Name) and isinstance(target.ctx, ast.Store)
    )  # fmt: skip
    layers = next(each["layers"] for each in CONTRACTS if each.get("containers") == ["flexlink"])
    linter = (ROOT / "pyproject.toml").read_text("utf-8").split("[tool.importlinter]")[1].split("\n[tool.")[0]
    return {
        "layers of imports": len(layers),
        "classes": sum(isinstance(node, ast.ClassDef) for node in definitions),
        "constants": sum(name.isupper() for name in constants),
        "public names": len(fl.__all__),
        "files of more than 500 lines": sum(text.count("\n") > 500 for text in every.values()),
        "functions of more than 60 lines of code": sum(
            isinstance(node, ast.FunctionDef) and length(node) > 60 for node in definitions
        ),
        "lines of contracts": linter.count("\n"),
        "lines": sum(text.count("\n") for text in every.values()),
        "files": len(every),
        "longest chain of imports": max(map(depth, modules())),
        "files that simulate imports": len(loaded_with("flexlink.motion.simulate")),
        "depth of simulate": depth("flexlink.motion.simulate"),
    }


@cache
def modules() -> dict[str, Path]:
    """All modules of the library by their name; the face of a package only hands names on and does not count."""
    files = (path for path in sources("flexlink") if path.name != "__init__.py")
    return {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in files}


@cache
def imported(name: str) -> frozenset[str]:
    """Modules of the library that a module imports when it is imported itself."""
    body = ast.parse(sources("flexlink")[modules()[name]]).body
    named = ((node.module, alias.name) for node in body if isinstance(node, ast.ImportFrom) for alias in node.names)
    places = (f"{module}.{each}" if f"{module}.{each}" in modules() else str(module) for module, each in named)
    return frozenset(places) & modules().keys() - {name}


@cache
def depth(name: str) -> int:
    """Number of files in the longest chain of imports that begins with a module."""
    return 1 + max(map(depth, imported(name)), default=0)


@cache
def loaded_with(name: str) -> frozenset[str]:
    """A module, and all modules of the library that are imported with it."""
    return frozenset({name}).union(*map(loaded_with, imported(name)))


def test_no_code_size_metric_grows() -> None:
    found = counts()
    allowed = {what: bar + RAISED.get(what, (0, ""))[0] for what, bar in BARS.items()}
    assert {what: number for what, number in found.items() if number > allowed[what]} == {}, found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_fig5", "t3_spatial"])
def test_few_calls_lie_between_simulate_and_the_equation_of_motion(name: str) -> None:
    command = [sys.executable, "-c", SHALLOW, str(ROOT / "models" / f"{name}.toml")]
    without_compiler = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    shown = subprocess.run(command, capture_output=True, text=True, env=without_compiler, check=True)
    assert int(shown.stdout) <= HOPS


@pytest.mark.parametrize("feature", FEATURES)
def test_the_number_of_files_that_mention_a_feature_does_not_grow(feature: str) -> None:
    words, most = FEATURES[feature]
    files = [path.name for path, text in sources("flexlink").items() if re.search(words, text, re.IGNORECASE)]
    assert len(files) <= most, f"{len(files)}: {files}"
