"""Every error has a stable id, which is kept if the error is wrapped or pickled."""

import ast
import pickle
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink import errors
from flexlink.common.errors import ConvergenceError, Diagnostic, FlexlinkError, SceneError, UnstableStepError
from tests.conftest import flexible, make_scene

SOURCES = Path(fl.__file__).parent


def quoting() -> FlexlinkError:
    try:
        try:
            raise SceneError("length = -1: must be > 0", id="out-of-range")
        except SceneError as error:
            raise errors.DataFileError(f"arm.toml: {error}") from None
    except FlexlinkError as error:
        return error


def test_an_error_that_quotes_another_keeps_its_id() -> None:
    assert quoting().id == "out-of-range"


@pytest.mark.parametrize(
    "error", [quoting(), UnstableStepError("h", 1e-4, id="unstable-step"), ConvergenceError("q", None, 0.5, id="x")]
)
def test_an_error_keeps_its_id_and_attributes_in_a_pickle(error: FlexlinkError) -> None:
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy), copy.id) == (type(error), str(error), error.id)
    assert {**vars(copy), "_id": ""} == {**vars(error), "_id": ""}


def test_a_diagnostic_is_a_string_and_keeps_its_id_in_a_pickle() -> None:
    doubt = pickle.loads(pickle.dumps(Diagnostic("sags by 3 m", "large-sag")))
    assert (doubt, doubt.id) == ("sags by 3 m", "large-sag")


def rod(step: float, start: float = 170.0, samples: int = 100, **changes: object) -> fl.Trajectory:
    """A rod released at an angle [deg]; 180 is upright."""
    link = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    scene = make_scene(link, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(start,)))
    run = {"run.step": step, "run.sample": step, "run.duration": samples * step, "run.unstable": "allow"}
    return fl.simulate(scene.varied({**run, **changes}))


def soft(**changes: object) -> fl.Scene:
    """A link so soft that it bends beyond 84°."""
    scene = make_scene(
        flexible("a", "xyz", 2, joint=fl.Joint(locked=True), lumping="midpoint"), gravity=(0.0, 0.0, -60.0)
    )
    return scene.varied({"material.aluminium": fl.Material(young=2e6, density=1000.0), **changes})


def falling() -> fl.Scene:
    """A flexible link that falls."""
    return make_scene(flexible("a"), gravity=(0.0, 9.81, 0.0))


WARNED = {
    "unstable-step": lambda: fl.simulate(falling(), step=2e-3, duration=2e-3, unstable="allow"),
    "energy-imbalance": lambda: rod(0.35),
    "joint-past-limits": lambda: rod(0.01, 40.0, **{"link.a.joint.limits_deg": (30.0, 45.0)}),
    "doubtful-step-errors": lambda: rod(0.17, samples=200),
    "doubtful-rounding": lambda: rod(1e-6, 20.0 + 3.6e10, samples=1000),
    "hinge-bent-far": lambda: fl.simulate(soft(), step=1e-4, sample=1e-2, duration=0.7),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WARNED)
def test_every_warning_of_a_run_keeps_its_id_in_a_pickle_and_in_an_archive(name: str, tmp_path: Path) -> None:
    run = WARNED[name]()
    ids = [warning.id for warning in run.warnings]
    assert name in ids and all(ids)
    for copy in (pickle.loads(pickle.dumps(run)), fl.Trajectory.load(run.save(tmp_path / "run.npz"))):
        assert ([warning.id for warning in copy.warnings], copy.warnings) == (ids, run.warnings)


def test_an_archive_without_ids_of_warnings_is_loaded(tmp_path: Path) -> None:
    run = WARNED["unstable-step"]()
    arrays = dict(np.load(run.save(tmp_path / "run.npz")))
    del arrays["warning_ids"]
    np.savez(tmp_path / "old.npz", **arrays)
    old = fl.Trajectory.load(tmp_path / "old.npz")
    assert old.warnings == run.warnings
    assert {warning.id for warning in old.warnings} == {""}


FAILED = {
    "diverged": lambda: fl.simulate(falling(), step=5e-3, duration=5.0, unstable="allow"),
    "energy-imbalance": lambda: rod(0.35, **{"run.unstable": "refuse"}),
    "newton-failed": lambda: fl.simulate(
        falling().varied({"initial.rate_deg": (3e4,)}), method="Radau5", step=0.1, sample=0.1
    ),
    "too-many-evaluations": lambda: fl.simulate(soft(), tolerance=1e-8, duration=1.0, max_evaluations=200),
}


@pytest.mark.parametrize("name", FAILED)
def test_the_error_of_a_failed_run_has_the_id_of_its_cause(name: str) -> None:
    with pytest.raises(fl.errors.DivergenceError) as caught:
        FAILED[name]()
    assert caught.value.id == name
    assert pickle.loads(pickle.dumps(caught.value)).id == name


def raised_without_id() -> list[str]:
    """Find errors raised with a new text and without an id, outside handlers that would pass an id on."""
    found = []
    for path in SOURCES.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        handled = {inner for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) for inner in ast.walk(node)}
        for node in ast.walk(tree):
            call = node.exc if isinstance(node, ast.Raise) else None
            kind = (
                getattr(errors, call.func.id, None)
                if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
                else None
            )
            if not (isinstance(kind, type) and issubclass(kind, FlexlinkError)) or kind._id or node in handled:
                continue
            text = call.args[0] if call.args else None
            if isinstance(text, ast.Call):  # raised with the result of a function that returns a Diagnostic
                continue
            if not any(given.arg == "id" for given in call.keywords):
                found.append(f"{path.relative_to(SOURCES)}:{node.lineno}")
    return found


def test_every_error_has_an_id() -> None:
    assert raised_without_id() == []
