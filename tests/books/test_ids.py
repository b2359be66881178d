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


def test_warnings_of_a_run_keep_their_ids_in_a_pickle_and_in_an_archive_unless_it_is_an_old_one(tmp_path: Path) -> None:
    falling = make_scene(flexible("a"), gravity=(0.0, 9.81, 0.0))
    run = fl.simulate(falling, step=2e-3, duration=2e-3, unstable="allow")
    ids = [warning.id for warning in run.warnings]
    assert "unstable-step" in ids and all(ids)
    path = run.save(tmp_path / "run.npz")
    for copy in (pickle.loads(pickle.dumps(run)), fl.Trajectory.load(path)):
        assert ([warning.id for warning in copy.warnings], copy.warnings) == (ids, run.warnings)
    arrays = dict(np.load(path))
    del arrays["warning_ids"]
    np.savez(path, **arrays)
    old = fl.Trajectory.load(path)
    assert (old.warnings, {warning.id for warning in old.warnings}) == (run.warnings, {""})


def raised_without_id() -> list[str]:
    """Find errors raised with a new text and without an id, outside handlers that would pass an id on."""
    found = []
    for path in [*SOURCES.rglob("*.py"), *(SOURCES.parent / "flexlink_witnesses").glob("*.py")]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        handled = {inner for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) for inner in ast.walk(node)}
        for node in ast.walk(tree):
            call = node.exc if isinstance(node, ast.Raise) else None
            kind = getattr(errors, getattr(getattr(call, "func", None), "id", ""), None)
            if not (isinstance(kind, type) and issubclass(kind, FlexlinkError)) or kind._id or node in handled:
                continue
            text = call.args[0] if call.args else None
            if isinstance(text, ast.Call):  # raised with the result of a function that returns a Diagnostic
                continue
            if not any(given.arg == "id" for given in call.keywords):
                found.append(f"{path.relative_to(SOURCES.parent)}:{node.lineno}")
    return found


def test_every_error_has_an_id() -> None:
    assert raised_without_id() == []
