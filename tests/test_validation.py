"""The study: cases are checked data, the store loses nothing, a rerun skips what is there, a failed bar is seen."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexlink.errors import SceneError
from flexlink.spec import decode
from validation import case as cases
from validation import runner
from validation.__main__ import main
from validation.case import Measured, load_case, load_cases
from validation.kinds import KINDS
from validation.runner import judge
from validation.store import Row, Series, Store

ROOT = Path(__file__).parent.parent

CASE = """
kind  = "order_conditions"
title = "a title"
about = "a case for tests"
settings.methods = ["RK2"]

[quantity.residual]
metric    = "largest residual"
tolerance = 1e-40
reason    = "exact"
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A study of the one case above, and a way to run it: returns exit code and store."""
    folder = tmp_path / "cases"
    folder.mkdir()
    (folder / "small.toml").write_text(CASE, encoding="utf-8")
    monkeypatch.setattr(cases, "CASES", folder)

    def run(*options):
        code = main(["--no-report", "--results", str(tmp_path / "results"), *options])
        return code, Store(tmp_path / "results")

    run.case_file = folder / "small.toml"
    return run


# the cases of the project


@pytest.mark.parametrize("case", load_cases(), ids=lambda case: case.name)
def test_every_case_is_well_formed_and_every_bar_has_a_reason(case):
    decode(case.settings, KINDS[case.kind].Settings, "settings")
    assert all(path.is_file() for path in case.scene_files)
    assert all(len(q.reason) > 10 and q.metric for q in case.quantity.values())
    assert any(q.tolerance is not None for q in case.quantity.values())


@pytest.mark.parametrize(("change", "message"), [
    (("kind  =", "knd  ="), "knd = 'order_conditions': unknown key"),
    (("tolerance = 1e-40", "tolerance = true"), "quantity.residual.tolerance = True: expected float"),
    (('reason    = "exact"', ""), "quantity.residual.reason: missing"),
    (("kind  =", 'name = "other"\nkind  ='), "name = 'other': unknown key; the name of a case is its file's"),
])  # fmt: skip
def test_a_malformed_case_is_one_line_with_file_key_and_value(tmp_path, change, message):
    path = tmp_path / "bad.toml"
    path.write_text(CASE.replace(*change), encoding="utf-8")
    with pytest.raises(SceneError) as error:
        load_case(path)
    assert str(error.value).startswith(f"{path}: {message}")
    assert "\n" not in str(error.value)


# verdicts


def verdict(value, scale=1.0, **quantity):
    case = cases.Case(
        name="c", kind="k", title="t", about="a",
        quantity={"x": cases.Quantity(metric="m", reason="r", **quantity)},
    )  # fmt: skip
    return judge(case, Measured("x", value, scale=scale), 0.0, "key")


@pytest.mark.parametrize(("value", "bound", "passed"), [
    (1.0, "at most", True), (1.1, "at most", False), (1.0, "at least", True), (0.9, "at least", False),
    (float("nan"), "at most", False), (float("nan"), "at least", False), (float("inf"), "at most", False),
])  # fmt: skip
def test_a_value_passes_only_on_its_side_of_the_bar(value, bound, passed):
    assert verdict(value, tolerance=1.0, bound=bound).passed is passed


def test_without_tolerance_there_is_no_verdict_and_numbers_that_json_lacks_become_null():
    assert verdict(5.0).passed is None
    assert verdict(float("inf")).value is None


def test_a_tolerance_can_be_in_units_of_what_the_physics_predicts():
    row = verdict(1.4e-6, scale=1e-6, tolerance=1.5)
    assert (row.passed, row.tolerance) == (True, 1.5e-6)


# running


def test_a_bar_that_is_met_gives_exit_code_0_and_a_finished_case(study):
    code, store = study()
    [row] = store.rows()
    assert (code, row.case, row.quantity, row.passed) == (0, "small", "residual", True)
    assert store.finished() == {"small": row.key}
    assert store.environment()["versions"]["numpy"] == np.__version__


def test_a_bar_that_is_missed_gives_exit_code_1_and_is_named(study, capsys):
    text = CASE.replace("tolerance = 1e-40", 'tolerance = 1.0\nbound = "at least"')
    study.case_file.write_text(text, encoding="utf-8")
    code, store = study()
    assert (code, store.rows()[0].passed) == (1, False)
    assert "FAILED small: residual" in capsys.readouterr().out


def test_a_failure_that_is_stored_still_fails_the_rerun(study):
    study.case_file.write_text(CASE.replace("1e-40", '1.0\nbound = "at least"'), encoding="utf-8")
    assert study()[0] == 1
    assert study()[0] == 1


def test_a_rerun_skips_what_is_stored_and_force_measures_again(study, monkeypatch):
    runs = []
    honest = KINDS["order_conditions"].run
    monkeypatch.setattr(KINDS["order_conditions"], "run", lambda *a: (runs.append(1), honest(*a))[1])
    study()
    study()
    assert len(runs) == 1
    study("--force")
    assert len(runs) == 2


def test_an_edit_of_the_case_measures_it_again(study):
    key = study()[1].finished()["small"]
    study.case_file.write_text(CASE.replace("a title", "another title"), encoding="utf-8")
    store = study()[1]
    assert store.finished()["small"] != key
    assert [row.title for row in store.rows()] == ["another title"]


def test_a_killed_run_loses_only_the_case_in_hand(study, monkeypatch):
    study.case_file.with_name("a_first.toml").write_text(CASE, encoding="utf-8")
    honest = KINDS["order_conditions"].run

    def dies(case, settings):
        yield from honest(case, settings)
        if case.name == "small":
            raise KeyboardInterrupt

    monkeypatch.setattr(KINDS["order_conditions"], "run", dies)
    code, store = study()
    assert code == 130
    assert set(store.finished()) == {"a_first"}
    first = [row for row in store.rows() if row.case == "a_first"]
    monkeypatch.setattr(KINDS["order_conditions"], "run", honest)
    code, store = study()
    assert code == 0
    assert [row for row in store.rows() if row.case == "a_first"] == first  # not measured again
    assert [row.case for row in store.rows()] == ["a_first", "small"]  # and no row twice


def test_a_bar_that_nothing_measures_is_an_error(study, capsys):
    study.case_file.write_text(CASE.replace("quantity.residual", "quantity.residue"), encoding="utf-8")
    assert study()[0] == 2
    assert "quantity.residue: kind 'order_conditions' does not measure this here" in capsys.readouterr().err


@pytest.mark.parametrize(("change", "message"), [
    (('"order_conditions"', '"orders"'), f"kind = 'orders': unknown; allowed are {', '.join(KINDS)}"),
    (('["RK2"]', '["RK3"]'), "method = 'RK3': unknown; allowed are "),
    (("settings.methods", "settings.method"), "settings.method = ['RK2']: unknown key; allowed are methods"),
])  # fmt: skip
def test_bad_settings_are_one_line_and_exit_code_2(study, capsys, change, message):
    study.case_file.write_text(CASE.replace(*change), encoding="utf-8")
    assert study()[0] == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_case_that_does_not_exist_is_named_with_those_that_do(study, capsys):
    assert study("nothing*")[0] == 2
    assert "case = 'nothing*': no such case; there are small" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "meant"), [
    ([], {"small", "other_thing"}), (["small"], {"small"}), (["other"], {"other_thing"}), (["oth*"], {"other_thing"}),
    (["order"], {"small", "other_thing"}), (["order_conditions"], {"small", "other_thing"}),
    (["small", "other"], {"small", "other_thing"}),
])  # fmt: skip
def test_a_case_is_meant_by_its_name_its_kind_their_first_words_or_a_glob(study, words, meant):
    study.case_file.with_name("other_thing.toml").write_text(CASE, encoding="utf-8")
    code, store = study(*words)
    assert code == 0
    assert {row.case for row in store.rows()} == meant


def test_what_measures_time_runs_last_and_alone(monkeypatch):
    monkeypatch.setattr(runner, "measure", lambda case, key: iter([]))
    monkeypatch.setattr(runner, "WORTH_A_POOL", 1000)
    cases = load_cases()
    ran = runner._in_order_of_completion(cases, {case.name: "" for case in cases}, lambda name, row: None)
    timed = [case.kind in runner.TIMED for case, _ in ran]
    assert timed == sorted(timed)
    assert {"integrators", "speed", "speed_calls"} <= {case.kind for case in cases if case.kind in runner.TIMED}


def test_a_case_that_was_deleted_leaves_the_store(study):
    study.case_file.with_name("gone.toml").write_text(CASE, encoding="utf-8")
    study()
    study.case_file.with_name("gone.toml").unlink()
    assert {row.case for row in study()[1].rows()} == {"small"}


# the store


def row(case="c", **changes):
    values = {
        "case": case, "kind": "k", "title": "t", "scene": "s", "engine": "native", "setting": "RK4 h=0.1 s",
        "quantity": "q̈", "metric": "m", "value": 0.1, "unit": "rad", "tolerance": None, "bound": "at most",
        "passed": None, "reason": "because", "seconds": 0.5, "key": "k",
    }  # fmt: skip
    return Row(**values | changes)


def test_rows_read_back_exactly_and_a_torn_last_line_is_dropped(tmp_path):
    store = Store(tmp_path)
    store.prepare(["c"])
    rows = [row(value=1 / 3), row(value=None, passed=False, tolerance=1e-13)]
    for each in rows:
        store.append(each)
    assert store.rows() == rows
    with (tmp_path / "rows.jsonl").open("a", encoding="utf-8") as file:
        file.write('{"case": "c", "ki')
    assert store.rows() == rows


def test_a_line_that_is_no_row_is_named(study, capsys):
    _, store = study()
    (store.path / "rows.jsonl").write_text('{"case": "small"}\n', encoding="utf-8")
    assert study()[0] == 2
    assert "rows.jsonl, line 1: not a row of this version" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_one_line_and_exit_code_2(study, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    assert study("--results", str(tmp_path / "file" / "results"))[0] == 2
    error = capsys.readouterr().err
    assert f"{tmp_path / 'file' / 'results'}: cannot be written" in error
    assert error.count("\n") == 1


def test_series_read_back_exactly_with_their_labels(tmp_path):
    store = Store(tmp_path)
    store.prepare(["c"])
    columns = {"method": np.array(["RK2", "RK10"]), "step [s]": np.array([0.1, 0.2]), "a/b [m/s]": np.array([1.0, 2.0])}
    put = Series("n.error", "Title", columns, "step [s]", "step [s]", "error", "log", "log", group="method")
    store.add_series("c", put)
    got = store.series("c")["n.error"]
    assert (got.title, got.x, got.y_scale, got.group) == ("Title", "step [s]", "log", "method")
    assert list(got.columns) == list(columns)
    assert all(np.array_equal(got.columns[name], columns[name]) for name in columns)
    store.forget("c")
    assert store.series("c") == {}


def test_the_store_reads_without_engines_and_without_a_terminal_library():
    code = "import sys, validation.store; print([m for m in ('pinocchio', 'mujoco', 'rich') if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert shown.stdout.strip() == "[]"


# the comparison of integrators
