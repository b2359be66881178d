"""The validation study: case files, the store of results, reruns, and failed checks."""

import datetime
import re
import subprocess
import sys
from concurrent import futures
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest

from flexlink.common.errors import DataFileError, FlexlinkError, OutputError
from flexlink.describe.spec import decode
from reports.results import Results
from tests.support.words import line, refused, reviewed
from validation import case as cases
from validation import dependencies, runner, sources
from validation.__main__ import main
from validation.case import Measured, load_case, load_cases
from validation.facts import column_head, in_words
from validation.kinds import KINDS
from validation.measuring import judged
from validation.speed import machine
from validation.store import STOPPED, Conditions, Environment, Finished, Planned, Series, Store
from validation.tests.studies import row

ROOT = Path(__file__).parents[2]
KIND = KINDS["order_conditions"]

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
    """A study of the case above, and a function that runs it and returns exit code and store."""
    folder = tmp_path / "cases"
    folder.mkdir()
    (folder / "small.toml").write_text(CASE, encoding="utf-8")
    monkeypatch.setattr(cases, "CASES", folder)

    def run(*options):
        code = main(["--no-report", "--results", str(tmp_path / "results"), *options])
        return code, Store(tmp_path / "results")

    run.case_file = folder / "small.toml"
    return run


@pytest.fixture
def watched(monkeypatch):
    """Function that adds what happens before and after the measurements of each case."""
    honest = KIND.run

    def add(before=lambda name: None, after=lambda name: None):
        def run(case, **settings):
            before(case.name)
            yield from honest(case, **settings)
            after(case.name)

        monkeypatch.setattr(KIND, "run", run)

    return add


def dies(name):
    if name == "small":
        raise KeyboardInterrupt


@pytest.mark.parametrize("case", load_cases(*cases.ALL), ids=lambda case: case.name)
def test_every_case_is_valid_and_every_limit_has_a_reason(case):
    decode(case.settings, KINDS[case.kind].settings, "settings")
    assert all(path.is_file() for path in case.scene_files)
    assert all(q.metric and (q.tolerance is None or len(q.reason) > 10) for q in case.quantity.values())
    assert any(q.tolerance is not None for q in case.quantity.values())


def test_a_pattern_selects_all_matching_scenes() -> None:
    (case,) = load_cases("generated_files")
    models = cases.MODELS
    assert set(case.scene_files) == {*models.glob("*.toml"), *models.glob("robots/*.toml")}


@pytest.mark.parametrize(("change", "key", "id"), [
    (("kind  =", "knd  ="), "knd = 'order_conditions'", "unknown-key"),
    (("tolerance = 1e-40", "tolerance = true"), "quantity.residual.tolerance = True", "wrong-value"),
    (('reason    = "exact"', ""), "quantity.residual.reason", "missing-key"),
    (("kind  =", 'name = "other"\nkind  ='), "name = 'other'", "unknown-key"),
])  # fmt: skip
def test_a_malformed_case_is_one_line_with_file_key_and_value(tmp_path, change, key, id):
    path = tmp_path / "bad.toml"
    path.write_text(CASE.replace(*change), encoding="utf-8")
    with refused(DataFileError, id) as error:
        load_case(path)
    assert str(error.value).startswith(f"{path}: {key}: ")
    assert "\n" not in str(error.value)


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
def test_a_value_passes_only_on_the_right_side_of_the_limit(value, bound, passed):
    assert verdict(value, tolerance=1.0, bound=bound).passed is passed


def test_a_value_without_tolerance_has_no_verdict_and_infinity_is_stored_as_null():
    assert verdict(5.0).passed is None
    assert verdict(float("inf")).value is None


def test_a_tolerance_is_multiplied_by_the_scale():
    row = verdict(1.4e-6, scale=1e-6, tolerance=1.5)
    assert (row.passed, row.tolerance) == (True, 1.5e-6)


def test_a_met_limit_gives_exit_code_0_and_a_finished_case(study):
    code, store = study()
    [row] = store.rows()
    assert (code, row.case, row.quantity, row.passed) == (0, "small", "residual", True)
    assert {case: done.key for case, done in store.finished().items()} == {"small": row.key}
    assert {case: planned.key for case, planned in store.plan().items()} == {"small": row.key}
    assert store.environment().versions["numpy"] == np.__version__
    assert store.environment().sources == dependencies.everything()
    assert store.sources("small") == dependencies.of_cases(load_cases())["small"]
    assert store.plan()["small"].about == load_case(study.case_file).about


def test_a_failed_check_gives_exit_code_1_and_is_named(study, capsys):
    text = CASE.replace("tolerance = 1e-40", 'tolerance = 1.0\nbound = "at least"')
    study.case_file.write_text(text, encoding="utf-8")
    code, store = study()
    assert (code, store.rows()[0].passed) == (1, False)
    printed = [text for text in capsys.readouterr().out.splitlines() if "small: residual " in text]
    assert all(text.startswith("FAILED") for text in printed)
    reviewed("validation: failed check", printed[-1])


def test_a_rerun_skips_stored_cases_unless_forced(study, watched):
    runs = []
    watched(runs.append)
    study()
    study()
    assert len(runs) == 1
    study("--force")
    assert len(runs) == 2


def test_an_interrupted_rerun_leaves_the_case_unfinished(study, watched):
    assert study()[1].finished()
    watched(dies)
    code, store = study("--force")
    assert code == 130
    assert not store.finished()  # so the report shows INCOMPLETE


def test_a_case_is_measured_again_if_what_it_depends_on_changes_and_the_file_is_named(study, monkeypatch, capsys):
    first = study()[1].finished()["small"]
    capsys.readouterr()
    honest = dependencies.digests
    monkeypatch.setattr(dependencies, "digests", lambda: honest() | {"flexlink/identification/fit.py": "other"})
    assert study()[1].finished()["small"] == first  # the case does not import it
    used = "validation/kinds/order_conditions.py"
    monkeypatch.setattr(dependencies, "digests", lambda: honest() | {used: "other"})
    assert study()[1].finished()["small"].key != first.key
    again = line(capsys.readouterr().out, "small: ")
    assert used in again
    reviewed("validation: again", again)


def test_results_with_another_version_are_measured_again_except_in_the_full_study(study, monkeypatch, capsys):
    honest = runner.versions
    first = study()[1].finished()["small"]
    capsys.readouterr()
    monkeypatch.setattr(runner, "versions", lambda packages: honest(packages) | {"flexlink": "9", "numpy": "9.9"})
    monkeypatch.setattr(runner, "_date", lambda: first.date + datetime.timedelta(hours=1))
    assert study("--full")[1].finished()["small"] == first
    assert study()[1].finished()["small"].versions["numpy"] == "9.9"
    reviewed("validation: again", line(capsys.readouterr().out, "small: "), values=False)


def test_a_case_that_crashes_is_named_with_its_place_and_the_others_run(study, watched, capsys):
    study.case_file.with_name("z_last.toml").write_text(CASE, encoding="utf-8")

    def crashes(name):
        if name == "small":
            raise ZeroDivisionError("by nothing,\nat all")

    watched(crashes)
    code, store = study()
    assert (code, set(store.finished()), set(store.failed())) == (2, {"z_last"}, {"small"})
    error = capsys.readouterr().err
    assert Path(__file__).name in error and error.count("\n") == 1
    reviewed("validation: crash", error, values=False)


def test_a_case_during_which_the_study_ended_runs_last(study, watched):
    study.case_file.with_name("z_last.toml").write_text(CASE, encoding="utf-8")
    ran = []
    watched(lambda name: (ran.append(name), dies(name)))
    for _ in range(2):
        assert study()[0] == 130
    assert ran == ["small", "z_last", "small"]
    (missing,) = Results.read(study()[1].path).missing
    assert (missing.case, missing.why) == ("small", STOPPED)


def test_if_a_process_of_the_pool_ends_no_other_case_is_lost(study, monkeypatch, capsys):
    pools = []

    class Pool(futures.ThreadPoolExecutor):  # processes would not know the cases of this test
        def __init__(self, processes=2):
            super().__init__(processes)
            pools.append(processes)

        def submit(self, function, case, *rest):
            if len(pools) > 1 and case.name != "small":
                return super().submit(function, case, *rest)
            broken = futures.Future()
            broken.set_exception(BrokenProcessPool())
            return broken

    monkeypatch.setattr(runner, "_pool", Pool)
    for name in ("b", "c", "d"):
        study.case_file.with_name(f"{name}.toml").write_text(CASE, encoding="utf-8")
    code, store = study()
    assert (code, set(store.finished()), set(store.failed())) == (2, {"b", "c", "d"}, {"small"})
    assert pools == [2, 1, 1, 1, 1]
    reviewed("validation: ended its process", line(capsys.readouterr().err, "small: "))


def test_every_module_that_the_study_imports_counts_as_its_source() -> None:
    counted = {path.relative_to(ROOT).as_posix() for path in sources.sources()}
    shown = {path for path in counted if path.startswith(("flexlink/results/pictures/", "flexlink/scene_report/"))}
    without_effect = {name.removesuffix(".py") for name in sources.WITHOUT_EFFECT}
    imported = {
        module.replace(".", "/")
        for path in sources.sources()
        if path.suffix == ".py" and "validation" in path.parts
        for module in re.findall(r"(?m)^\s*(?:from|import) (flexlink[\w.]*)", path.read_text(encoding="utf-8"))
    }
    assert len(imported) > 50
    assert {
        module for module in imported - without_effect if not {f"{module}.py", f"{module}/__init__.py"} & counted
    } == set()
    assert shown <= {f"{module}.py" for module in imported}
    assert Path("flexlink", "cli", "simulate.py").as_posix() in counted  # a case measures the time of this command


def test_a_killed_study_loses_only_the_current_case(study, watched):
    study.case_file.with_name("a_first.toml").write_text(CASE, encoding="utf-8")
    watched(after=dies)
    code, store = study()
    assert code == 130
    assert set(store.finished()) == {"a_first"}
    first = [row for row in store.rows() if row.case == "a_first"]
    watched()
    code, store = study()
    assert code == 0
    assert [row for row in store.rows() if row.case == "a_first"] == first  # not measured again
    assert [row.case for row in store.rows()] == ["a_first", "small"]  # no duplicate rows


@pytest.mark.parametrize(("change", "options", "part", "id"), [
    (('"order_conditions"', '"orders"'), (), "kind = 'orders'", "unknown-name"),
    (('["RK2"]', '["RK7"]'), (), "method = 'RK7'", "unknown-name"),
    (("settings.methods", "settings.method"), (), "settings.method = ['RK2']", "unknown-key"),
    (("settings", 'parts = "method"\nsettings'), (), "parts = 'method'", "validation: parts"),
    (("quantity.residual", "quantity.residue"), (), "quantity.residue", "unknown-quantity"),
    (("", ""), ("nothing*",), "case = 'nothing*'", "unknown-name"),
    (("", ""), ("--full", "small"), "--full small", "validation: --full with cases"),
])  # fmt: skip
def test_a_study_that_cannot_run_is_refused_in_one_line(study, capsys, change, options, part, id):
    study.case_file.write_text(CASE.replace(*change), encoding="utf-8")
    assert study(*options)[0] == 2
    error = capsys.readouterr().err
    assert f"{part}: " in error and error.count("\n") == 1
    reviewed(id, error)


def test_the_reason_for_a_missing_case_is_stored_until_it_runs(study):
    study.case_file.write_text(CASE.replace('["RK2"]', '["RK7"]'), encoding="utf-8")
    store = study()[1]
    (missing,) = Results.read(store.path).missing
    assert "method = 'RK7': " in missing.why
    reviewed("validation: case that cannot run", missing.why)
    study.case_file.write_text(CASE, encoding="utf-8")
    assert study()[1].failed() == {}
    assert Results.read(store.path).missing == ()


def test_a_full_study_runs_all_missing_cases_also_those_run_by_name(study):
    study.case_file.with_name("small_long.toml").write_text("by_name = true\n" + CASE, encoding="utf-8")
    before = study()[1].finished()
    code, store = study("--full")
    assert code == 0
    assert set(store.plan()) == set(store.finished()) == {"small", "small_long"}
    assert store.finished()["small"] == before["small"]


def test_a_case_that_cannot_run_is_named_and_the_others_run(study, capsys):
    study.case_file.with_name("a_bad.toml").write_text(CASE.replace('["RK2"]', '["RK7"]'), encoding="utf-8")
    code, store = study()
    assert (code, set(store.finished())) == (2, {"small"})
    assert set(store.plan()) == {"a_bad", "small"}  # so a report shows what is missing
    assert capsys.readouterr().err.startswith("validation: a_bad: ")


@pytest.mark.slow
def test_in_parallel_a_case_that_cannot_run_does_not_stop_the_others(study, monkeypatch):
    monkeypatch.setattr(runner, "_pool", lambda *_: futures.ThreadPoolExecutor(2))  # in processes, cases differ
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
def test_a_case_is_selected_by_name_kind_first_words_or_glob(study, words, meant):
    study.case_file.with_name("other_thing.toml").write_text(CASE, encoding="utf-8")
    code, store = study(*words)
    assert code == 0
    assert {row.case for row in store.rows()} == meant


def test_a_case_run_by_name_joins_the_study_once_it_has_run(study):
    study.case_file.with_name("small_long.toml").write_text("by_name = true\n" + CASE, encoding="utf-8")
    assert {row.case for row in study("small")[1].rows()} == {"small"}
    assert set(study()[1].plan()) == {"small"}
    assert {row.case for row in study("small_long")[1].rows()} == {"small", "small_long"}
    assert set(study()[1].plan()) == {"small", "small_long"}


def test_a_case_of_a_stopped_full_study_stays_planned_while_others_are_run_by_name(study):
    bad = CASE.replace('["RK2"]', '["RK7"]')
    study.case_file.with_name("small_long.toml").write_text("by_name = true\n" + bad, encoding="utf-8")
    assert study("--full")[0] == 2
    _, store = study("small")
    assert (set(store.plan()), set(store.finished())) == ({"small", "small_long"}, {"small"})


def test_each_part_of_a_case_is_stored_with_the_common_limits_and_its_own(study, monkeypatch):
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
    assert study("small-RK2")[0] == 0  # a quantity named after one part does not concern another
    assert study("small-RK4")[0] == 2  # but the part with this name must measure it


def test_the_full_study_runs_all_timed_kinds_and_the_short_one_those_with_limits(study, monkeypatch):
    given = []

    def nothing(cases, keys, report, alone):
        given.append(alone)
        return iter(())

    monkeypatch.setattr(runner, "_in_order_of_completion", nothing)
    study()
    study("--full")
    assert given == [runner.TIMED - runner.BESIDE, runner.TIMED]
    assert {"integrators"} <= runner.BESIDE <= runner.TIMED


def test_a_time_measured_while_other_cases_run_has_no_limit():
    limited = {
        case.kind
        for case in load_cases("*")
        for each in case.quantity.values()
        if each.tolerance and each.unit in {"s", "ms", "µs"}
    }
    assert not runner.BESIDE & limited


def test_timed_cases_run_last_and_alone(monkeypatch):
    monkeypatch.setattr(runner, "measure", lambda case, key: iter([]))
    monkeypatch.setattr(runner, "WORTH_A_POOL", 1000)
    cases = load_cases()
    ran = runner._in_order_of_completion(cases, {case.name: "" for case in cases}, lambda name, row: None, runner.TIMED)
    timed = [case.kind in runner.TIMED for case, _ in ran]
    assert timed == sorted(timed)
    assert {"integrators", "speed", "speed_calls"} <= {case.kind for case in cases if case.kind in runner.TIMED}


def test_a_deleted_case_leaves_the_store(study):
    study.case_file.with_name("gone.toml").write_text(CASE, encoding="utf-8")
    study()
    study.case_file.with_name("gone.toml").unlink()
    assert {row.case for row in study()[1].rows()} == {"small"}


def test_rows_read_back_exactly_and_a_truncated_last_line_is_dropped(tmp_path):
    store = Store(tmp_path)
    store.prepare(["terms"])
    rows = [row(value=1 / 3), row(value=None, tolerance=1e-13)]
    for each in rows:
        store.append(each)
    assert store.rows() == rows
    with (tmp_path / "rows.jsonl").open("a", encoding="utf-8") as file:
        file.write('{"case": "c", "ki')
    assert store.rows() == rows


def test_an_invalid_row_is_named_by_its_line(study, capsys):
    _, store = study()
    (store.path / "rows.jsonl").write_text('{"case": "small"}\n', encoding="utf-8")
    assert study()[0] == 2
    error = capsys.readouterr().err
    assert "rows.jsonl" in error and " 1: " in error
    reviewed("file-content", error.splitlines()[0])


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
def test_a_truncated_file_of_the_store_is_named_in_one_line(tmp_path, name, torn):
    store = stored_everything(tmp_path)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: int(torn * len(whole))])
    with refused(FlexlinkError, "cannot-read") as error:
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


def test_varied_settings_are_described_in_words():
    facts = {"method": "RK4", "step": 1e-4, "hinges": 10, "n": 4, "steps": 10_000}
    reviewed("validation: settings in words", in_words(facts))
    assert in_words({"method": "RK4", "hinges": 10}) == "RK4, 10 hinges"
    assert (column_head("step"), column_head("new fact")) == ("step [s]", "new fact")
    assert in_words({"new fact": 3}) == "new fact 3"


QUIET, BUSY = Conditions(0.05, 0.1, cores=2), Conditions(1.9, 0.1, cores=2)


@pytest.fixture
def timed(study, monkeypatch):
    """The study's case with a limit on its time; the function that runs it takes the machine's conditions."""
    honest = KIND.run

    def run(case, **settings):
        yield from honest(case, **settings)
        yield Measured("time", 2.0, timed=True)

    monkeypatch.setattr(KIND, "run", run)
    monkeypatch.setattr(runner, "TIMED", {"order_conditions"})
    study.limit = 1.0

    def measure(conditions, *options):
        time = f"\n[quantity.time]\nmetric = 'm'\nunit = 's'\ntolerance = {study.limit}\nreason = 'a reason'\n"
        study.case_file.write_text(CASE + time, encoding="utf-8")
        watch = type("LoadMonitor", (), {"conditions": lambda self: conditions})
        monkeypatch.setattr(runner, "LoadMonitor", watch)
        return study(*options)

    return measure


def test_a_missed_time_limit_changes_neither_exit_code_nor_correctness(timed, capsys):
    code, store = timed(QUIET)
    shown = capsys.readouterr().out
    assert code == 0
    assert [row.passed for row in store.rows()] == [True, False]
    reviewed("validation: correctness", line(shown, "correctness:"))
    reviewed("validation: speed", line(shown, "speed:"))
    assert "small: time" in line(shown, "missed ", " = 2.0 s")
    assert "FAILED" not in shown


def test_on_a_busy_machine_a_time_limit_is_neither_met_nor_missed(timed, study, capsys):
    for study.limit in (1.0, 3.0):
        assert timed(BUSY)[0] == 0
        shown = capsys.readouterr().out
        assert re.findall(r"\d+", line(shown, "correctness:")) == ["1", "1"]
        assert "1.9 of 2" in line(shown, "speed:")
        reviewed("validation: speed", line(shown, "speed:"))
        assert "missed" not in shown


def test_a_failed_check_fails_the_study_although_time_limits_are_met(timed, study, monkeypatch):
    study.limit = 3.0
    monkeypatch.setitem(globals(), "CASE", CASE.replace("1e-40", '1.0\nbound = "at least"'))
    assert timed(QUIET)[0] == 1


def test_only_cases_timed_on_a_busy_machine_are_timed_again(timed):
    first = timed(BUSY)[1].finished()["small"]
    second = timed(QUIET)[1].finished()["small"]
    assert (first.busy, second.busy) == (True, False)
    assert timed(BUSY)[1].finished()["small"] == second


def test_a_full_study_times_again_only_what_was_timed_on_a_busy_machine(timed, capsys):
    timed(BUSY, "--full")
    reviewed("validation: quiet", line(capsys.readouterr().out, "Cases timed"))
    first = timed(QUIET, "--full")[1].finished()["small"]
    shown = capsys.readouterr().out
    reviewed("validation: again", next(text for text in shown.splitlines() if text.startswith("small: ")))
    reviewed("validation: passes", line(shown, "untimed"), values=False)
    reviewed("validation: quiet", line(shown, "Cases timed"))
    assert not first.busy
    assert timed(BUSY, "--full")[1].finished()["small"] == first


def test_the_first_pass_of_a_full_study_leaves_timed_cases_out(timed, study, monkeypatch):
    written = []
    monkeypatch.setattr("validation.__main__._report", lambda path, full: written.append(full))
    study.case_file.with_name("other.toml").write_text(CASE.replace("order_conditions", "identities"), encoding="utf-8")
    assert main(["--full", "--untimed", "--results", str(study.case_file.parent / "r"), "--no-report"]) in {0, 2}
    assert set(Store(study.case_file.parent / "r").failed()) == {"other"}  # which lacks its settings
    main(["--full", "--untimed", "--results", str(study.case_file.parent / "r")])
    assert written == [False]


@pytest.mark.parametrize(("conditions", "busy"), [
    (Conditions(0.0, 0.2, 2), False), (Conditions(0.19, 0.0, 2), False), (Conditions(0.21, 0.0, 2), True),
    (Conditions(0.21, 0.0, 8), False), (Conditions(None, 0.29, 2), False), (Conditions(None, 0.31, 2), True),
])  # fmt: skip
def test_a_machine_is_busy_if_others_use_it_or_a_loop_runs_unevenly(conditions, busy):
    assert conditions.busy is busy


def test_the_load_monitor_counts_only_other_processes(monkeypatch):
    readings = machine.ClockReading(10.0, 100.0, 50.0), machine.ClockReading(20.0, 125.0, 60.0)
    clocks = iter(readings)  # 25 core seconds, 10 of them used by this process
    monkeypatch.setattr(machine, "_read", lambda: next(clocks))
    monkeypatch.setattr(machine, "_laps", lambda: [1.0, 1.0, 1.0, 3.0])
    found = machine.LoadMonitor().conditions()
    assert (found.load, found.spread) == (1.5, 0.5)


WORKING = """import time
while time.process_time() < 0.3: pass
print(flush=True)
input()"""


@pytest.mark.skipif(not machine.PROC_STAT.exists(), reason="needs Linux's counters of processes")
def test_running_processes_that_a_case_has_started_are_its_own():
    """An engine runs in a separate process, which another one may have started."""
    started = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {WORKING!r}])"
    before = machine._seconds_of_running_children()
    with subprocess.Popen([sys.executable, "-c", started], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        during = machine._seconds_of_running_children()
        child.communicate(b"\n")
    assert during - before > 0.25
    assert machine._seconds_of_running_children() < during - 0.25


def test_without_a_load_count_only_the_loop_decides(monkeypatch):
    monkeypatch.setattr(machine, "PROC_STAT", Path("/nowhere/stat"))
    assert machine.LoadMonitor().conditions().load is None


def test_every_file_in_kinds_defines_a_kind_and_is_found_by_its_name():
    files = {path.stem for path in (ROOT / "validation" / "kinds").glob("*.py")} - {"__init__"}
    assert {kind.run.__module__.rpartition(".")[2] for kind in KINDS.values()} == files
    assert {name for name, kind in KINDS.items() if cases.module_of(name) != kind.run.__module__} == set()


def test_a_study_without_a_checkout_is_refused(study, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("validation.__main__.MODELS", tmp_path / "site-packages" / "models")
    assert study()[0] == 2
    error = capsys.readouterr().err
    assert "models: " in error
    reviewed("validation: no checkout", error)
    assert error.count("\n") == 1


def test_a_study_prints_its_verdict_even_if_the_report_cannot_be_written(tmp_path, study, capsys, monkeypatch):
    def fails(*_):
        raise OutputError("disk full")

    monkeypatch.setattr("validation.__main__._report", fails)
    assert main(["--results", str(tmp_path / "results")]) == 2
    shown = capsys.readouterr()
    assert re.findall(r"\d+", line(shown.out, "correctness:")) == ["1", "1"]
    assert shown.err == f"validation: {OutputError('disk full')}\n"


def test_a_case_has_no_series_of_a_case_whose_name_begins_with_its_own(tmp_path):
    store, both = Store(tmp_path), ("arm", "arm_two")
    store.prepare(both)
    for case in both:
        store.add_series(case, Series("sweep", case, {"x": np.ones(1)}, "x", "x", "y"))
    assert [store.series(case)["sweep"].title for case in both] == [*both]
    store.forget("arm")
    assert [len(store.series(case)) for case in both] == [0, 1]


@pytest.mark.slow
def test_the_store_does_not_import_engines_or_rich():
    code = "import sys, validation.store; print([m for m in ('pinocchio', 'mujoco', 'rich') if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert shown.stdout.strip() == "[]"


ROWS = CASE.replace('["RK2"]', '["RK2", "RK4"]')


@pytest.mark.parametrize(("stated", "limit"), [
    ("rows = 2", None), ('rows = "by machine"', None), ("", ("at most", 1.0)), ("rows = 3", ("at least", 3.0)),
])  # fmt: skip
def test_a_wrong_number_of_measurements_fails(study, capsys, stated, limit):
    study.case_file.write_text(ROWS + stated, encoding="utf-8")
    code, store = study()
    assert code == bool(limit)
    shown = capsys.readouterr().out
    failed = [row for row in store.rows() if row.passed is False]
    assert [(row.quantity, row.value, row.bound, row.tolerance) for row in failed] == (
        [(f"rows of {'residual'}", 2.0, *limit)] if limit else []
    )
    for one in failed:
        assert f"FAILED small: {one.quantity} () = 2.0 " in shown
        reviewed("validation: number of measurements", one.note)
    assert re.findall(r"\d+", line(shown, "correctness:")) == (["2", "3"] if limit else ["2", "2"])


def test_a_number_measured_twice_fails_and_is_named(study, capsys):
    study.case_file.write_text(ROWS.replace('"RK4"', '"RK2"') + "rows = 2", encoding="utf-8")
    code, store = study()
    (row,) = (row for row in store.rows() if row.passed is False)
    assert (code, row.quantity.split()[-1]) == (1, "residual")
    assert "RK2" in row.note
    reviewed("validation: measured twice", row.note)
