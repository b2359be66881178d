"""The study: cases are checked data, the store loses nothing, a rerun skips what is there, a failed check is seen."""

import datetime
import re
import subprocess
import sys
from concurrent import futures
from pathlib import Path

import numpy as np
import pytest

from flexlink.common.errors import DataFileError, FlexlinkError, OutputError
from flexlink.describe.spec import decode
from reports.results import Results
from tests.words import refused
from validation import case as cases
from validation import runner, sources
from validation.__main__ import main
from validation.case import Measured, load_case, load_cases
from validation.facts import column_head, in_words
from validation.kinds import KINDS, SETTINGS
from validation.runner import judged
from validation.speed import machine
from validation.store import Conditions, Environment, Finished, Planned, Row, Series, Store

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


@pytest.mark.parametrize("case", load_cases(*cases.ALL), ids=lambda case: case.name)
def test_every_case_is_well_formed_and_every_limit_has_a_reason(case):
    decode(case.settings, SETTINGS[case.kind], "settings")
    assert all(path.is_file() for path in case.scene_files)
    assert all(q.metric and (q.tolerance is None or len(q.reason) > 10) for q in case.quantity.values())
    assert any(q.tolerance is not None for q in case.quantity.values())


def test_a_pattern_of_scenes_means_all_of_models_that_it_matches() -> None:
    (case,) = load_cases("generated_files")
    models = cases.MODELS
    assert set(case.scene_files) == {*models.glob("*.toml"), *models.glob("robots/*.toml")}


@pytest.mark.parametrize(("change", "message"), [
    (("kind  =", "knd  ="), "knd = 'order_conditions': unknown key"),
    (("tolerance = 1e-40", "tolerance = true"), "quantity.residual.tolerance = True: expected float"),
    (('reason    = "exact"', ""), "quantity.residual.reason: missing; a tolerance needs one"),
    (("kind  =", 'name = "other"\nkind  ='), "name = 'other': unknown key; a case is named after its file"),
])  # fmt: skip
def test_a_malformed_case_is_one_line_with_file_key_and_value(tmp_path, change, message):
    path = tmp_path / "bad.toml"
    path.write_text(CASE.replace(*change), encoding="utf-8")
    with pytest.raises(DataFileError) as error:
        load_case(path)
    assert str(error.value).startswith(f"{path}: {message}")
    assert "\n" not in str(error.value)


# verdicts


def verdict(value, scale=1.0, **quantity):
    case = cases.Case(
        name="c", kind="k", title="t", about="a",
        quantity={"x": cases.Quantity(metric="m", reason="r", **quantity)},
    )  # fmt: skip
    return judged(case, Measured("x", value, scale=scale), 0.0, "key")


@pytest.mark.parametrize(("value", "bound", "passed"), [
    (1.0, "at most", True), (1.1, "at most", False), (1.0, "at least", True), (0.9, "at least", False),
    (float("nan"), "at most", False), (float("nan"), "at least", False), (float("inf"), "at most", False),
])  # fmt: skip
def test_a_value_passes_only_on_its_side_of_the_limit(value, bound, passed):
    assert verdict(value, tolerance=1.0, bound=bound).passed is passed


def test_without_tolerance_there_is_no_verdict_and_numbers_that_json_lacks_become_null():
    assert verdict(5.0).passed is None
    assert verdict(float("inf")).value is None


def test_a_tolerance_can_be_in_units_of_what_the_physics_predicts():
    row = verdict(1.4e-6, scale=1e-6, tolerance=1.5)
    assert (row.passed, row.tolerance) == (True, 1.5e-6)


# running


def test_a_limit_that_is_kept_gives_exit_code_0_and_a_finished_case(study):
    code, store = study()
    [row] = store.rows()
    assert (code, row.case, row.quantity, row.passed) == (0, "small", "residual", True)
    assert {case: done.key for case, done in store.finished().items()} == {"small": row.key}
    assert {case: planned.key for case, planned in store.plan().items()} == {"small": row.key}
    assert store.environment().versions["numpy"] == np.__version__
    assert store.environment().sources == sources.digests()
    assert store.plan()["small"].about == "a case for tests"


def test_a_check_that_fails_gives_exit_code_1_and_is_named(study, capsys):
    text = CASE.replace("tolerance = 1e-40", 'tolerance = 1.0\nbound = "at least"')
    study.case_file.write_text(text, encoding="utf-8")
    code, store = study()
    assert (code, store.rows()[0].passed) == (1, False)
    assert "FAILED small: residual" in capsys.readouterr().out


def test_a_rerun_skips_what_is_stored_and_force_measures_again(study, monkeypatch):
    runs = []
    honest = KINDS["order_conditions"].run
    monkeypatch.setattr(
        KINDS["order_conditions"], "run", lambda *a, **settings: (runs.append(1), honest(*a, **settings))[1]
    )
    study()
    study()
    assert len(runs) == 1
    study("--force")
    assert len(runs) == 2


def test_a_study_that_is_measured_again_is_not_whole_until_it_is(study, monkeypatch):
    assert study()[1].finished()

    def dies(case, **settings):
        raise KeyboardInterrupt

    monkeypatch.setattr(KINDS["order_conditions"], "run", dies)
    code, store = study("--force")
    assert code == 130
    assert not store.finished()  # so that a report says INCOMPLETE


def test_an_edit_of_the_case_measures_it_again(study):
    key = study()[1].finished()["small"].key
    study.case_file.write_text(CASE.replace("a title", "another title"), encoding="utf-8")
    store = study()[1]
    assert store.finished()["small"].key != key
    assert [row.title for row in store.rows()] == ["another title"]


def test_how_pages_look_is_no_reason_to_measure_again_and_all_that_the_study_imports_is() -> None:
    counted = {path.relative_to(ROOT).as_posix() for path in sources.sources()}
    shown = {path for path in counted if path.startswith(("flexlink/results/pictures/", "flexlink/scene_report/"))}
    imported = {
        module.replace(".", "/")
        for path in (ROOT / "validation").rglob("*.py")
        for module in re.findall(r"(?m)^\s*(?:from|import) (flexlink[\w.]*)", path.read_text(encoding="utf-8"))
    }
    assert len(imported) > 50
    assert {module for module in imported if not {f"{module}.py", f"{module}/__init__.py"} & counted} == set()
    assert shown <= {f"{module}.py" for module in imported}
    assert "flexlink/cli/simulate.py" in counted  # a case times it


def test_a_killed_run_loses_only_the_case_in_hand(study, monkeypatch):
    study.case_file.with_name("a_first.toml").write_text(CASE, encoding="utf-8")
    honest = KINDS["order_conditions"].run

    def dies(case, **settings):
        yield from honest(case, **settings)
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


def test_a_limit_that_nothing_measures_is_an_error(study, capsys):
    study.case_file.write_text(CASE.replace("quantity.residual", "quantity.residue"), encoding="utf-8")
    assert study()[0] == 2
    assert "quantity.residue: kind 'order_conditions' does not measure it here" in capsys.readouterr().err


@pytest.mark.parametrize(("change", "message"), [
    (('"order_conditions"', '"orders"'), f"kind = 'orders': unknown; allowed are {', '.join(KINDS)}"),
    (('["RK2"]', '["RK7"]'), "method = 'RK7': unknown; allowed are "),
    (("settings.methods", "settings.method"), "settings.method = ['RK2']: unknown key; allowed are methods"),
])  # fmt: skip
def test_bad_settings_are_one_line_and_exit_code_2(study, capsys, change, message):
    study.case_file.write_text(CASE.replace(*change), encoding="utf-8")
    assert study()[0] == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_why_a_case_could_not_be_run_is_stored_until_it_is(study):
    study.case_file.write_text(CASE.replace('["RK2"]', '["RK7"]'), encoding="utf-8")
    store = study()[1]
    (missing,) = Results.read(store.path).missing
    assert missing.why.startswith("could not be run: ")
    assert "method = 'RK7': unknown" in missing.why
    study.case_file.write_text(CASE, encoding="utf-8")
    assert study()[1].failed() == {}
    assert Results.read(store.path).missing == ()


def test_a_case_that_does_not_exist_is_named_with_those_that_do(study, capsys):
    assert study("nothing*")[0] == 2
    assert "case = 'nothing*': no such case; available: small" in capsys.readouterr().err


def test_a_full_study_takes_all_cases_even_those_that_run_by_name_and_skips_what_is_stored(study):
    study.case_file.with_name("small_long.toml").write_text("by_name = true\n" + CASE, encoding="utf-8")
    before = study()[1].finished()
    code, store = study("--full")
    assert code == 0
    assert set(store.plan()) == set(store.finished()) == {"small", "small_long"}
    assert store.finished()["small"] == before["small"]


def test_a_full_study_of_some_cases_is_none(study, capsys):
    assert study("--full", "small")[0] == 2
    assert "--full small: --full runs all cases; specify only one of the two" in capsys.readouterr().err


def test_a_case_that_cannot_be_run_is_named_and_keeps_no_other_from_running(study, capsys):
    study.case_file.with_name("a_bad.toml").write_text(CASE.replace('["RK2"]', '["RK7"]'), encoding="utf-8")
    code, store = study()
    assert (code, set(store.finished())) == (2, {"small"})
    assert set(store.plan()) == {"a_bad", "small"}  # so that a report says what is missing
    assert capsys.readouterr().err.startswith("validation: a_bad: ")


@pytest.mark.slow
def test_one_of_many_side_by_side_that_cannot_be_run_keeps_no_other_from_running(study, monkeypatch):
    class Pool(futures.ThreadPoolExecutor):  # processes would not know of the cases of this test
        def __init__(self, *_, **__):
            super().__init__(2)

    monkeypatch.setattr(runner, "_pool", Pool)
    for name in ("b", "c", "d"):
        study.case_file.with_name(f"{name}.toml").write_text(CASE, encoding="utf-8")
    study.case_file.write_text(CASE.replace('["RK2"]', '["RK7"]'), encoding="utf-8")
    code, store = study()
    assert (code, set(store.finished())) == (2, {"b", "c", "d"})


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


def test_a_case_that_runs_by_its_name_waits_for_it_and_is_no_part_of_a_whole_study_before(study):
    study.case_file.with_name("small_long.toml").write_text("by_name = true\n" + CASE, encoding="utf-8")
    assert {row.case for row in study("small")[1].rows()} == {"small"}
    assert set(study()[1].plan()) == {"small"}
    assert {row.case for row in study("small_long")[1].rows()} == {"small", "small_long"}
    assert set(study()[1].plan()) == {"small", "small_long"}


def test_a_case_in_parts_is_stored_part_by_part_each_with_the_limits_of_all_and_its_own(study, monkeypatch):
    own = '[quantity."RK4, other"]\nmetric = "m"\n'
    text = CASE.replace('["RK2"]', '["RK2", "RK4"]').replace("settings", 'parts = "methods"\nsettings', 1)
    study.case_file.write_text(text, encoding="utf-8")
    assert {row.case for row in study("small-RK4")[1].rows()} == {"small-RK4"}
    again = {"small-RK2", "small-RK4"}
    first = study("small-RK4")[1].finished()["small-RK4"].date
    monkeypatch.setattr(runner, "_date", lambda: datetime.datetime.now(datetime.UTC) + datetime.timedelta(hours=1))
    finished = study("small")[1].finished()
    assert set(finished) == again
    assert finished["small-RK4"].date == first < finished["small-RK2"].date
    study.case_file.write_text(text + own, encoding="utf-8")
    assert study("small-RK2")[0] == 0  # what is named after a part is no matter of another one
    assert study("small-RK4")[0] == 2  # which must measure it


def test_parts_that_are_no_list_of_the_settings_are_one_line(study, capsys):
    study.case_file.write_text(CASE.replace("settings", 'parts = "method"\nsettings', 1), encoding="utf-8")
    assert study()[0] == 2
    assert "parts = 'method': is not a list in the settings" in capsys.readouterr().err


def test_the_full_study_measures_times_alone_the_short_one_those_that_a_limit_judges(study, monkeypatch):
    given = []

    def nothing(cases, keys, report, alone):
        given.append(alone)
        return iter(())

    monkeypatch.setattr(runner, "_in_order_of_completion", nothing)
    study()
    study("--full")
    assert given == [runner.TIMED - runner.BESIDE, runner.TIMED]
    assert {"integrators", "speed_start"} <= runner.BESIDE <= runner.TIMED


def test_no_limit_judges_a_time_that_is_measured_beside_other_cases():
    """But those of whole commands, of which it is a multiple."""
    limited = {
        case.kind
        for case in load_cases()
        for each in case.quantity.values()
        if each.tolerance and each.unit in {"s", "ms", "µs"}
    }
    assert runner.BESIDE & limited == {"speed_start"}


def test_what_measures_time_runs_last_and_alone(monkeypatch):
    monkeypatch.setattr(runner, "measure", lambda case, key: iter([]))
    monkeypatch.setattr(runner, "WORTH_A_POOL", 1000)
    cases = load_cases()
    ran = runner._in_order_of_completion(cases, {case.name: "" for case in cases}, lambda name, row: None, runner.TIMED)
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
        "case": case, "kind": "k", "title": "t", "scene": "s", "engine": "native", "varied": {"method": "RK4", "n": 3},
        "quantity": "q̈", "metric": "m", "value": 0.1, "unit": "rad", "tolerance": None, "bound": "at most",
        "passed": None, "timed": False, "reason": "because", "note": "", "given_up": "", "seconds": 0.5, "key": "k",
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


def test_series_read_back_exactly_with_their_labels(tmp_path):
    store = Store(tmp_path)
    store.prepare(["c"])
    columns = {"method": np.array(["RK2", "RK10"]), "step [s]": np.array([0.1, 0.2]), "a/b [m/s]": np.array([1.0, 2.0])}
    labels = "step [s]", "step [s]", "error"
    put = Series("error", "Title", columns, *labels, "log", "log", group="method", scene="n", legend={"a/b [m/s]": "v"})
    store.add_series("c", put)
    got = store.series("c")["n.error"]
    assert (got.title, got.x, got.y_scale, got.group, got.scene) == ("Title", "step [s]", "log", "method", "n")
    assert got.legend == put.legend
    assert list(got.columns) == list(columns)
    assert all(np.array_equal(got.columns[name], columns[name]) for name in columns)
    store.forget("c")
    assert store.series("c") == {}


@pytest.mark.parametrize("name", ["finished.json", "plan.json", "environment.json", "series/small.a.npz"])
@pytest.mark.parametrize("torn", [0.0, 0.95])
def test_a_torn_file_of_the_store_is_one_line_that_names_it(tmp_path, name, torn):
    store = stored_everything(tmp_path)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: int(torn * len(whole))])
    with refused(FlexlinkError, "test-validation") as error:
        for read in (store.finished, store.plan, store.environment, lambda: store.series("small")):
            read()
    assert str(error.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(error.value)


def stored_everything(folder):
    """A store with one finished case and a series."""
    store = Store(folder)
    store.prepare(["small"])
    store.note_environment(Environment(python="3.11"))
    store.note_plan({"small": Planned("k", "kind", "title")})
    store.add_series("small", Series("a", "Title", {"x": np.arange(3.0), "y": np.ones(3)}, "x", "x", "y"))
    store.append(row("small"))
    store.finish("small", Finished("k", datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC), "machine", None))
    return store


def test_a_study_with_a_torn_store_is_one_line_and_exit_code_2(study, capsys):
    _, store = study()
    (store.path / "finished.json").write_text('{"small": {"key": "', encoding="utf-8")
    assert study()[0] == 2
    error = capsys.readouterr().err
    assert "finished.json: cannot be read" in error
    assert error.count("\n") == 1


# what was varied


def test_what_was_varied_is_typed_and_said_in_words():
    facts = {"method": "RK4", "step": 1e-4, "hinges": 10, "n": 4, "steps": 10_000}
    assert in_words(facts) == "RK4, h = 0.0001 s, 10 hinges, n = 4, 10,000 steps"
    assert (column_head("step"), column_head("nobody foresaw")) == ("step [s]", "nobody foresaw")
    assert in_words({"nobody foresaw": 3}) == "nobody foresaw 3"


# correctness and speed


QUIET, BUSY = Conditions(0.05, 0.1, cores=2), Conditions(1.9, 0.1, cores=2)


@pytest.fixture
def timed(study, monkeypatch):
    """The study's case as one that is judged by its time, too; its way to run takes what the machine does."""
    kind = KINDS["order_conditions"]
    honest = kind.run

    def run(case, **settings):
        yield from honest(case, **settings)
        yield Measured("time", 2.0, timed=True)

    monkeypatch.setattr(kind, "run", run)
    monkeypatch.setattr(runner, "TIMED", {"order_conditions"})
    study.limit = 1.0

    def measure(conditions, *options):
        time = f"\n[quantity.time]\nmetric = 'm'\nunit = 's'\ntolerance = {study.limit}\nreason = 'a reason'\n"
        study.case_file.write_text(CASE + time, encoding="utf-8")
        watch = type("LoadMonitor", (), {"conditions": lambda self: conditions})
        monkeypatch.setattr(runner, "LoadMonitor", watch)
        return study(*options)

    return measure


def test_a_missed_limit_of_time_leaves_exit_code_0_and_correctness_alone(timed, capsys):
    code, store = timed(QUIET)
    said = capsys.readouterr().out
    assert code == 0
    assert [row.passed for row in store.rows()] == [True, False]
    assert "correctness: 1 of 1 checks pass" in said
    assert "speed: 1 missed on this machine" in said
    assert "missed small: time" in said
    assert "FAILED" not in said


def test_on_a_busy_machine_a_limit_of_time_is_neither_met_nor_missed(timed, study, capsys):
    for study.limit in (1.0, 3.0):
        assert timed(BUSY)[0] == 0
        said = " ".join(capsys.readouterr().out.split())
        assert "correctness: 1 of 1 checks pass" in said
        assert "1 not measured because the machine was busy (other processes used 1.9 of 2 cores" in said
        assert "missed" not in said


def test_a_failing_check_of_correctness_still_fails_beside_limits_of_time_that_are_met(timed, study, monkeypatch):
    study.limit = 3.0
    monkeypatch.setitem(globals(), "CASE", CASE.replace("1e-40", '1.0\nbound = "at least"'))
    assert timed(QUIET)[0] == 1


def test_what_was_timed_on_a_busy_machine_is_timed_again_and_what_was_not_is_skipped(timed):
    first = timed(BUSY)[1].finished()["small"]
    second = timed(QUIET)[1].finished()["small"]
    assert (first.busy, second.busy) == (True, False)
    assert timed(BUSY)[1].finished()["small"] == second


def test_a_full_study_goes_on_and_times_nothing_again_even_on_a_busy_machine(timed):
    first = timed(BUSY)[1].finished()["small"]
    assert timed(QUIET, "--full")[1].finished()["small"] == first


@pytest.mark.parametrize(("conditions", "busy"), [
    (Conditions(0.0, 0.2, 2), False), (Conditions(0.19, 0.0, 2), False), (Conditions(0.21, 0.0, 2), True),
    (Conditions(0.21, 0.0, 8), False), (Conditions(None, 0.29, 2), False), (Conditions(None, 0.31, 2), True),
])  # fmt: skip
def test_a_machine_is_busy_by_what_others_take_of_it_or_by_an_uneven_loop(conditions, busy):
    assert conditions.busy is busy


def test_the_watch_counts_what_others_run_and_not_the_work_that_is_timed(monkeypatch):
    readings = machine.ClockReading(10.0, 100.0, 50.0), machine.ClockReading(20.0, 125.0, 60.0)
    clocks = iter(readings)  # 25 core seconds, 10 our own
    monkeypatch.setattr(machine, "_read", lambda: next(clocks))
    monkeypatch.setattr(machine, "_laps", lambda: [1.0, 1.0, 1.0, 3.0])
    found = machine.LoadMonitor().conditions()
    assert (found.load, found.spread) == (1.5, 0.5)


def test_where_nobody_counts_the_load_only_the_loop_decides(monkeypatch):
    monkeypatch.setattr(machine, "PROC_STAT", Path("/nowhere/stat"))
    assert machine.LoadMonitor().conditions().load is None


def test_all_kinds_are_found_by_being_there():
    files = {path.stem for path in (ROOT / "validation" / "kinds").glob("*.py")} - {"__init__"}
    assert set(KINDS) == files
    assert all(hasattr(kind, "run") for kind in KINDS.values())
    assert set(SETTINGS) == files


def test_a_study_without_its_checkout_says_that_it_needs_one(study, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("validation.__main__.MODELS", tmp_path / "site-packages" / "models")
    assert study()[0] == 2
    error = capsys.readouterr().err
    assert "models: no such folder; the study needs a checkout of the project" in error
    assert error.count("\n") == 1


def test_a_study_says_its_verdict_even_if_no_report_can_be_written(tmp_path, study, capsys, monkeypatch):
    def fails(*_):
        raise OutputError("no space left")

    monkeypatch.setattr("validation.__main__._report", fails)
    assert main(["--results", str(tmp_path / "results")]) == 2
    said = capsys.readouterr()
    assert "correctness: 1 of 1 checks pass" in said.out
    assert said.err == "validation: no space left\n"


@pytest.mark.slow
def test_the_store_reads_without_engines_and_without_a_terminal_library():
    code = "import sys, validation.store; print([m for m in ('pinocchio', 'mujoco', 'rich') if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert shown.stdout.strip() == "[]"


# what is left out


ROWS = """
kind  = "order_conditions"
title = "a title"
about = "a case for tests"
settings.methods = ["RK2", "RK4"]

[quantity.residual]
metric    = "largest residual"
tolerance = 1e-40
reason    = "exact"
"""


@pytest.mark.parametrize(("stated", "said"), [
    ("rows = 2", ""), ('rows = "by machine"', ""),
    ("", "residual () = 2.0 rows, limit at most 1.0. The case states 1; measured: 2 native."),
    ("rows = 3", "residual () = 2.0 rows, limit at least 3.0. The case states 3; measured: 2 native."),
])  # fmt: skip
def test_a_quantity_that_is_measured_more_or_less_often_than_its_case_says_fails_and_says_so(
    study, capsys, stated, said
):
    study.case_file.write_text(ROWS + stated, encoding="utf-8")
    assert study()[0] == bool(said)
    out = capsys.readouterr().out
    assert ("FAILED small: rows of " + said if said else "2 of 2 checks pass") in out.replace("\n", " ")


def test_a_number_that_is_measured_twice_fails_and_says_which(study, capsys):
    study.case_file.write_text(ROWS.replace('"RK4"', '"RK2"') + "rows = 2", encoding="utf-8")
    code, store = study()
    (row,) = (row for row in store.rows() if row.passed is False)
    assert (code, row.quantity, row.note) == (1, "rows of residual", "Measured twice: , native, method RK2, order 2.")


def test_a_case_with_data_is_left_out_where_they_are_missing_and_told(study, capsys, tmp_path):
    study.case_file.with_name("with_data.toml").write_text('needs = "nowhere/at_all.csv"\n' + CASE, encoding="utf-8")
    study.case_file.with_name("with_some.toml").write_text(f'needs = "{tmp_path}"\n' + CASE, encoding="utf-8")
    code, store = study()
    assert (code, set(store.finished())) == (0, {"small", "with_some"})
    out = capsys.readouterr().out
    assert "left out: with_data: needs nowhere/at_all.csv, which is not here" in out
    assert "left out: with_some" not in out
    assert study("small")[0] == 0
    assert "left out" not in capsys.readouterr().out
