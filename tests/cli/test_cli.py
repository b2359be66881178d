"""The command line prints results on success, one line with exit code 2 on errors, and never loses results."""

import json
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli import advise, simulate
from flexlink.cli.main import build_parser, main
from flexlink.cli.show import has_screen
from flexlink.cli.terminal import announced
from flexlink.describe import data_files
from flexlink.describe.schemes.methods import method
from flexlink.formats import FORMATS
from flexlink.identification.systematic import Grid
from flexlink.motion import single_run as single
from flexlink.motion.evaluation_cost import step_cost
from flexlink.scene_report.parts import vibration
from flexlink.scene_report.study import Study
from tests.conftest import ROOT, make_scene
from tests.support.words import line, refused_line, reviewed


@pytest.fixture
def paper(models: Path) -> str:
    return str(models / "paper_fig5.toml")


def test_info_names_every_coordinate_and_the_stable_steps(paper: str, capsys) -> None:
    assert main(["info", paper]) == 0
    out = capsys.readouterr().out
    reviewed("cli: info", out)
    assert re.findall(r"\d[\d.]*", out.splitlines()[1]) == ["10", "2", "10.8"]
    assert "upper.1.z" in out
    assert line(out, " 13.3: ", "5760 1/s", "431.6 rad/s")
    explicit = [name for name in data_files.names("methods") if method(name).explicit]
    assert re.findall(r"(\w+) \d", out.splitlines()[-1]) == explicit
    assert re.search(r"\bRK4 0\.000491\b", out)


@pytest.mark.slow
@pytest.mark.parametrize("steering", ["\x1b[2J", "\x1b]0;mine\a", "\x9b2J", "\u202e", "\rok", "\b"])
def test_no_name_steers_the_terminal(steering: str, paper: str, tmp_path: Path, capsys) -> None:
    """Names are shown with escapes, and as JSON they are the same names."""
    name, scene = f"arm{steering}", tmp_path / "scene.toml"
    fl.load_scene(paper).varied({"name": name, "link.fore.name": name}).save(scene)
    assert [main(["info", str(scene), *more]) for more in ([], ["--set", "link.3.length=-1"])] == [0, 2]
    shown = capsys.readouterr()
    assert steering[0] not in shown.out + shown.err
    assert f"arm\\u{ord(steering[0]):04x}" in shown.out
    assert main(["info", str(scene), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scene"] == name


def test_a_command_runs_without_stdout(paper: str, monkeypatch) -> None:
    """Python has no `sys.stdout` if it is closed, as by >&-."""
    monkeypatch.setattr(sys, "stdout", None)
    assert main(["info", paper]) == 0


def test_info_shows_limits_and_gears(paper: str, capsys) -> None:
    gear = "link.upper.joint={limits_deg=[-90, 45.5], armature=0.1, gear_stiffness=3e4}"
    assert main(["info", paper, "--set", gear]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "-90° … 45.5°" in lines[2]
    reviewed("cli: info, driven joint with limits", lines[2])
    assert lines[3].split() == ["1", "upper.gear", "k", "=", "30000", "N", "m/rad"]


def test_simulate_writes_samples_and_a_picture(paper: str, tmp_path: Path, capsys) -> None:
    out, picture = tmp_path / "run.npz", tmp_path / "run.png"
    assert main(["simulate", paper, "--duration", "0.1", "--out", str(out), "--plot", str(picture)]) == 0
    assert np.load(out)["q"].shape == (21, 10)
    assert picture.read_bytes().startswith(b"\x89PNG")
    reviewed("cli: run", line(capsys.readouterr().out, "paper_fig5: "), values=False)


def test_a_bad_scene_gives_one_line_and_exit_code_2_and_writes_nothing(paper: str, tmp_path: Path, capsys) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text(Path(paper).read_text(encoding="utf-8").replace("segments = 5", "segments = 1"), encoding="utf-8")
    for command in (["simulate", str(bad), "--out", str(tmp_path / "run.csv")], ["info", str(bad)],
                    ["export", paper, str(bad), "--out", str(tmp_path)]):  # fmt: skip
        assert main(command) == 2
        key = refused_line(capsys.readouterr().err, "too-few-segments").partition(" = 1")[0]
        assert key.endswith(".segments")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def test_a_diverging_run_saves_its_samples_and_returns_exit_code_2(paper: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "run.npz"
    assert main(["simulate", paper, "--step", "1e-3", "--sample", "1e-3", "--insist", "--out", str(out)]) == 2
    err = capsys.readouterr().err
    assert str(out) in refused_line(err, "diverged")
    assert all(warning.startswith("warning: ") for warning in err.splitlines()[:-1])
    kept = np.load(out)
    assert len(kept["t"]) >= 2
    assert "run.step = 0.001 s" in kept["warnings"][0]


def test_a_step_that_is_too_large_is_refused_in_one_line(paper: str, tmp_path: Path, capsys) -> None:
    out = tmp_path / "run.npz"
    assert main(["simulate", paper, "--step", "1e-3", "--out", str(out)]) == 2
    refusal = refused_line(capsys.readouterr().err, "unstable-step")
    assert "0.000491 s" in refusal
    assert "RK4" in refusal
    assert not out.exists()


def test_the_summary_shows_the_power_balance_in_one_line(paper: str, capsys) -> None:
    assert main(["simulate", paper, "--duration", "0.1"]) == 0
    printed = capsys.readouterr().out
    reviewed("cli: cost of the steps", line(printed, "steps: "), values=False)
    balance = line(printed, "E − E(0) − W", " J")
    reviewed("cli: power balance", balance, values=False)
    largest, share, exchanged = (float(number) for number in re.findall(r"(?<![(\w])\d[\d.e-]*", balance))
    assert share == pytest.approx(100 * largest / exchanged, rel=0.1)


def test_the_largest_imbalance_is_stated_whatever_its_sign_and_time(paper: str, capsys, monkeypatch) -> None:
    monkeypatch.setattr(fl.Trajectory, "imbalance", np.array([0.0, -3e-6, 1e-6]))
    assert main(["simulate", paper, "--duration", "0", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    balance = line("\n".join(found["lines"]), "E − E(0) − W")
    assert found["imbalance_j"] == 3e-6 and " 3e-06 J" in balance


def test_a_run_without_duration_saves_only_the_initial_state(paper: str, capsys) -> None:
    assert main(["simulate", paper, "--duration", "0"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    reviewed("cli: run without duration", first)
    assert "run.duration = 0 s" in first
    assert "--duration" in first


def test_a_missing_output_folder_is_reported_before_the_run(paper: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(simulate, "SingleRun", lambda problem: pytest.fail("it was about to run"))
    assert main(["simulate", paper, "--out", str(tmp_path / "no" / "run.npz")]) == 2
    refused_line(capsys.readouterr().err, "no-such-folder")
    assert main(["simulate", paper, "--out", str(tmp_path / "run.xlsx")]) == 2
    refusal = refused_line(capsys.readouterr().err, "unknown-format")
    assert [name for name in ("run.xlsx", ".npz", ".csv") if name not in refusal] == []


def test_a_full_disk_does_not_lose_the_results(paper: str, tmp_path: Path, capsys, monkeypatch) -> None:
    real = Path.replace
    full = OSError(28, "No space left on device")

    def on_full_disk(self: Path, target: Path) -> Path:
        if Path(target).parent == tmp_path:
            raise full
        return real(self, target)

    monkeypatch.setattr(Path, "replace", on_full_disk)
    assert main(["simulate", paper, "--duration", "0.05", "--out", str(tmp_path / "run.npz")]) == 2
    text = capsys.readouterr().err
    (kept,) = {Path(name) for name in re.findall(r"/[^\s,;:']+\.npz", text)} - {tmp_path / "run.npz"}
    assert str(full.strerror) in refused_line(text, "result-kept")
    assert np.load(kept)["q"].shape == (11, 10)
    assert kept.parent.stat().st_mode & 0o77 == 0  # no other user can put a link there
    shutil.rmtree(kept.parent)


def test_export_writes_every_format(paper: str, tmp_path: Path, capsys) -> None:
    assert main(["export", paper, "--out", str(tmp_path)]) == 0
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == [f"paper_fig5.{ending}" for ending in ("mjcf.xml", "sdf", "urdf")]
    assert main(["export", paper, "--c", "arm.c", "-o", str(tmp_path / "code")]) == 0
    assert [path.name for path in (tmp_path / "code").iterdir()] == ["arm.c"]


def test_compare_returns_exit_code_0_if_engines_agree(paper: str, capsys) -> None:
    assert main(["compare", paper, "--samples", "5"]) == 0
    assert "pinocchio" in capsys.readouterr().out


def test_an_unknown_engine_is_refused_with_a_list_of_engines(paper: str, capsys) -> None:
    assert main(["compare", paper, "--engines", "bullet"]) == 2
    assert "'bullet'" in refused_line(capsys.readouterr().err, "unknown-name")


def test_the_version_option_prints_the_version_of_the_library(capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"flexlink {fl.__version__}\n"


def test_the_time_of_a_run_excludes_its_compilation(paper: str, capsys, monkeypatch) -> None:
    """A slow constructor imitates the compiler."""
    real = single.SingleRun

    def slowly(*arguments):
        time.sleep(0.5)
        return real(*arguments)

    fl.simulate(fl.load_scene(paper), duration=0.0)
    monkeypatch.setattr(simulate, "SingleRun", slowly)
    assert main(["simulate", paper, "--duration", "0.01"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    duration, cpu = (float(number) for number in re.findall(r"(\d[\d.e-]*) s\b", first))
    assert duration == 0.01
    assert cpu < 0.5


def test_a_warning_is_one_line(capsys) -> None:
    parts = "compiled code", "is not saved"
    with announced():
        warnings.warn("\n".join(parts), RuntimeWarning, stacklevel=1)
    assert capsys.readouterr().err == f"flexlink: warning: {' '.join(parts)}\n"


def test_help_shows_five_valid_examples(capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    examples = [shlex.split(text)[1:] for text in lines if text.startswith("  flexlink ") and ">" not in text]
    assert {words[0] for words in examples} >= {"simulate", "advise", "show", "import", "fit"}
    for words in examples:
        build_parser().parse_args(words)


@pytest.mark.parametrize(
    "command",
    ["info", "simulate", "advise", "modes", "show", "export", "compare", "report", "import", "robots", "sweep"],
)
def test_help_of_a_command_describes_it_and_shows_valid_examples(command: str, capsys) -> None:
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    text, _, examples = capsys.readouterr().out.partition("\nexamples:\n")
    assert text.split("\n\n")[1].strip().endswith((".", ")."))
    assert "--set" in text
    assert "PATH=VALUE" in text
    for example in examples.splitlines():
        assert example.startswith(f"  flexlink {command} ")
        build_parser().parse_args(shlex.split(example)[1:])


def test_choices_of_options_are_all_that_the_library_knows() -> None:
    options = tomllib.loads((ROOT / "flexlink" / "cli" / "options.toml").read_text("utf-8"))
    assert options["export"]["--format"]["choices"] == [*FORMATS]
    assert options["fit"]["--grid"]["choices"] == [*get_args(Grid)]


@pytest.mark.slow
def test_the_library_imports_without_engines_or_plotting() -> None:
    code = "import sys, flexlink; print({'pinocchio', 'mujoco', 'matplotlib', 'jinja2', 'rich'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


@pytest.mark.slow
def test_modes_lists_frequencies_and_draws_mode_shapes(paper: str, tmp_path: Path, capsys) -> None:
    picture = tmp_path / "modes.png"
    assert main(["modes", paper, "--lock", "upper", "fore", "--count", "3", "--plot", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["1", "2", "3"]
    assert float(lines[1].split()[1]) == pytest.approx(6.058, rel=1e-3)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["modes", paper, "--lock", "elbow"]) == 2
    refusal = refused_line(capsys.readouterr().err, "unknown-joint")
    assert "locked = 'elbow'" in refusal
    assert "0 … 9" in refusal
    assert refusal.endswith(", ".join(["waist", "upper", "fore"]))


def frequencies(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line.split()[1] for line in capsys.readouterr().out.splitlines()[1:-1]]


def test_the_lock_option_accepts_links_joints_and_indices(paper: str, capsys) -> None:
    for lock in (["upper", "fore", "upper.1.z"], ["0", "5", "1"], ["waist", "upper", "fore", "1"]):
        assert main(["modes", paper, "--lock", *lock]) == 0
        found = frequencies(capsys)
        assert len(found) == 7
        assert float(found[0]) > 6.06


def test_the_first_frequency_is_the_same_in_info_modes_and_the_report(paper: str, capsys) -> None:
    shown = set()
    for command in ("info", "modes"):
        assert main([command, paper]) == 0
        shown.add(line(capsys.readouterr().out, "6.05804 Hz"))
    (text,) = shown
    reviewed("cli: first elastic frequency", text)
    part = vibration.made(Study(fl.load_scene(Path(paper))))
    assert part is not None
    assert "6.06 Hz" in part.sentences[0]
    reviewed("report: first elastic frequency", part.sentences[0])


def test_info_and_modes_distinguish_pendulum_modes_from_elastic_ones(paper: str, capsys) -> None:
    """A hanging arm of two driven joints has two pendulum modes."""
    assert main(["info", paper]) == 0
    reviewed("cli: pendulum frequencies", line(capsys.readouterr().out, "[Hz]: 0.381, 0.9975"))
    assert main(["modes", paper, "--count", "3"]) == 0
    kinds = [line.split()[-1] for line in capsys.readouterr().out.splitlines()[1:4]]
    assert kinds == ["pendulum", "pendulum", "elastic"]


@pytest.mark.parametrize(("segments", "count"), [(5, 8), (6, 9)])
def test_info_shows_up_to_eight_frequencies_and_of_more_the_first_four_and_last_two(
    segments: int, count: int, paper: str, capsys: pytest.CaptureFixture[str]
) -> None:
    more = f"link.fore.segments={segments}"
    assert main(["info", paper, "--set", more, "--json"]) == 0
    about = json.loads(capsys.readouterr().out)
    every = [f"{mode['frequency_hz']:.4g}" for mode in about["modes"] if mode["kind"] == "elastic"]
    shown = next(text for text in about["lines"] if text.startswith("elastic")).partition("[Hz]: ")[2].split(", ")
    assert len(every) == count
    assert shown == (every if count == 8 else [*every[:4], "…", *every[-2:]])


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


def test_info_and_modes_show_specified_and_modelled_damping(tmp_path: Path, capsys) -> None:
    path = damped_boom(tmp_path, "{ ratio = 0.01, at_hz = 5.0 }")
    for command in (["info", path], ["modes", path, "--lock", "boom"]):
        assert main(command) == 0
        lines = capsys.readouterr().out.splitlines()
        head = next(k for k, text in enumerate(lines) if "kind" in text.split())
        reviewed("cli: columns of modes", lines[head])
        assert lines[head].split()[-1] != "kind"
        rows = [text.split() for text in lines[head + 1 :] if text.split()[0].isdigit()]
        assert {kind for _, _, _, kind, _ in rows} == {"elastic"}
        rows = [[float(number) for number in (*row[:3], row[4])] for row in rows]
        assert len(rows) == (4 if command[0] == "info" else 8)
        for _, hertz, ratio, specified in rows:
            assert specified == pytest.approx(0.01 * hertz / 5.0, rel=1e-3)
            assert ratio == pytest.approx(specified, rel=1e-2)  # gravity adds some stiffness but no damping
    assert main(["modes", damped_boom(tmp_path, "")]) == 0
    assert capsys.readouterr().out.splitlines()[0].split()[-1] == "kind"


def test_info_shows_how_damping_reduces_the_explicit_step(tmp_path: Path, capsys) -> None:
    def steps(damping: str) -> list[float]:
        assert main(["info", damped_boom(tmp_path, damping)]) == 0
        (text,) = (text for text in capsys.readouterr().out.splitlines() if text.startswith("largest stable"))
        _, _, of_rk4 = text.partition("RK4 ")
        return [float(number) for number in re.findall(r"\d[\d.e-]*", of_rk4)]

    (free,) = steps("")
    damped, without = steps("{ ratio = 0.05, at_hz = 5.0 }")
    assert without == free > 4 * damped


def test_an_unstable_mode_has_no_frequency_and_no_damping_ratio(paper: str, capsys) -> None:
    assert main(["modes", paper, "--set", "gravity=[0.0, 0.0, -9.81]"]) == 0
    out = capsys.readouterr().out
    first = out.splitlines()[1]
    reviewed("cli: unstable mode", first)
    assert re.findall(r"\d+", first) == ["1"]
    assert first.split()[-2:] == ["–", "pendulum"]
    assert "nan" not in out


def test_an_editable_install_adds_a_path_not_an_import_hook() -> None:
    """With an import hook, the alternative in setuptools, scripts next to a clone would import the clone's folder
    flexlink as an empty package. This mapping of all packages makes setuptools write a path instead."""
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    assert setup["package-dir"] == {"": "."}


def test_a_long_comparison_of_runs_reports_its_steps_and_how_to_shorten_it(monkeypatch, paper: str, capsys) -> None:
    monkeypatch.setattr("flexlink.cli.compare.MANY_STEPS", 100)
    command = ["compare", paper, "--trajectory", "--engines", "mujoco", "--duration"]
    assert main([*command, "0.02"]) == 0
    note = line(capsys.readouterr().err, "--duration")
    reviewed("cli: many steps", note)
    assert note.startswith("note: ")
    for value in ("200", "0.02 s", "0.0001 s"):
        assert value in note
    assert main([*command, "0.005"]) == 0
    assert "--duration" not in capsys.readouterr().err


THREE_LINKS = str(ROOT / "models" / "three_links.toml")


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_x11_and_wayland_displays_both_count_as_a_screen(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for each in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(each, raising=False)
    assert not has_screen()
    monkeypatch.setenv(name, ":0")
    assert has_screen()


def test_the_cost_of_a_second_of_motion_is_that_of_its_steps(paper: str, capsys) -> None:
    assert main(["info", paper, "--json"]) == 0
    chain, rows = fl.lump(fl.load_scene(paper)), json.loads(capsys.readouterr().out)["stable_steps"]
    costs = {row["method"]: row["cpu_s_per_s"] * row["step_s"] for row in rows if row["step_s"] is not None}
    first, *others = [cost / step_cost(chain, name) for name, cost in costs.items()]
    assert others == pytest.approx([first] * len(others)) and others


def test_info_lists_no_steps_if_every_step_is_stable(tmp_path, capsys) -> None:
    rod = fl.Link(name="rod", length=1.0, material="aluminium", section="square")
    path = make_scene(rod, gravity=(0.0, 0.0, 0.0)).save(tmp_path / "rod.toml")
    assert main(["info", str(path)]) == 0
    assert "RK4" not in capsys.readouterr().out


@pytest.mark.parametrize(("met", "code"), [(True, 0), (False, 1)])
def test_advice_that_misses_its_goal_has_exit_code_1(met: bool, code: int, monkeypatch, capsys) -> None:
    names = "error", "tolerance", "tip_travel", "run_time", "again_time", "horizon", "runs", "compute_time"
    found = SimpleNamespace(met=met, scene=fl.load_scene(THREE_LINKS), **dict.fromkeys(names, 0.0))
    monkeypatch.setattr(advise, "advise", lambda *_, **__: found)
    assert main(["advise", THREE_LINKS, "--tip", "1e-3"]) == code
    assert f"met={met}" in capsys.readouterr().out
