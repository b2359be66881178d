"""Places that results go to: those that take none are told before the work, in one line, and nothing done is lost."""

from __future__ import annotations

import os
import re
import sqlite3
import subprocess
import sys
from pathlib import Path
from unittest import mock

import pytest
from conftest import ROOT

from flexlink.cli.main import main
from flexlink.common.errors import OutputError
from flexlink.common.output import make_folder, or_keep, write_text
from tests.words import refused

PAPER, TAPPED = str(ROOT / "models/paper_fig5.toml"), str(ROOT / "models/fits/tapped.toml")
PAYLOAD = str(ROOT / "models/sweeps/payload.toml")
COMMANDS = {  # the command without its place, the place, and the work that must not have begun
    "simulate": (["simulate", PAPER, "--out"], "run.npz", "simulate.SingleRun"),
    "simulate --plot": (["simulate", PAPER, "--plot"], "run.png", "simulate.SingleRun"),
    "advise": (["advise", PAPER, "--tip", "1e-3", "-o"], "arm.toml", "advise.advise"),
    "modes": (["modes", PAPER, "--plot"], "modes.png", "modes.modes"),
    "show": (["show", PAPER, "-o"], "film.html", "show.simulate"),
    "export": (["export", PAPER, "--out"], "", "export.write_text"),
    "report": (["report", PAPER, "--out"], "", "report.fl.report"),
    "fit": (["fit", TAPPED, "--out"], "", "fit.fit"),
    "fit --check": (["fit", TAPPED, "--check", "--out"], "", "fit.check_fit"),
    "import": (["import", "arm.urdf", "-o"], "arm.toml", "import_robot.read_robot"),
    "robots": (["robots", "--out"], "", "robots.import_known"),
    "sweep": (["sweep", PAYLOAD, "--out"], "rows.db", "sweep.fill"),
}


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which nothing can be made, whoever runs this."""
    folder, opened = tmp_path / "closed", os.open
    folder.mkdir()

    def guarded(path: object, flags: int, *mode: int, **where: int) -> int:
        if flags & os.O_CREAT and Path(os.fspath(path)).parent == folder:
            raise PermissionError(13, "Permission denied")
        return opened(path, flags, *mode, **where)

    monkeypatch.setattr(os, "open", guarded)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_place_that_takes_no_file_is_told_before_the_work(
    command: str, closed: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (*words, option), name, work = COMMANDS[command]

    def never(*_: object, **__: object) -> None:
        pytest.fail(f"{work} was called")

    monkeypatch.setattr(f"flexlink.cli.{work}", never)
    assert main([*words, option, str(closed / name)]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert re.match(rf"flexlink: {re.escape(str(closed))}.*: cannot be written: Permission denied$", line)
    assert not list(closed.iterdir())


@pytest.mark.parametrize("command", ["export", "report", "fit", "fit --check"])
def test_a_folder_that_cannot_be_made_is_told_before_the_work(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words, _, work = COMMANDS[command]
    monkeypatch.setattr(f"flexlink.cli.{work}", lambda *_, **__: pytest.fail(f"{work} was called"))
    (tmp_path / "file").write_text("")
    assert main([*words, str(tmp_path / "file" / "folder")]) == 2
    assert re.search(r"folder: the folder cannot be made: Not a directory$", capsys.readouterr().err.strip())


def test_a_finished_page_that_its_folder_cannot_take_is_kept_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "file").write_text("")

    def write(folder: Path) -> Path:
        make_folder(folder)
        write_text(folder / "index.html", "fitted")
        return folder

    with refused(OutputError, "result-kept") as error:
        or_keep(tmp_path / "file" / "page", write)
    kept = Path(str(error.value).rpartition(" kept in ")[2])
    assert (kept / "index.html").read_text() == "fitted"
    assert or_keep(tmp_path / "page", write) == tmp_path / "page"


def test_a_database_that_cannot_be_opened_promises_no_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise sqlite3.OperationalError("unable to open database file")

    monkeypatch.setattr(sqlite3, "connect", refused)
    assert main(["sweep", PAYLOAD, "--out", str(tmp_path / "rows.db")]) == 2
    assert capsys.readouterr().err.strip().endswith("rows.db: cannot be written: unable to open database file")


@pytest.mark.slow
def test_a_sweep_whose_members_all_fail_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 1: no member ran; 0 where one did."""
    sweep = f'scene = "{PAPER}"\nset = {{ run.duration = 0.01, run.sample = 0.01 }}\ngrid.run.step = STEPS\n'
    sweep += 'quantity.z = { of = "tip z [m]" }\n'
    for steps, code in (("[1e-2]", 1), ("[1e-2, 1e-4]", 0)):
        (tmp_path / "steps.toml").write_text(sweep.replace("STEPS", steps))
        assert main(["sweep", str(tmp_path / "steps.toml"), "--out", str(tmp_path / f"{code}.db")]) == code
        assert "1 of " in capsys.readouterr().err


def test_out_of_memory_has_no_colon_without_a_reason(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    for error, line in ((MemoryError(), "not enough memory"), (MemoryError("8 GB"), "not enough memory: 8 GB")):
        monkeypatch.setattr("flexlink.cli.simulate.SingleRun", mock.Mock(side_effect=error))
        assert main(["simulate", PAPER]) == 2
        assert capsys.readouterr().err.splitlines()[-1] == f"flexlink: {line}"


SAYING = f"""
import contextlib
from flexlink.cli.main import main
for words in ["--help"], ["info", {PAPER!r}], ["modes", {PAPER!r}, "--count", "1"], ["export", "--help"]:
    with contextlib.suppress(SystemExit):
        main(words)
"""


@pytest.mark.slow
def test_commands_say_the_same_without_docstrings() -> None:
    """`python -OO` strips them, and what they say of a command is its help."""
    said = [
        subprocess.run([sys.executable, *option, "-c", SAYING], capture_output=True, text=True, check=True)
        for option in ([], ["-OO"])
    ]
    plain, stripped = (re.sub(r"\S+ s of CPU", "some s of CPU", each.stdout) for each in said)
    assert plain == stripped
    assert plain.count("usage: ") == 2
