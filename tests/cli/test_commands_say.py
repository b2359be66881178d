"""Edge cases of commands: no screen, an unknown file format, a narrow terminal, an unloaded arm."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

import flexlink as fl
from flexlink.cli import advise, simulate
from flexlink.cli.main import main
from flexlink.cli.show import has_screen
from flexlink.common.progress import progress_text
from tests.conftest import ROOT, make_scene
from tests.support.words import refused_line

THREE_LINKS = str(ROOT / "models" / "three_links.toml")


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_x11_and_wayland_displays_both_count_as_a_screen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for each in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(each, raising=False)
    assert not has_screen()
    monkeypatch.setenv(name, ":0")
    assert has_screen()


def test_an_unknown_format_is_refused_before_the_run(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(simulate, "SingleRun", lambda problem: pytest.fail("it was about to run"))
    assert main(["simulate", THREE_LINKS, "--out", "run.txt"]) == 2
    text = refused_line(capsys.readouterr().err, "unknown-format")
    assert [name for name in ("'run.txt'", ".npz", ".csv") if name not in text] == []


def test_a_progress_bar_has_at_least_four_cells_and_fits_the_terminal() -> None:
    line = progress_text("arm", 0.5, 7.0, 80)
    bare = len(line) - 30
    assert line == f"arm [{'█' * 15}{'·' * 15}]  50% 0:07, 0:07 left"
    assert progress_text("arm", 0.5, 7.0, bare + 4) == "arm [██··]  50% 0:07, 0:07 left"
    assert progress_text("arm", 0.5, 7.0, bare + 3) == "arm  50% 0:07, 0:07 left"
    for width in range(1, 90):
        line = progress_text("an arm of a long name", 0.31, 3671.0, width, 0.1, "12 members/s")
        assert len(line) <= width


def test_info_does_not_compare_costs_of_methods_if_every_step_is_stable(tmp_path, capsys) -> None:
    rod = fl.Link(name="rod", length=1.0, material="aluminium", section="square")
    path = make_scene(rod, gravity=(0.0, 0.0, 0.0)).save(tmp_path / "rod.toml")
    assert main(["info", str(path)]) == 0
    rk4, others = [], []
    for line in capsys.readouterr().out.splitlines():
        (rk4 if line.split()[:1] == ["RK4"] else others).append(line)
    assert len(rk4) == 1
    assert not [line for line in others if "RK4" in line]


@pytest.mark.parametrize(("met", "code"), [(True, 0), (False, 1)])
def test_advice_that_misses_its_goal_has_exit_code_1(
    met: bool, code: int, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(advise, "advise", lambda *_, **__: SimpleNamespace(met=met))
    assert main(["advise", THREE_LINKS, "--tip", "1e-3"]) == code
    assert f"met={met}" in capsys.readouterr().out
