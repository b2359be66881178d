"""Each public name has an example that gives its printed result, in a folder with the checkout's models."""

from __future__ import annotations

import doctest
import inspect
import runpy
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest
from conftest import ROOT, compiled

import flexlink as fl
from flexlink.dynamics.vibration.modal import Modes

pytestmark = compiled  # the run that is prepared

MODULES = {name: module for name in fl.__all__ if inspect.ismodule(module := getattr(fl, name))}
PUBLIC = {name: getattr(fl, name) for name in fl.__all__ if name not in MODULES} | {
    f"{name}.{one}": getattr(module, one) for name, module in MODULES.items() for one in module.__all__
}
RUN = PUBLIC | {"Modes": Modes}  # some results also have examples
SLOW = {"Trajectory", "advise", "compare", "compare_trajectories", "report"}  # other engines, pages, many runs
NEEDS = {"compare": "mujoco", "compare_trajectories": "mujoco", "errors.EngineError": "mujoco", "report": "pinocchio"}


def without_example(names: Mapping[str, object]) -> list[str]:
    """Names of those whose docstring shows nothing that runs."""
    return [
        name for name, thing in names.items() if not doctest.DocTestParser().get_examples(inspect.getdoc(thing) or "")
    ]


def examples(name: str, names: dict[str, Any]) -> Iterator[doctest.DocTest]:
    """Docstrings of a public name and of its public methods."""
    thing = RUN[name]
    parser = doctest.DocTestParser()
    members = inspect.getmembers(thing) if inspect.isclass(thing) else []
    methods = {f"{name}.{key}": value for key, value in members if not key.startswith("_") and inspect.isroutine(value)}
    for place, one in {name: thing, **methods}.items():
        yield parser.get_doctest(inspect.getdoc(one) or "", dict(names), place, None, 0)


@pytest.fixture(scope="module")
def names() -> dict[str, Any]:
    """What every example finds at hand: that of `prepared.py`."""
    return {"Path": Path, **runpy.run_path(str(Path(__file__).with_name("prepared.py")))}


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
    told: list[str] = []
    for test in examples(name, names):
        runner.run(test, out=told.append)
    assert not runner.failures, "".join(told)


def test_every_public_name_has_an_example() -> None:
    assert without_example(PUBLIC) == []


def test_a_name_without_an_example_is_reported() -> None:
    def bare() -> None:
        """Has no example: >> is no prompt."""

    assert without_example({"mass_matrix": fl.mass_matrix, "bare": bare, "no text": object()}) == ["bare", "no text"]
