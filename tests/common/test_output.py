"""Files of results are complete or absent, with the permissions and in the location that the user chose."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

import pytest

import flexlink as fl
from flexlink.common.output import write_or_keep, write_text, write_whole
from tests.support.words import refused


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
