"""The command line: results on success, one line and exit code 2 on errors, and no result ever lost."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import time
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

import flexlink as fl
from flexlink.cli import simulate
from flexlink.cli.main import build_parser, main
from flexlink.cli.terminal import announced
from flexlink.motion import single_run as single
from flexlink.scene_report.parts import vibration
from flexlink.scene_report.study import Study


@pytest.fixture
def paper(models: Path) -> str:
    return str(models / "paper_fig5.toml")


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("compiling")]
    assert all(line.startswith("  also: ") for line in lines[1:])
    assert lines[0].startswith("flexlink: ")
    return lines[0]


def test_info_names_every_coordinate_and_the_stable_steps(paper: str, capsys) -> None:
    assert main(["info", paper]) == 0
    out = capsys.readouterr().out
    assert "10 degrees of freedom, 2 driven" in out
    assert "upper.1.z" in out
    assert "  RK4    at most 0.000491 s, " in out
    assert " s of CPU time for one second of motion\n" in out
    assert "stiffness ratio 13.3: fastest eigenvalue 5760 1/s, slowest elastic mode 431.6 rad/s with free joints" in out
    assert "  Radau5 no limit, as cheap as RK4 with about " in out


@pytest.mark.slow
def test_info_tells_limits_and_gears(paper: str, capsys) -> None:
    gear = "link.upper.joint={limits_deg=[-90, 45.5], armature=0.1, gear_stiffness=3e4}"
    assert main(["info", paper, "--set", gear]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "driven, -90° … 45.5°" in lines[2]
    assert lines[3].split() == ["1", "upper.gear", "k", "=", "30000", "N", "m/rad"]


def test_simulate_writes_samples_and_a_picture(paper: str, tmp_path: Path, capsys) -> None:
    out, picture = tmp_path / "run.npz", tmp_path / "run.png"
    assert main(["simulate", paper, "--duration", "0.1", "--out", str(out), "--plot", str(picture)]) == 0
    assert np.load(out)["q"].shape == (21, 10)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "real time" in capsys.readouterr().out


def test_a_bad_scene_prints_one_line_exits_2_and_writes_nothing(paper: str, tmp_path: Path, capsys) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(Path(paper).read_text(encoding="utf-8").replace("segments = 5", "segments = 1"), encoding="utf-8")
    for command in (["simulate", str(bad), "--out", str(tmp_path / "run.csv")], ["info", str(bad)],
                    ["export", paper, str(bad), "--out", str(tmp_path)]):  # fmt: skip
        assert main(command) == 2
        assert "link.upper.segments = 1" in error_line(capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def test_a_diverging_run_keeps_its_samples_and_exits_2(paper: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "run.npz"
    assert main(["simulate", paper, "--step", "1e-3", "--sample", "1e-3", "--insist", "--out", str(out)]) == 2
    *warned, line = capsys.readouterr().err.splitlines()
    assert f"samples kept in {out}" in line
    assert all(warning.startswith("warning: ") for warning in warned)
    kept = np.load(out)
    assert len(kept["t"]) >= 2
    assert "run.step = 0.001 s" in kept["warnings"][0]


def test_a_step_that_is_too_large_is_refused_in_one_line(paper: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "run.npz"
    assert main(["simulate", paper, "--step", "1e-3", "--out", str(out)]) == 2
    assert "the largest stable step of RK4" in error_line(capsys)
    assert not out.exists()


def test_the_summary_tells_the_power_balance_in_one_line(paper: str, capsys) -> None:
    assert main(["simulate", paper, "--duration", "0.1"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("power balance")]
    share = re.search(r"at most (\S+) J, (\S+) of the (\S+) J exchanged", line)
    assert float(share[2]) == pytest.approx(float(share[1]) / float(share[3]), rel=0.1)


def test_a_run_of_no_duration_says_that_it_is_none(paper: str, capsys) -> None:
    assert main(["simulate", paper, "--duration", "0"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first == "paper_fig5: run.duration = 0 s, so the start alone; give a duration, such as --duration 1"


def test_a_missing_output_folder_is_found_before_the_run(paper: str, tmp_path: Path, capsys) -> None:
    assert main(["simulate", paper, "--out", str(tmp_path / "no" / "run.npz")]) == 2
    assert "does not exist" in error_line(capsys)
    assert main(["simulate", paper, "--out", str(tmp_path / "run.xlsx")]) == 2
    assert "saved as .npz or .csv" in error_line(capsys)


def test_a_full_disk_loses_no_result(paper: str, tmp_path: Path, capsys, monkeypatch) -> None:
    real = Path.replace

    def full(self: Path, target: Path) -> Path:
        if Path(target).parent == tmp_path:
            raise OSError(28, "No space left on device")
        return real(self, target)

    monkeypatch.setattr(Path, "replace", full)
    assert main(["simulate", paper, "--duration", "0.05", "--out", str(tmp_path / "run.npz")]) == 2
    line = error_line(capsys)
    kept = Path(line.split("the result is kept in ")[1].split("  [")[0])
    assert "No space left on device" in line
    assert np.load(kept)["q"].shape == (11, 10)
    kept.unlink()


def test_export_writes_every_format(paper: str, tmp_path: Path, capsys) -> None:
    assert main(["export", paper, "--out", str(tmp_path)]) == 0
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == ["paper_fig5.mjcf.xml", "paper_fig5.sdf", "paper_fig5.urdf"]


def test_compare_agrees_and_exits_0(paper: str, capsys) -> None:
    assert main(["compare", paper, "--samples", "5"]) == 0
    assert "pinocchio" in capsys.readouterr().out


def test_an_unknown_engine_is_listed(paper: str, capsys) -> None:
    assert main(["compare", paper, "--engines", "bullet"]) == 2
    assert "'bullet'" in error_line(capsys)


def test_the_version_is_that_of_the_library(capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"flexlink {fl.__version__}\n"


def test_no_run_is_timed_together_with_its_compiler(paper: str, capsys, monkeypatch) -> None:
    """What gets ready stands for one that compiles: it takes long."""
    real = single.SingleRun

    def slowly(*arguments):
        time.sleep(0.5)
        return real(*arguments)

    fl.simulate(fl.load_scene(paper), duration=0.0)
    monkeypatch.setattr(simulate, "SingleRun", slowly)
    assert main(["simulate", paper, "--duration", "0.01"]) == 0
    assert float(re.search(r"simulated in (\S+) s", capsys.readouterr().out)[1]) < 0.5


def test_warnings_are_one_line(capsys) -> None:
    with announced():
        warnings.warn("compiled code\ncannot be kept", RuntimeWarning, stacklevel=1)
    assert capsys.readouterr().err == "flexlink: warning: compiled code cannot be kept\n"


def test_help_has_examples(capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    assert "flexlink simulate models/paper_fig5.toml" in capsys.readouterr().out


@pytest.mark.parametrize(
    "command",
    ["info", "simulate", "advise", "modes", "show", "export", "compare", "report", "import", "robots", "sweep"],
)
def test_help_of_a_command_says_what_it_does_shows_examples_and_takes_them(command: str, capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    text, _, examples = capsys.readouterr().out.partition("\nexamples:\n")
    assert text.split("\n\n")[1].strip().endswith((".", ")."))
    assert "--set PATH=VALUE" in text
    for line in examples.splitlines():
        assert line.startswith(f"  flexlink {command} ")
        build_parser().parse_args(shlex.split(line)[1:])


@pytest.mark.slow
def test_the_library_imports_without_engines_or_plotting() -> None:
    code = "import sys, flexlink; print({'pinocchio', 'mujoco', 'matplotlib', 'jinja2', 'rich'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.slow
def test_modes_lists_frequencies_and_draws_shapes(paper: str, tmp_path: Path, capsys) -> None:
    picture = tmp_path / "modes.png"
    assert main(["modes", paper, "--lock", "upper", "fore", "--count", "3", "--plot", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["1", "2", "3"]
    assert float(lines[1].split()[1]) == pytest.approx(6.058, rel=1e-3)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["modes", paper, "--lock", "elbow"]) == 2
    line = error_line(capsys)
    assert "locked = 'elbow': no joint of this chain; allowed are 0 … 9" in line
    assert line.endswith("links: waist, upper, fore")


def frequencies(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line.split()[1] for line in capsys.readouterr().out.splitlines()[1:-1]]


def test_lock_takes_links_joints_and_indices(paper: str, capsys) -> None:
    for lock in (["upper", "fore", "upper.1.z"], ["0", "5", "1"], ["waist", "upper", "fore", "1"]):
        assert main(["modes", paper, "--lock", *lock]) == 0
        found = frequencies(capsys)
        assert len(found) == 7
        assert float(found[0]) > 6.06


def test_the_first_frequency_is_the_same_in_info_modes_and_the_report(paper: str, capsys) -> None:
    line = "first elastic frequency: 6.05804 Hz, at rest with the driven joints locked"
    for command in ("info", "modes"):
        assert main([command, paper]) == 0
        assert line in capsys.readouterr().out.splitlines()
    part = vibration.made(Study(fl.load_scene(Path(paper))))
    assert part is not None
    assert "First elastic frequency: 6.06 Hz" in part.sentences[0]


def test_info_and_modes_tell_pendulum_modes_from_elastic_ones(paper: str, capsys) -> None:
    """Of an arm that hangs, two swings by gravity; at rest in a plane without gravity a joint is held by nothing."""
    assert main(["info", paper]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "pendulum frequencies at the start, joints free [Hz]: 0.381, 0.9975" in lines
    assert main(["modes", paper, "--count", "3"]) == 0
    assert [line.split()[-1] for line in capsys.readouterr().out.splitlines()[1:4]] == [
        "pendulum",
        "pendulum",
        "elastic",
    ]


BOOM = """
name = "boom"
gravity = [0.0, 9.81, 0.0]
initial.joint_deg = [0.0]
material.steel = { young = 210e9, density = 7850.0 }
section.pipe = { shape = "tube", outer = 0.06, inner = 0.05 }
link = [{ name = "boom", length = 3.0, flex = "yz", segments = 9, material = "steel", section = "pipe"DAMPING }]
"""


def damped_boom(tmp_path: Path, damping: str) -> str:
    path = tmp_path / "boom.toml"
    path.write_text(BOOM.replace("DAMPING", f", damping = {damping}" if damping else ""), encoding="utf-8")
    return str(path)


def test_info_and_modes_show_the_damping_asked_for_beside_the_damping_there_is(tmp_path: Path, capsys) -> None:
    path = damped_boom(tmp_path, "{ ratio = 0.01, at_hz = 5.0 }")
    for command in (["info", path], ["modes", path, "--lock", "boom"]):
        assert main(command) == 0
        lines = capsys.readouterr().out.splitlines()
        head = lines.index("mode  frequency [Hz]  damping ratio  kind      specified")
        rows = [line.split() for line in lines[head + 1 :] if not line.startswith("first elastic frequency")]
        assert {kind for _, _, _, kind, _ in rows} == {"elastic"}
        rows = [[float(number) for number in (*row[:3], row[4])] for row in rows]
        assert len(rows) == 4 if command[0] == "info" else 8
        for _, hertz, ratio, asked in rows:
            assert asked == pytest.approx(0.01 * hertz / 5.0, rel=1e-3)
            assert ratio == pytest.approx(asked, rel=1e-2)  # gravity stiffens a little, and does not damp
    assert main(["modes", damped_boom(tmp_path, "")]) == 0
    assert "asked" not in capsys.readouterr().out


def test_info_says_what_damping_costs_an_explicit_step(tmp_path: Path, capsys) -> None:
    def steps(damping: str) -> list[float]:
        assert main(["info", damped_boom(tmp_path, damping)]) == 0
        line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("  RK4 "))
        return [float(number) for number in re.findall(r"(\d[\d.e-]*) s\b(?! of CPU)", line)]

    (free,) = steps("")
    damped, without = steps("{ ratio = 0.05, at_hz = 5.0 }")
    assert without == free > 4 * damped


def test_a_mode_that_falls_has_no_frequency_and_no_damping_ratio(paper: str, capsys) -> None:
    assert main(["modes", paper, "--set", "gravity=[0.0, 0.0, -9.81]"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"1 +none: it falls +– +pendulum", out)
    assert "nan" not in out


def test_info_names_links_as_errors_do(paper: str, capsys) -> None:
    assert main(["info", paper]) == 0
    assert not re.search(r"link \d", capsys.readouterr().out)


def test_an_editable_install_is_a_path() -> None:
    """Setuptools' other way, a finder behind all paths, lets scripts beside a clone find its folder, named flexlink, as
    an empty package; with this mapping, and no packages outside of it, it writes a path."""
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    assert setup["package-dir"] == {"": "."}


def test_a_long_comparison_of_runs_says_how_many_steps_it_takes_and_how_to_shorten_it(
    monkeypatch, paper: str, capsys
) -> None:
    monkeypatch.setattr("flexlink.cli.compare.MANY_STEPS", 100)
    command = ["compare", paper, "--trajectory", "--engines", "mujoco", "--duration"]
    assert main([*command, "0.02"]) == 0
    assert (
        "note: 200 steps in each engine, 0.02 s in RK4 steps of 0.0001 s; --duration shortens it"
        in capsys.readouterr().err
    )
    assert main([*command, "0.005"]) == 0
    assert "steps in each engine" not in capsys.readouterr().err
