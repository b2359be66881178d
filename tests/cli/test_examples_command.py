"""`flexlink examples` lists scripts and scenes, and copies them with the files that they read."""

import re
import shutil
from pathlib import Path

import pytest

from flexlink.cli import examples
from flexlink.cli.main import main
from tests.conftest import ROOT
from tests.support.words import refused_line, reviewed

LQR = ["examples/lqr.py", "models/three_links.toml"]
FIT = ["models/fits/tapped.toml", "models/three_links.toml"]
PAPER = "models/paper_fig5.toml"


def copied(folder: Path, *names: str) -> list[str]:
    """Paths in a folder after a copy."""
    assert main(["examples", *names, "--out", str(folder)]) == 0
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_the_list_names_every_script_and_scene(capsys) -> None:
    assert main(["examples"]) == 0
    words = set(re.findall(r"[\w./]+", capsys.readouterr().out))
    for path in [*ROOT.glob("examples/*.py"), *ROOT.glob("models/**/*.toml")]:
        assert {path.relative_to(ROOT).as_posix(), path.stem} & words, path


def test_every_file_that_a_copied_file_quotes_is_copied(tmp_path: Path) -> None:
    names = {path.name: path for path in (ROOT / "models").glob("*.toml")} | {"reach_arm.urdf": ROOT / "examples"}
    assert copied(tmp_path, "lqr") == LQR
    assert copied(tmp_path / "fit", "models/fits") == FIT
    for text in [path.read_text(encoding="utf-8") for path in ROOT.glob("examples/*.py")]:
        used = {name for name in re.findall(r"[\w.]+\.(?:toml|urdf)", text) if name in names}
        assert used <= {Path(path).name for path in copied(tmp_path, *(used or {"lqr"}))}


def test_files_that_quoted_files_quote_are_copied_as_well(tmp_path: Path) -> None:
    files = {f"{name}.toml": tmp_path / f"{name}.toml" for name in "abc"}
    for path, quoted in zip(files.values(), ('"b.toml"', '"c.toml"', ""), strict=True):
        path.write_text(quoted, encoding="utf-8")
    assert examples._wanted(["a"], files) == [*files]


def test_a_copy_is_equal_and_may_be_repeated(tmp_path: Path, capsys) -> None:
    assert copied(tmp_path, PAPER) == [PAPER]
    assert copied(tmp_path, "paper_fig5") == [PAPER]
    assert (tmp_path / PAPER).read_bytes() == (ROOT / PAPER).read_bytes()
    reviewed("examples: copied", capsys.readouterr().out.splitlines()[-1])


def test_no_other_file_is_replaced(tmp_path: Path, capsys) -> None:
    mine = tmp_path / "models" / "three_links.toml"
    mine.parent.mkdir()
    mine.write_text("mine", encoding="utf-8")
    assert main(["examples", "lqr", "--out", str(tmp_path)]) == 2
    refused_line(capsys.readouterr().err, "file-exists")
    assert mine.read_text(encoding="utf-8") == "mine"
    assert not (tmp_path / "examples").exists()


def test_an_unknown_name_is_refused_with_the_nearest(tmp_path: Path, capsys) -> None:
    assert main(["examples", "lqr", "papr_fig5", "--out", str(tmp_path)]) == 2
    assert "'paper_fig5'" in refused_line(capsys.readouterr().err, "unknown-name")
    assert list(tmp_path.iterdir()) == []


def test_an_installed_package_has_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "site" / "flexlink"
    for path in LQR:
        (package / "bundled" / path).parent.mkdir(parents=True)
        shutil.copy(ROOT / path, package / "bundled" / path)
    monkeypatch.setattr(examples, "__file__", str(package / "cli" / "examples.py"))
    assert list(examples.bundled()) == LQR
    assert copied(tmp_path / "out", "all") == LQR
