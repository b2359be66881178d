"""Motions, drives, references and wrenches from CSV files; every mistake in a file is named."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.data.csv_table import read_csv
from flexlink.data.smoothing import smoothed
from tests.conftest import make_scene
from tests.support.words import refused, refused_line

HUB = fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))
LINKS = (
    fl.Link(name="upper", length=0.5, hub=HUB),
    fl.Link(name="cart", joint=fl.Joint(kind="prismatic", axis=(1, 0, 0)), hub=HUB),
)
NONE: Mapping[str, object] = MappingProxyType({})
T = np.linspace(0.0, 1.0, 201)
SWING = np.degrees(0.5 * (1 - np.cos(2 * np.pi * T)))  # deg, from rest and to rest


def run_file(folder: Path, **columns: np.ndarray) -> Path:
    """Write a CSV file with these columns, preceded by times unless they are given."""
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
    def test_rates_and_accelerations_are_computed_if_a_cutoff_is_given(self, tmp_path: Path) -> None:
        (motion,) = moved_by(swing_file(tmp_path), cutoff=40.0).motion
        rate, acceleration = (
            np.degrees(part) for part in (np.pi * np.sin(2 * np.pi * T), 2 * np.pi**2 * np.cos(2 * np.pi * T))
        )
        np.testing.assert_allclose(motion.angle_deg, SWING, atol=1e-3)
        np.testing.assert_allclose(motion.rate_deg, rate, atol=0.2)
        np.testing.assert_allclose(motion.acceleration_deg, acceleration, atol=30.0)

    def test_rates_and_accelerations_in_the_file_are_used_unchanged(self, tmp_path: Path) -> None:
        file = swing_file(tmp_path, **{"qd upper [rad/s]": T, "qdd upper [deg/s^2]": 2 * T, "other": T})
        (motion,) = moved_by(file).motion
        np.testing.assert_array_equal(motion.angle_deg, SWING)
        np.testing.assert_allclose(motion.rate_deg, np.degrees(T), rtol=1e-15)
        np.testing.assert_array_equal(motion.acceleration_deg, 2 * T)

    def test_a_joint_starts_at_the_first_angle_of_its_file(self, tmp_path: Path) -> None:
        file = run_file(tmp_path, **{"t [ms]": 1e3 * T, "q upper [rad]": 0.3 + 0.1 * T})
        scene = moved_by(file, cutoff=20.0)
        assert scene.initial.joint_deg[0] == pytest.approx(np.degrees(0.3), rel=1e-9)
        assert scene.initial.rate_deg[0] == pytest.approx(np.degrees(0.1), rel=1e-7)
        run = fl.simulate(scene, step=1e-3, duration=1.0)
        np.testing.assert_allclose(run.q[:, 0], 0.3 + 0.1 * run.t, rtol=0, atol=1e-8)

    def test_a_replaced_motion_file_also_replaces_the_initial_angle(self, tmp_path: Path) -> None:
        first = moved_by(run_file(tmp_path, **{"q upper [deg]": 20.0 + 30.0 * T}), cutoff=20.0)
        assert first.initial.joint_deg[0] == pytest.approx(20.0)
        other = run_file(tmp_path, **{"q upper [deg]": -40.0 - 10.0 * T})
        second = first.varied({"motion": [{"link": "upper", "file": str(other), "cutoff": 20.0}]})
        assert second.initial.joint_deg[0] == pytest.approx(-40.0)
        assert second.initial.rate_deg[0] == pytest.approx(-10.0)

    def test_degrees_in_a_column_of_radians_are_recognised_by_the_initial_angle(self, tmp_path: Path) -> None:
        at = make_scene(*LINKS, initial=fl.InitialState(joint_deg=(20.0, 0.0)))
        file = run_file(tmp_path, **{"q upper [rad]": 20.0 + 10.0 * T})
        with refused(fl.errors.SceneError, "start-differs-from-file") as caught:
            at.varied({"motion": [{"link": "upper", "file": str(file), "cutoff": 20.0}]})
        assert "[deg]" in str(caught.value)

    def test_an_explicit_initial_angle_is_checked_against_the_file(self, tmp_path: Path) -> None:
        still = make_scene(*LINKS, initial=fl.InitialState(joint_deg=(28.6, 0.0)))
        file = run_file(tmp_path, **{"q upper [deg]": -40.0 - 10.0 * T})
        with refused(fl.errors.SceneError, "start-differs-from-file"):
            still.varied({"motion": [{"link": "upper", "file": str(file), "cutoff": 20.0}]})

    def test_motion_files_of_prismatic_joints_contain_lengths(self, tmp_path: Path) -> None:
        file = run_file(tmp_path, **{"q cart [mm]": 100 * T})
        scene = make_scene(*LINKS, motion=(fl.PrescribedMotion(link=2, file=str(file), cutoff=20.0),))
        np.testing.assert_allclose(scene.motion[0].position_m, 0.1 * T, atol=1e-12)

    def test_a_scene_keeps_the_data_that_it_has_read(self, tmp_path: Path) -> None:
        scene = moved_by(swing_file(tmp_path), cutoff=40.0)
        (tmp_path / "run.csv").unlink()
        assert fl.load_scene(scene.save(tmp_path / "scene.toml")) == scene
        assert scene.varied({"run.step": 1e-3}).motion == scene.motion


@pytest.mark.parametrize("part", [0.2, 1 / 3, 0.5, 1.0, 2.0])
def test_the_low_pass_filter_is_the_documented_one_without_delay(part: float) -> None:
    """Far from the ends of the record, an oscillation is multiplied by 1/(1 + (f/cutoff)⁶)."""
    t, cutoff = np.arange(0, 8, 0.005), 4.0
    y, inside, ω = np.sin(2 * np.pi * part * cutoff * t), (t > 3) & (t < 5), 2 * np.pi * part * cutoff
    passed = 1 / (1 + part**6)
    place, rate, acceleration = (found[inside] for found in smoothed(t, y, cutoff))
    np.testing.assert_allclose(place, passed * y[inside], rtol=0, atol=3e-7)
    np.testing.assert_allclose(rate, passed * ω * np.cos(ω * t[inside]), rtol=0, atol=2e-6 * ω)
    np.testing.assert_allclose(acceleration, -passed * ω**2 * y[inside], rtol=0, atol=2e-5 * ω**2)


def test_a_parabola_passes_unchanged_up_to_the_ends_of_a_record() -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.5e-3, 1.5e-3, 3000))  # times [s] at uneven intervals
    place, rate, acceleration = smoothed(t, 3 + 2 * t - 4 * t**2, 5.0)
    np.testing.assert_allclose(place, 3 + 2 * t - 4 * t**2, rtol=0, atol=1e-6)
    np.testing.assert_allclose(rate, 2 - 8 * t, rtol=0, atol=1e-5)
    np.testing.assert_allclose(acceleration, -8.0, rtol=0, atol=1e-3)


class TestDrives:
    def test_torques_from_a_file_equal_torques_in_a_table(self, tmp_path: Path) -> None:
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


class TestReferences:
    def led_by(self, *links: fl.Link, fields: Mapping[str, object] = NONE, **reference: object) -> fl.Scene:
        free = [100.0 * (not link.joint.locked and "motion" not in fields) for link in links]
        drive = fl.Drive(kind="pd", kp=free, kd=free, reference=fl.Reference(**reference))
        return make_scene(*links, drive=drive, **fields)

    @pytest.mark.parametrize("profile", ["linear", "smooth", "hold"])
    def test_references_from_a_file_equal_references_in_a_table(self, profile: str, tmp_path: Path) -> None:
        file = swing_file(tmp_path, **{"q cart [mm]": 100 * T})
        read = self.led_by(*LINKS, profile=profile, file=str(file))
        angles, places = [(a, 0.0) for a in SWING], [(0.0, p) for p in 0.1 * T]
        typed = self.led_by(*LINKS, profile=profile, times=T, angle_deg=angles, position_m=places)
        for t in (-0.1, 0.3517, 2.0):
            np.testing.assert_allclose(read.course(t), typed.course(t), rtol=1e-12, atol=1e-11)
        assert read.drive.reference.file is None

    def test_a_smooth_reference_uses_rates_and_accelerations_if_given(self, tmp_path: Path) -> None:
        rates = {"q cart [m]": T**3, "qd cart [m/s]": 3 * T**2, "qd upper [rad/s]": 0 * T}
        columns = {"t [s]": T, "q upper [deg]": 0 * T} | rates
        slow = run_file(tmp_path, **{head: column[::50] for head, column in columns.items()})
        scene = self.led_by(*LINKS, profile="smooth", file=str(slow))
        place, rate, _ = scene.course(0.4)  # cubic Hermite polynomials are exact
        np.testing.assert_allclose([place[1], rate[1]], [0.4**3, 3 * 0.4**2], rtol=1e-12)

    def test_a_cutoff_low_pass_filters_a_reference(self, tmp_path: Path) -> None:
        noisy = SWING + np.random.default_rng(0).normal(scale=0.01, size=len(T))
        file = run_file(tmp_path, **{"q upper [deg]": noisy})
        scene = self.led_by(LINKS[0], profile="smooth", file=str(file), cutoff=10.0)
        angle, rate, acceleration = scene.course(0.5)
        wanted = np.radians(smoothed(T, noisy, 10.0))[:, 100]
        np.testing.assert_allclose([angle[0], rate[0], acceleration[0]], wanted, rtol=1e-9)

    def test_locked_and_prescribed_joints_need_no_column(self, tmp_path: Path) -> None:
        file = swing_file(tmp_path)
        locked = fl.Link(name="wrist", joint=fl.Joint(locked=True))
        assert self.led_by(LINKS[0], locked, profile="hold", file=str(file)).course(0.5)[0].shape == (1,)
        motion = fl.PrescribedMotion(link=2, times=(0.0,), position_m=(0.2,), rate_m=(0.0,), acceleration_m=(0.0,))
        moved = {"motion": (motion,), "initial": fl.InitialState(joint_m=(0.0, 0.2))}
        assert self.led_by(*LINKS, fields=moved, profile="hold", file=str(file)).course(0.5)[0][1] == 0.2

    def test_a_reference_file_is_read_only_as_part_of_a_scene(self, tmp_path: Path) -> None:
        with refused(fl.errors.SceneError, "file-not-read"):
            fl.Reference(profile="hold", file=str(swing_file(tmp_path))).course((0.0, 0.0))


def test_a_wrench_file_may_omit_components(tmp_path: Path) -> None:
    file = run_file(tmp_path, **{"force y [N]": T, "moment z [N mm]": 1e3 * T})
    scene = make_scene(*LINKS, wrench=fl.Wrench(file=str(file)))
    assert scene.wrench.forces[-1] == (0.0, 1.0, 0.0)
    assert scene.wrench.moments[-1] == pytest.approx((0.0, 0.0, 1.0))
    alone = fl.Wrench(file=str(run_file(tmp_path, **{"force x [N]": T})))
    assert make_scene(*LINKS, wrench=alone).wrench.moments is None


MOTION = '[[motion]]\nlink = "upper"\nfile = "run.csv"\ncutoff = 5.0\n'
DRIVE = '[drive]\nkind = "table"\nfile = "run.csv"\n'
LED = (
    '[drive]\nkind = "pd"\nkp = [1.0, 1.0]\nkd = [1.0, 1.0]\n[drive.reference]\nprofile = "smooth"\nfile = "run.csv"\n'
)
BOTH = "t [s],q upper [deg],q cart [m]\n" + "".join(f"{k / 100},{k},{k / 1000}\n" for k in range(20))
WRENCH = '[wrench]\nfile = "run.csv"\n'
ROWS = "".join(f"{k / 100},{k}\n" for k in range(20))
GOOD = "t [s],q upper [deg]\n" + ROWS


def edited(find: str, replace: str) -> str:
    assert find in GOOD
    return GOOD.replace(find, replace)


MISTAKES = {
    "no such file": (MOTION, None, "cannot-read"),
    "empty": (MOTION, "", "file-empty"),
    "heads alone": (MOTION, "t [s],q upper [deg]\n", "file-empty"),
    "semicolons": (MOTION, GOOD.replace(",", ";"), "not-csv"),
    "tabs": (MOTION, GOOD.replace(",", "\t"), "not-csv"),
    "no time": (MOTION, edited("t [s]", "time [s]"), "no-such-column"),
    "time without a unit": (MOTION, edited("t [s]", "t"), "unit-missing"),
    "time in minutes": (MOTION, edited("t [s]", "t [min]"), "unit-unknown"),
    "an angle without a unit": (MOTION, edited(" [deg]", ""), "unit-missing"),
    "an angle in a unit of torques": (MOTION, edited("[deg]", "[N m]"), "unit-unknown"),
    "a rate for an angle": (MOTION, edited("[deg]", "[deg/s]"), "unit-unknown"),
    "an unknown unit": (MOTION, edited("[deg]", "[gon]"), "unit-unknown"),
    "another joint": (MOTION, edited("q upper", "q cart"), "no-such-column"),
    "a joint misspelt": (MOTION, edited("q upper", "q uper"), "no-such-column"),
    "another word for q": (MOTION, edited("q upper", "position upper"), "no-such-column"),
    "a column twice": (MOTION, "t [s],q upper [deg],q upper [rad]\n0,1,1\n", "column-twice"),
    "too few cells": (MOTION, edited("0.05,5\n", "0.05\n"), "csv-cell"),
    "a decimal comma": (MOTION, edited("0.05,5\n", "0,05,5\n"), "csv-cell"),
    "no number": (MOTION, edited("0.05,5\n", "0.05,five\n"), "csv-cell"),
    "an underscore": (MOTION, edited("0.05,5\n", "0.05,1_000\n"), "csv-cell"),
    "other digits": (MOTION, edited("0.05,5\n", "0.05,٥\n"), "csv-cell"),
    "a long text": (MOTION, edited("0.05,5\n", f"0.05,{'long ' * 99}\n"), "csv-cell"),
    "not finite": (MOTION, edited("0.05,5\n", "0.05,nan\n"), "csv-cell"),
    "an empty cell": (MOTION, edited("0.05,5\n", "0.05,\n"), "csv-cell"),
    "rows in disorder": (MOTION, edited(",5\n0.06,6\n0.07", ",5\n\n0.04,6\n0.03"), "times-not-increasing"),
    "a time twice": (MOTION, edited("0.06,6\n", "0.05,6\n"), "times-not-increasing"),
    "a late begin": (MOTION, edited("0.0,0\n", ""), "first-time"),
    "no cutoff": (MOTION.replace("cutoff = 5.0\n", ""), GOOD, "missing-key"),
    "a cutoff beyond the rate": (MOTION.replace("5.0", "60.0"), GOOD, "cutoff-too-high"),
    "few rows": (MOTION, "".join(GOOD.splitlines(keepends=True)[:5]), "too-few-samples"),
    "a file and a table": (MOTION + "times = [0.0]\n", GOOD, "both-given"),
    "a cutoff without a file": (MOTION.replace('file = "run.csv"\n', ""), GOOD, "no-effect"),
    "radians called degrees": (
        "initial = { joint_deg = [28.6, 0.0] }\n" + MOTION, edited("0.0,0\n", "0.0,0.5\n"),
        "start-differs-from-file",
    ),
    "a driven joint is left out": (DRIVE, "t [s],tau upper [N m]\n0,1\n", "no-such-column"),
    "a force in N m": (DRIVE, "t [s],tau upper [N m],tau cart [N m]\n0,1,1\n", "unit-unknown"),
    "a drive of another kind": (
        DRIVE.replace("table", "constant") + "torque = [1.0, 0.0]\n", GOOD, "key-of-another-kind",
    ),
    "torques beside a file": (DRIVE + "times = [0.0]\n", GOOD, "key-of-another-kind"),
    "a joint that nothing leads": (LED, GOOD, "no-such-column"),
    "a place in degrees": (LED, BOTH.replace("[m]", "[deg]"), "unit-unknown"),
    "rates of one joint alone": (
        LED, "t [s],q upper [deg],q cart [m],qd upper [deg/s]\n0,0,0,0\n", "no-such-column",
    ),
    "a move from a file": (LED.replace("smooth", "quintic"), BOTH, "key-of-another-kind"),
    "a reference and a file": (LED + "times = [0.0]\n", BOTH, "both-given"),
    "a cutoff of a held one": (
        LED.replace("smooth", "hold") + "cutoff = 5.0\n", BOTH, "needs-another-key",
    ),
    "a reference beyond the rate": (LED + "cutoff = 60.0\n", BOTH, "cutoff-too-high"),
    "a wrench of nothing": (WRENCH, GOOD, "no-such-column"),
    "a force along q": (WRENCH, "t [s],force q [N]\n0,1\n", "unknown-column"),
    "a force beside a file": (WRENCH + "force = [1.0, 0.0, 0.0]\n", "t [s],force x [N]\n0,1\n", "both-given"),
}  # fmt: skip


def test_the_error_for_a_file_that_is_not_a_table_does_not_quote_it(tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("root:x:0:0:secret:/root:/bin/sh\nanother:secret\n")
    (tmp_path / "scene.toml").write_text(f"{make_scene(*LINKS).to_toml()}\n{MOTION}", encoding="utf-8")
    with refused(fl.errors.DataFileError, "not-csv") as error:
        fl.load_scene(tmp_path / "scene.toml")
    assert "secret" not in str(error.value)


def test_line_ends_of_any_operating_system_are_accepted(tmp_path: Path) -> None:
    for end in ("\n", "\r\n", "\r"):
        (tmp_path / "run.csv").write_bytes(GOOD.replace("\n", end).encode())
        assert read_csv(tmp_path / "run.csv").column("q upper", "deg").tolist() == [float(k) for k in range(20)]


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_in_a_data_file_is_named_and_gives_exit_code_2(name: str, tmp_path, capsys) -> None:
    table, text, id = MISTAKES[name]
    scene = make_scene(*LINKS).to_toml()
    top, _, rest = table.partition("\n") if table.startswith("initial") else ("", "", table)
    (tmp_path / "scene.toml").write_text(f"{top}\n{scene}\n{rest}", encoding="utf-8")
    if text is not None:
        (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    assert main(["info", str(tmp_path / "scene.toml")]) == 2
    printed = capsys.readouterr().err
    assert len(printed.splitlines()) == 1
    refused_line(printed, id)


def test_the_unedited_data_file_is_accepted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.toml").write_text(make_scene(*LINKS).to_toml() + "\n" + MOTION, encoding="utf-8")
    (tmp_path / "run.csv").write_text(GOOD, encoding="utf-8")
    assert main(["info", str(tmp_path / "scene.toml")]) == 0
    assert not capsys.readouterr().err


def test_smoothing_does_not_depend_on_the_direction_of_time(rng: np.random.Generator) -> None:
    t, y = 0.01 * np.arange(40), rng.normal(size=40)
    back = smoothed(t, y[::-1].copy(), 10.0)
    for order, (one, other) in enumerate(zip(smoothed(t, y, 10.0), back, strict=True)):
        np.testing.assert_allclose((-1) ** order * other[::-1], one, rtol=1e-6, atol=1e-6 * np.abs(one).max())
