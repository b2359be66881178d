"""Every error has a stable id, which survives wrapping and pickles."""

from __future__ import annotations

import ast
import pickle
from pathlib import Path

import pytest

import flexlink as fl
from flexlink import errors
from flexlink.common.errors import ConvergenceError, FlexlinkError, SceneError, UnstableStepError
from flexlink.common.wording import Diagnostic

SOURCES = Path(fl.__file__).parent


def quoting() -> FlexlinkError:
    try:
        try:
            raise SceneError("length = -1: must be > 0", id="out-of-range")
        except SceneError as error:
            raise errors.DataFileError(f"arm.toml: {error}") from None
    except FlexlinkError as error:
        return error


def test_an_error_that_quotes_another_has_its_id() -> None:
    assert quoting().id == "out-of-range"


@pytest.mark.parametrize(
    "error", [quoting(), UnstableStepError("h", 1e-4, id="unstable-step"), ConvergenceError("q", None, 0.5, id="x")]
)
def test_an_error_keeps_its_id_and_attributes_in_a_pickle(error: FlexlinkError) -> None:
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), str(copy), copy.id) == (type(error), str(error), error.id)
    assert {**vars(copy), "_id": ""} == {**vars(error), "_id": ""}


def test_a_diagnostic_is_its_text_and_keeps_its_id_in_a_pickle() -> None:
    doubt = pickle.loads(pickle.dumps(Diagnostic("sags by 3 m", "large-sag")))
    assert (doubt, doubt.id) == ("sags by 3 m", "large-sag")


def raised_without_id() -> list[str]:
    """Errors that are raised with a text of their own, outside a handler that would pass an id on, and no id."""
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
            if isinstance(text, ast.Call):  # of a function that returns a Diagnostic
                continue
            if not any(given.arg == "id" for given in call.keywords):
                found.append(f"{path.relative_to(SOURCES)}:{node.lineno}")
    return found


def test_every_error_has_an_id() -> None:
    assert raised_without_id() == []
