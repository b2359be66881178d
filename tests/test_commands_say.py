"""What commands say and refuse at their edges: a screen, a file's ending, a narrow terminal, an arm that is free."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from conftest import ROOT, make_scene

import flexlink as fl
from flexlink.cli import advise, simulate
from flexlink.cli.main import main
from flexlink.cli.show import has_screen
from flexlink.common.progress import progress_text


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_either_kind_of_display_is_a_screen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for each in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(each, raising=False)
    assert not has_screen()
    monkeypatch.setenv(name, ":0")
    assert has_screen()


def test_a_format_that_no_file_has_is_refused_before_the_run(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(simulate, "SingleRun", lambda problem: pytest.fail("it was about to run"))
    assert main(["simulate", str(ROOT / "models" / "three_links.toml"), "--out", "run.txt"]) == 2
    assert "'run.txt': unknown format; a trajectory is saved as .npz or .csv" in capsys.readouterr().err


def test_a_bar_of_four_cells_is_the_shortest_and_no_line_is_wider_than_the_terminal() -> None:
    line = progress_text("arm", 0.5, 7.0, 80)
    bare = len(line) - 30
    assert line == f"arm [{'█' * 15}{'·' * 15}]  50% 0:07, 0:07 left"
    assert progress_text("arm", 0.5, 7.0, bare + 4) == "arm [██··]  50% 0:07, 0:07 left"
    assert progress_text("arm", 0.5, 7.0, bare + 3) == "arm  50% 0:07, 0:07 left"
    for width in range(1, 90):
        assert len(progress_text("an arm of a long name", 0.31, 3671.0, width, 0.1, "12 members/s")) <= width


def test_info_of_an_arm_without_a_fastest_motion_compares_no_method_with_another(tmp_path, capsys) -> None:
    rod = fl.Link(name="rod", length=1.0, material="aluminium", section="square")
    path = make_scene(rod, gravity=(0.0, 0.0, 0.0)).save(tmp_path / "rod.toml")
    assert main(["info", str(path)]) == 0
    told = capsys.readouterr().out
    assert "as cheap as RK4" not in told
    assert "RK4" in told


@pytest.mark.parametrize(("met", "code"), [(True, 0), (False, 1)])
def test_advice_that_is_not_met_is_exit_code_1(met: bool, code: int, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(advise, "advise", lambda *_, **__: SimpleNamespace(met=met))
    assert main(["advise", str(ROOT / "models" / "three_links.toml"), "--tip", "1e-3"]) == code
    assert f"met={met}" in capsys.readouterr().out
