"""Output on a terminal: a progress line that fits, times, and the notice of a compilation."""

import io
import os
import sys
from types import SimpleNamespace

import pytest

import flexlink as fl
from flexlink.cli.terminal import Compiling
from flexlink.common.progress import Line, Progress, clock, progress_text, rate_text
from tests.conftest import ROOT
from tests.support.words import reviewed


class Terminal(io.StringIO):
    """A stream for stderr that claims to be a terminal."""

    def isatty(self) -> bool:
        return True

    def fileno(self) -> int:
        return 2


def narrow(monkeypatch, columns: int = 40) -> Terminal:
    """A narrow terminal in place of stderr."""
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((columns, 24)))
    return screen


@pytest.mark.parametrize(("columns", "width"), [(0, 79), (1, 1), (40, 39)])
def test_a_terminal_of_unknown_size_has_80_columns(monkeypatch, columns: int, width: int) -> None:
    narrow(monkeypatch, columns)
    assert Line().width == width


@pytest.mark.parametrize("width", [1, 10, 25, 39, 79, 200])
@pytest.mark.parametrize("name", ["a", "a_scene_with_a_name_that_is_longer_than_most_terminals_are_wide"])
def test_the_line_of_a_run_fits_the_terminal(width: int, name: str) -> None:
    for fraction in (0.0, 1e-9, 0.5, 1.0):
        for elapsed in (0.0, 59.9, 36000.0):
            assert len(progress_text(name, fraction, elapsed, width)) <= width


def test_the_line_of_a_run_shows_progress_elapsed_and_remaining_time() -> None:
    assert progress_text("arm", 0.25, 30.0, 60) == "arm [" + "█" * 7 + "·" * 23 + "]  25% 0:30, 1:30 left"
    assert progress_text("arm", 0.25, 30.0, 39) == "arm [███·········]  25% 0:30, 1:30 left"
    assert progress_text("arm", 0.25, 30.0, 31) == "arm [█···]  25% 0:30, 1:30 left"
    assert progress_text("arm", 0.25, 30.0, 30) == "arm  25% 0:30, 1:30 left"
    assert progress_text("arm", 0.0, 0.0, 20).split() == ["arm", "[····]", "0%", "0:00"]
    assert progress_text("arm", 0.25, 30.0, 60, 0.0, "5 m/s").endswith("]  25% 0:30, 1:30 left, 5 m/s")
    assert [rate_text(count, 2.0, "members") for count in (0, 0.5, 3, 20_000)] == [
        "", "0.25 members/s", "1.5 members/s", "10,000 members/s",
    ]  # fmt: skip


def test_times_are_printed_as_clock_times() -> None:
    assert [clock(x) for x in (0.4, 59.6, 754, 3723)] == ["0:00", "1:00", "12:34", "1:02:03"]


def test_progress_stays_in_one_line_of_a_narrow_terminal(monkeypatch) -> None:
    screen = narrow(monkeypatch)
    bar = Progress("a_rather_long_name_of_a_scene", redraw_after=0.0)
    for k in range(11):
        bar(k / 10)
    bar.clear()
    text = screen.getvalue()
    assert "\n" not in text
    lines = text.split("\r")
    assert max(map(len, lines)) < 40
    assert "100%" in text
    assert lines[-2].strip() == lines[-1] == ""


def test_a_terminal_shows_the_time_of_a_compilation(monkeypatch) -> None:
    screen = narrow(monkeypatch)
    notice = Compiling()
    for _ in range(2):
        notice.started()
        shown = screen.getvalue().split("\r")[-1]
        assert shown.rstrip().endswith(" 0:00")
        reviewed("terminal: compilation", shown)
        notice.ended()
        assert screen.getvalue().split("\r")[-1] == ""
    assert "\n" not in screen.getvalue()


def test_times_of_several_compilations_add_up(monkeypatch) -> None:
    screen, clock = narrow(monkeypatch), SimpleNamespace(now=0.0)
    monkeypatch.setattr("flexlink.cli.terminal.time", SimpleNamespace(perf_counter=lambda: clock.now))
    notice, shown = Compiling(), list[str]()
    for _ in range(3):
        notice.started()
        shown.append(screen.getvalue().split("\r")[-1].split()[-1])
        clock.now += 70.0
        notice.ended()
    assert shown == ["0:00", "1:10", "2:20"]


def test_a_line_wider_than_the_terminal_is_cut(monkeypatch) -> None:
    screen = narrow(monkeypatch, 20)
    notice = Compiling()
    notice.started()
    notice.ended()
    assert max(map(len, screen.getvalue().split("\r"))) == 19


def test_without_a_terminal_a_compilation_prints_one_line_and_no_progress(capsys) -> None:
    notice, bar = Compiling(), Progress("arm")
    for _ in range(2):
        notice.started()
        notice.ended()
    bar(0.5)
    bar.clear()
    assert capsys.readouterr().err.splitlines() == [Compiling.TEXT]


def test_a_fit_shows_its_guesses_profiles_and_iterations(monkeypatch) -> None:
    screen = narrow(monkeypatch, 80)
    scene = fl.load_scene(ROOT / "models" / "three_links.toml")
    tapped = fl.fits.FitModes(hertz=(5.5,), deviation=(0.02,))
    young = fl.fits.FitParameter(path="material.aluminium.young")
    bar = Progress("fit", redraw_after=0.0)
    problem = fl.fits.FitProblem(scene=scene, parameter=(young,), modes=(tapped,))
    fl.fit(problem, starts=2, profile=True, progress=bar.report, bar=bar)
    text = screen.getvalue()
    for words in ("guess 1 of 2, iteration 2 [", "guess 2 of 2", "profile 2 of 2, iteration", "75%"):
        assert words in text, words
