"""Each public name has a working example, run in a folder with the models of the checkout."""

from __future__ import annotations

import doctest
import inspect
import runpy
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

import flexlink as fl
from flexlink.dynamics.vibration.modal import Modes
from tests.conftest import ROOT, compiled

pytestmark = compiled  # `prepared.py` prepares a run with compiled kernels

MODULES = {name: module for name in fl.__all__ if inspect.ismodule(module := getattr(fl, name))}
PUBLIC = {name: getattr(fl, name) for name in fl.__all__ if name not in MODULES} | {
    f"{name}.{one}": getattr(module, one) for name, module in MODULES.items() for one in module.__all__
}
RUN = PUBLIC | {"Modes": Modes}  # some results also have examples
SLOW = {"Trajectory", "advise", "compare", "compare_trajectories", "report"}  # other engines, pages, many runs
NEEDS = {"compare": "mujoco", "compare_trajectories": "mujoco", "errors.EngineError": "mujoco", "report": "pinocchio"}


def without_example(names: Mapping[str, object]) -> list[str]:
    """Names of objects whose docstring has no runnable example."""
    return [
        name for name, thing in names.items() if not doctest.DocTestParser().get_examples(inspect.getdoc(thing) or "")
    ]


def examples(name: str, names: dict[str, Any]) -> Iterator[doctest.DocTest]:
    """Examples in the docstrings of a public name and of its public methods."""
    thing = RUN[name]
    parser = doctest.DocTestParser()
    members = inspect.getmembers(thing) if inspect.isclass(thing) else []
    methods = {f"{name}.{key}": value for key, value in members if not key.startswith("_") and inspect.isroutine(value)}
    for place, one in {name: thing, **methods}.items():
        yield parser.get_doctest(inspect.getdoc(one) or "", dict(names), place, None, 0)


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    """The names available to every example, from `prepared.py`."""
    return {"Path": Path, **runpy.run_path(str(ROOT / "tests" / "support" / "prepared.py"))}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in RUN])
def test_examples_run_as_written(
    name: str, names: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    for folder in ("models", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("Agg")
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    printed: list[str] = []
    for test in examples(name, names):
        runner.run(test, out=printed.append)
    assert not runner.failures, "".join(printed)


def test_every_public_name_has_an_example() -> None:
    assert without_example(PUBLIC) == []


def test_a_name_without_an_example_is_reported() -> None:
    def bare() -> None:
        """A docstring without an example, as >> is not a prompt."""

    assert without_example({"mass_matrix": fl.mass_matrix, "bare": bare, "no text": object()}) == ["bare", "no text"]
