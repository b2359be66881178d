"""Motions, drives and wrenches from CSV files: what they become, and every mistake in a file by its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import make_scene

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.smoothing import smoothed

HUB = fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
LINKS = (
    fl.Link(name="upper", length=0.5, hub=HUB),
    fl.Link(name="cart", joint=fl.Joint(kind="prismatic", axis=(1, 0, 0)), hub=HUB),
)
T = np.linspace(0.0, 1.0, 201)
SWING = np.degrees(0.5 * (1 - np.cos(2 * np.pi * T)))  # deg, from rest and to rest


def run_file(folder: Path, **columns: np.ndarray) -> Path:
    """A file of columns by their heads, times first unless they have a head of their own."""
    times = {} if any(head.startswith("t [") for head in columns) else {"t [s]": T}
    path, table = folder / "run.csv", {**times, **columns}
    text = "\n".join(",".join(map(repr, row)) for row in np.column_stack([*table.values()]).tolist())
    path.write_text(",".join(table) + "\n" + text + "\n", encoding="utf-8")
    return path


def swing_file(folder: Path, **more: np.ndarray) -> Path:
    return run_file(folder, **{"q upper [deg]": SWING, **more})


def moved_by(file: Path, **fields: object) -> fl.Scene:
    return make_scene(*LINKS, motion=(fl.PrescribedMotion(link="upper", file=str(file), **fields),))


class TestMotions:
    def test_with_a_cutoff_rates_are_the_librarys(self, tmp_path: Path) -> None:
        (motion,) = moved_by(swing_file(tmp_path), cutoff=40.0).motion
        rate, acceleration = (
            np.degrees(part) for part in (np.pi * np.sin(2 * np.pi * T), 2 * np.pi**2 * np.cos(2 * np.pi * T))
        )
        np.testing.assert_allclose(motion.angle_deg, SWING, atol=1e-3)
        np.testing.assert_allclose(motion.rate_deg, rate, atol=0.2)
        np.testing.assert_allclose(motion.acceleration_deg, acceleration, atol=30.0)

    def test_rates_and_accelerations_of_the_file_are_taken_as_they_are(self, tmp_path: Path) -> None:
        file = swing_file(tmp_path, **{"qd upper [rad/s]": T, "qdd upper [deg/s^2]": 2 * T, "other": T})
        (motion,) = moved_by(file).motion
        np.testing.assert_array_equal(motion.angle_deg, SWING)
        np.testing.assert_allclose(motion.rate_deg, np.degrees(T), rtol=1e-15)
        np.testing.assert_array_equal(motion.acceleration_deg, 2 * T)

    def test_a_joint_starts_where_its_file_does(self, tmp_path: Path) -> None:
        file = run_file(tmp_path, **{"t [ms]": 1e3 * T, "q upper [rad]": 0.3 + 0.1 * T})
        scene = moved_by(file, cutoff=20.0)
        assert scene.initial.joint_deg[0] == pytest.approx(np.degrees(0.3), rel=1e-9)
        assert scene.initial.rate_deg[0] == pytest.approx(np.degrees(0.1), rel=1e-7)
        run = fl.simulate(scene, step=1e-3, duration=1.0)
        np.testing.assert_allclose(run.q[:, 0], 0.3 + 0.1 * run.t, rtol=0, atol=1e-8)

    def test_another_file_in_place_of_the_first_starts_where_it_does(self, tmp_path: Path) -> None:
        first = moved_by(run_file(tmp_path, **{"q upper [deg]": 20.0 + 30.0 * T}), cutoff=20.0)
        assert first.initial.joint_deg[0] == pytest.approx(20.0)
        other = run_file(tmp_path, **{"q upper [deg]": -40.0 - 10.0 * T})
        second = first.varied({"motion": [{"link": "upper", "file": str(other), "cutoff": 20.0}]})
        assert second.initial.joint_deg[0] == pytest.approx(-40.0)
        assert second.initial.rate_deg[0] == pytest.approx(-10.0)

    def test_a_start_that_a_scene_gives_itself_is_still_compared_with_the_file(self, tmp_path: Path) -> None:
        still = make_scene(*LINKS, initial=fl.InitialState(joint_deg=(28.6, 0.0)))
        file = run_file(tmp_path, **{"q upper [deg]": -40.0 - 10.0 * T})
        with pytest.raises(fl.errors.SceneError, match="the file of the motion of 'upper' begins with"):
            still.varied({"motion": [{"link": "upper", "file": str(file), "cutoff": 20.0}]})

    def test_a_joint_that_slides_has_lengths(self, tmp_path: Path) -> None:
        file = run_file(tmp_path, **{"q cart [mm]": 100 * T})
        scene = make_scene(*LINKS, motion=(fl.PrescribedMotion(link=2, file=str(file), cutoff=20.0),))
        np.testing.assert_allclose(scene.motion[0].position_m, 0.1 * T, atol=1e-12)

    def test_a_scene_keeps_what_it_has_read(self, tmp_path: Path) -> None:
        scene = moved_by(swing_file(tmp_path), cutoff=40.0)
        (tmp_path / "run.csv").unlink()
        assert fl.load_scene(scene.save(tmp_path / "scene.toml")) == scene
        assert scene.varied({"run.step": 1e-3}).motion == scene.motion


@pytest.mark.parametrize("part", [0.2, 1 / 3, 0.5, 1.0, 2.0])
def test_the_low_pass_is_the_one_it_says_and_without_delay(part: float) -> None:
    """1/(1 + (f/cutoff)⁶) of an oscillation, far from the ends of the record."""
    t, cutoff = np.arange(0, 8, 0.005), 4.0
    y, inside, ω = np.sin(2 * np.pi * part * cutoff * t), (t > 3) & (t < 5), 2 * np.pi * part * cutoff
    passed = 1 / (1 + part**6)
    place, rate, acceleration = (found[inside] for found in smoothed(t, y, cutoff))
    np.testing.assert_allclose(place, passed * y[inside], rtol=0, atol=3e-7)
    np.testing.assert_allclose(rate, passed * ω * np.cos(ω * t[inside]), rtol=0, atol=2e-6 * ω)
    np.testing.assert_allclose(acceleration, -passed * ω**2 * y[inside], rtol=0, atol=2e-5 * ω**2)


def test_a_parabola_passes_unchanged_up_to_the_ends_of_a_record() -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.5e-3, 1.5e-3, 3000))  # s, at uneven times
    place, rate, acceleration = smoothed(t, 3 + 2 * t - 4 * t**2, 5.0)
    np.testing.assert_allclose(place, 3 + 2 * t - 4 * t**2, rtol=0, atol=1e-6)
    np.testing.assert_allclose(rate, 2 - 8 * t, rtol=0, atol=1e-5)
    np.testing.assert_allclose(acceleration, -8.0, rtol=0, atol=1e-3)


class TestDrives:
    def test_torques_of_a_file_are_those_of_a_table(self, tmp_path: Path) -> None:
        file = run_file(tmp_path, **{"tau cart [kN]": 0.001 * T, "t [s]": T, "tau upper [N m]": 3 * T})
        scene = make_scene(*LINKS, drive=fl.Drive(kind="table", file=str(file), smooth=True))
        assert scene.drive.file is None
        np.testing.assert_array_equal(scene.drive.times, T)
        np.testing.assert_allclose(scene.drive.torques, np.column_stack([3 * T, T]), rtol=1e-15)
        assert scene.drive.smooth

    def test_joints_that_are_not_driven_need_no_column(self, tmp_path: Path) -> None:
        file = run_file(tmp_path, **{"tau upper [N m]": 3 * T})
        locked = fl.Link(name="wrist", joint=fl.Joint(locked=True))
        scene = make_scene(LINKS[0], locked, drive=fl.Drive(kind="table", file=str(file)))
        assert scene.drive.torques[-1] == (3.0, 0.0)


def test_a_wrench_takes_the_components_that_are_there(tmp_path: Path) -> None:
    file = run_file(tmp_path, **{"force y [N]": T, "moment z [N mm]": 1e3 * T})
    scene = make_scene(*LINKS, wrench=fl.Wrench(file=str(file)))
    assert scene.wrench.forces[-1] == (0.0, 1.0, 0.0)
    assert scene.wrench.moments[-1] == pytest.approx((0.0, 0.0, 1.0))
    alone = fl.Wrench(file=str(run_file(tmp_path, **{"force x [N]": T})))
    assert make_scene(*LINKS, wrench=alone).wrench.moments is None


MOTION = '[[motion]]\nlink = "upper"\nfile = "run.csv"\ncutoff = 5.0\n'
DRIVE = '[drive]\nkind = "table"\nfile = "run.csv"\n'
WRENCH = '[wrench]\nfile = "run.csv"\n'
ROWS = "".join(f"{k / 100},{k}\n" for k in range(20))
GOOD = "t [s],q upper [deg]\n" + ROWS


def edited(find: str, replace: str) -> str:
    assert find in GOOD
    return GOOD.replace(find, replace)


MISTAKES = {
    "no such file": (MOTION, None, "cannot be read"),
    "empty": (MOTION, "", "is empty"),
    "heads alone": (MOTION, "t [s],q upper [deg]\n", "no rows; expected one or more"),
    "semicolons": (MOTION, GOOD.replace(",", ";"), "separated by semicolons; expected commas"),
    "tabs": (MOTION, GOOD.replace(",", "\t"), "separated by tabs; expected commas"),
    "no time": (MOTION, edited("t [s]", "time [s]"), "no column 't [s]'"),
    "time without a unit": (MOTION, edited("t [s]", "t"), "column 't': without a unit"),
    "time in minutes": (MOTION, edited("t [s]", "t [min]"), "column 't [min]': unit must be one of s, ms"),
    "an angle without a unit": (MOTION, edited(" [deg]", ""), "column 'q upper': without a unit"),
    "an angle in a unit of torques": (MOTION, edited("[deg]", "[N m]"), "unit must be one of rad, deg, mrad"),
    "a rate for an angle": (MOTION, edited("[deg]", "[deg/s]"), "unit must be one of rad, deg, mrad"),
    "an unknown unit": (MOTION, edited("[deg]", "[gon]"), "unit must be one of rad, deg, mrad"),
    "another joint": (MOTION, edited("q upper", "q cart"), "no column 'q upper [deg]'; columns: t [s], q cart [deg]"),
    "a joint misspelt": (MOTION, edited("q upper", "q uper"), "did you mean 'q uper [deg]'?"),
    "a column twice": (MOTION, "t [s],q upper [deg],q upper [rad]\n0,1,1\n", "'q upper' appears twice"),
    "too few cells": (MOTION, edited("0.05,5\n", "0.05\n"), "line 7: 1 cells; the header line has 2"),
    "a decimal comma": (MOTION, edited("0.05,5\n", "0,05,5\n"), "line 7: 3 cells; the header line has 2"),
    "no number": (MOTION, edited("0.05,5\n", "0.05,five\n"), "line 7, q upper [deg]: 'five' is not a number"),
    "not finite": (MOTION, edited("0.05,5\n", "0.05,nan\n"), "line 7, q upper [deg]: 'nan' is not finite"),
    "an empty cell": (MOTION, edited("0.05,5\n", "0.05,\n"), "line 7, q upper [deg]: empty"),
    "rows in disorder": (MOTION, edited("0.05,5\n0.06,6\n", "0.06,6\n0.05,5\n"), "line 8: t = 0.05 s: must be later"),
    "a time twice": (MOTION, edited("0.06,6\n", "0.05,6\n"), "line 8: t = 0.05 s: must be later than the one before"),
    "a late begin": (MOTION, edited("0.0,0\n", ""), "t begins at 0.01 s; a motion begins at 0"),
    "no cutoff": (MOTION.replace("cutoff = 5.0\n", ""), GOOD, "cutoff: missing; "),
    "a cutoff beyond the rate": (MOTION.replace("5.0", "60.0"), GOOD, "expected below 50 Hz"),
    "few rows": (MOTION, "".join(GOOD.splitlines(keepends=True)[:5]), "4 samples are too few; expected 5 or more"),
    "a file and a table": (MOTION + "times = [0.0]\n", GOOD, "file = ", "times is given, too"),
    "a cutoff without a file": (MOTION.replace('file = "run.csv"\n', ""), GOOD, "cutoff = 5.0: has no effect"),
    "radians called degrees": (
        "initial = { joint_deg = [28.6, 0.0] }\n" + MOTION, edited("0.0,0\n", "0.0,0.5\n"),
        "initial.joint_deg.upper = 28.6: the file of the motion of 'upper' begins with",
    ),
    "a driven joint is left out": (DRIVE, "t [s],tau upper [N m]\n0,1\n", "no column 'tau cart [N]'"),
    "a force in N m": (DRIVE, "t [s],tau upper [N m],tau cart [N m]\n0,1,1\n", "unit must be one of N, kN"),
    "a drive of another kind": (
        DRIVE.replace("table", "constant") + "torque = [1.0, 0.0]\n", GOOD, "file = ", "takes torque",
    ),
    "torques beside a file": (DRIVE + "times = [0.0]\n", GOOD, "times = ", "takes file"),
    "a wrench of nothing": (WRENCH, GOOD, "no column such as 'force x [N]'"),
    "a force along q": (WRENCH, "t [s],force q [N]\n0,1\n", "column 'force q [N]': not known"),
    "a force beside a file": (WRENCH + "force = [1.0, 0.0, 0.0]\n", "t [s],force x [N]\n0,1\n", "force is given, too"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_is_named_and_ends_with_2(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, text, *expected = MISTAKES[name]
    scene = make_scene(*LINKS).to_toml()
    top, _, rest = table.partition("\n") if table.startswith("initial") else ("", "", table)
    (tmp_path / "scene.toml").write_text(f"{top}\n{scene}\n{rest}", encoding="utf-8")
    if text is not None:
        (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    assert main(["info", str(tmp_path / "scene.toml")]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    for words in expected:
        assert words in said


def test_the_file_that_is_edited_has_no_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.toml").write_text(make_scene(*LINKS).to_toml() + "\n" + MOTION, encoding="utf-8")
    (tmp_path / "run.csv").write_text(GOOD, encoding="utf-8")
    assert main(["info", str(tmp_path / "scene.toml")]) == 0
    assert not capsys.readouterr().err
