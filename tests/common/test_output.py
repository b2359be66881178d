"""Files of results are complete or absent, with the permissions and in the location that the user chose."""

import errno
import os
import re
import sqlite3
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest import mock

import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import OutputError
from flexlink.common.output import make_folder, or_keep, write_or_keep, write_text, write_whole
from tests.conftest import ROOT
from tests.support.words import refused, refused_line, reviewed


@pytest.fixture
def umask():
    """Set the umask for one test."""
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize(("mask", "wanted"), [(0o077, 0o600), (0o022, 0o644), (0o002, 0o664)])
def test_a_new_file_has_the_permissions_of_the_umask(mask: int, wanted: int, umask, tmp_path: Path) -> None:
    umask(mask)
    write_text(tmp_path / "new", "text")
    assert mode(tmp_path / "new") == wanted


def test_a_replaced_file_keeps_its_permissions(tmp_path: Path) -> None:
    target = tmp_path / "private"
    target.write_text("old", encoding="utf-8")
    target.chmod(0o600)
    write_text(target, "new")
    assert mode(target) == 0o600
    assert target.read_text(encoding="utf-8") == "new"


def test_a_symbolic_link_is_kept_and_its_target_written(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    for name in ("there", "later"):
        link = tmp_path / name
        link.symlink_to(Path("far") / name)
    (tmp_path / "far" / "there").write_text("old", encoding="utf-8")
    for name in ("there", "later"):
        write_text(tmp_path / name, "new")
        assert (tmp_path / name).is_symlink()
        assert (tmp_path / "far" / name).read_text(encoding="utf-8") == "new"
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(["far", *["there", "later"] * 2])


def test_a_device_or_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    for name in ("pipe", "link"):
        with refused(fl.errors.OutputError, "cannot-write"):
            write_text(tmp_path / name, "text")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "pipe"]


def test_the_old_file_stays_complete_until_the_new_one_is(tmp_path: Path) -> None:
    target = tmp_path / "result"
    target.write_text("old", encoding="utf-8")

    def half(place: Path) -> None:
        place.write_text("ne", encoding="utf-8")
        assert target.read_text(encoding="utf-8") == "old"
        raise OSError(28, "No space left on device")

    with refused(fl.errors.OutputError, "cannot-write"):
        write_whole(target, half)
    assert target.read_text(encoding="utf-8") == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["result"]


def test_a_result_that_cannot_be_written_to_its_file_is_saved_elsewhere(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with refused(fl.errors.OutputError, "result-kept", values=False):
        write_or_keep(tmp_path / "missing" / "result.txt", lambda place: place.write_text("found", encoding="utf-8"))
    assert [path.read_text(encoding="utf-8") for path in tmp_path.glob("*/result.txt")] == ["found"]


PAPER, TAPPED = str(ROOT / "models/paper_fig5.toml"), str(ROOT / "models/fits/tapped.toml")
PAYLOAD = str(ROOT / "models/sweeps/payload.toml")
COMMANDS = {  # arguments without the destination, the destination, and the function that must not be called
    "simulate": (["simulate", PAPER, "--out"], "run.npz", "simulate.SingleRun"),
    "simulate --plot": (["simulate", PAPER, "--plot"], "run.png", "simulate.SingleRun"),
    "advise": (["advise", PAPER, "--tip", "1e-3", "-o"], "arm.toml", "advise.advise"),
    "modes": (["modes", PAPER, "--plot"], "modes.png", "modes.modes"),
    "show": (["show", PAPER, "-o"], "film.html", "show.simulate"),
    "export": (["export", PAPER, "--out"], "", "export.write_whole"),
    "report": (["report", PAPER, "--out"], "", "report.fl.report"),
    "fit": (["fit", TAPPED, "--out"], "", "fit.fit"),
    "fit --check": (["fit", TAPPED, "--check", "--out"], "", "fit.check_fit"),
    "import": (["import", "arm.urdf", "-o"], "arm.toml", "import_robot.read_robot"),
    "robots": (["robots", "--out"], "", "robots.import_known"),
    "sweep": (["sweep", PAYLOAD, "--out"], "rows.db", "sweep.fill"),
}


@pytest.fixture
def closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which no user can create a file."""
    folder, opened = tmp_path / "closed", os.open
    folder.mkdir()

    def guarded(path: object, flags: int, *mode: int, **where: int) -> int:
        if flags & os.O_CREAT and Path(os.fspath(path)).parent == folder:
            raise PermissionError(13, "Permission denied")
        return opened(path, flags, *mode, **where)

    monkeypatch.setattr(os, "open", guarded)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_closed_folder_is_refused_before_the_work(command: str, closed: Path, monkeypatch, capsys) -> None:
    (*words, option), name, work = COMMANDS[command]

    def never(*_: object, **__: object) -> None:
        pytest.fail(f"{work} was called")

    monkeypatch.setattr(f"flexlink.cli.{work}", never)
    assert main([*words, option, str(closed / name)]) == 2
    error = refused_line(capsys.readouterr().err, "cannot-write")
    assert error.startswith(f"flexlink: {closed}")
    assert os.strerror(errno.EACCES) in error
    assert not list(closed.iterdir())


@pytest.mark.parametrize("command", ["export", "report", "fit", "fit --check"])
def test_a_folder_that_cannot_be_created_is_refused_before_the_work(command, tmp_path, monkeypatch, capsys) -> None:
    words, _, work = COMMANDS[command]
    monkeypatch.setattr(f"flexlink.cli.{work}", lambda *_, **__: pytest.fail(f"{work} was called"))
    (tmp_path / "file").write_text("")
    assert main([*words, str(tmp_path / "file" / "folder")]) == 2
    error = refused_line(capsys.readouterr().err, "cannot-write")
    assert str(tmp_path / "file") in error and os.strerror(errno.ENOTDIR) in error


def test_a_finished_page_that_cannot_be_stored_in_its_folder_is_stored_elsewhere(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "file").write_text("")

    def write(folder: Path) -> Path:
        make_folder(folder)
        write_text(folder / "index.html", "fitted")
        return folder

    with refused(OutputError, "result-kept", values=False) as error:
        or_keep(tmp_path / "file" / "page", write)
    kept = Path(str(error.value).rpartition(" kept in ")[2])
    assert (kept / "index.html").read_text() == "fitted"
    assert or_keep(tmp_path / "page", write) == tmp_path / "page"


def test_a_database_that_cannot_be_opened_is_refused_without_mentioning_rows(tmp_path, monkeypatch, capsys) -> None:
    reason = sqlite3.OperationalError("unable to open database file")
    monkeypatch.setattr(sqlite3, "connect", mock.Mock(side_effect=reason))
    assert main(["sweep", PAYLOAD, "--out", str(tmp_path / "rows.db")]) == 2
    assert refused_line(capsys.readouterr().err, "cannot-write").endswith(str(reason))


@pytest.mark.slow
def test_a_sweep_fails_if_all_its_members_fail(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 1 if every member failed, 0 if one ran."""
    sweep = f'scene = "{PAPER}"\nset = {{ run.duration = 0.01, run.sample = 0.01 }}\ngrid.run.step = STEPS\n'
    sweep += 'quantity.z = { of = "tip z [m]" }\n'
    for steps, code in (("[1e-2]", 1), ("[1e-2, 1e-4]", 0)):
        (tmp_path / "steps.toml").write_text(sweep.replace("STEPS", steps))
        assert main(["sweep", str(tmp_path / "steps.toml"), "--out", str(tmp_path / f"{code}.db")]) == code
        assert "1 of " in capsys.readouterr().err


def test_out_of_memory_is_reported_with_and_without_a_reason(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    lines = []
    for error in (MemoryError(), MemoryError("8 GB")):
        monkeypatch.setattr("flexlink.cli.simulate.SingleRun", mock.Mock(side_effect=error))
        assert main(["simulate", PAPER]) == 2
        lines.append(capsys.readouterr().err.splitlines()[-1])
    bare, with_reason = lines
    assert bare.startswith("flexlink: ") and not bare.endswith(":")
    assert with_reason == f"{bare}: 8 GB"
    reviewed("places: out of memory", bare)


COMMANDS_WITH_TEXT = f"""
import contextlib
from flexlink.cli.main import main
for words in ["--help"], ["info", {PAPER!r}], ["modes", {PAPER!r}, "--count", "1"], ["export", "--help"]:
    with contextlib.suppress(SystemExit):
        main(words)
"""


@pytest.mark.slow
def test_commands_print_the_same_without_docstrings() -> None:
    """`python -OO` removes docstrings; help texts must not depend on them."""
    runs = [
        subprocess.run([sys.executable, *option, "-c", COMMANDS_WITH_TEXT], capture_output=True, text=True, check=True)
        for option in ([], ["-OO"])
    ]
    plain, stripped = (re.sub(r"\S+ s of CPU", "some s of CPU", each.stdout) for each in runs)
    assert plain == stripped
    assert plain.count("usage: ") == 2
