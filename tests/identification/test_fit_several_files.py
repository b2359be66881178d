"""A run recorded by several instruments at different rates, each in its own file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.identification.data import recorded
from tests.identification.test_fit_first_look import strip
from tests.support.words import refused, reviewed


def scene() -> fl.Scene:
    axis = (0.0, -1.0, 0.0)
    gyro = fl.Sensor(name="gyro", kind="gyroscope", link="strip", x=0.9, axis=axis)
    return strip().varied({"sensor": (gyro,), "run.duration": 2.0, "run.sample": 0.001})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gyroscope at 500 Hz and a film at 60 Hz that begins later, of a strip with 0.43 kg at its end."""
    folder, rng = tmp_path_factory.mktemp("rates"), np.random.default_rng(0)
    run = fl.simulate(scene().varied({"tip.mass": 0.43, "run.relative_tolerance": 1e-8}))
    for name, column, spacing, begin, noise in (
        ("imu", "gyro [rad/s]", 1 / 500, 0.0, 0.002), ("film", "tip z [m]", 1 / 60, 0.013, 2e-4),
    ):  # fmt: skip
        t = np.arange(begin, 1.99, spacing)
        y = np.interp(t, run.t, run.columns[column]) + noise * rng.standard_normal(len(t))
        head = f"t [s],{column}"
        np.savetxt(folder / f"{name}.csv", np.column_stack([t, y]), delimiter=",", header=head, comments="")
    scene().save(folder / "arm.toml")
    return folder


def problem(folder: Path, *files: str, compare: str = "") -> fl.fits.FitProblem:
    path = folder / "problem.toml"
    names = ", ".join(f'"{name}.csv"' for name in files)
    path.write_text(
        f'scene = "arm.toml"\n[[parameter]]\npath = "tip.mass"\n[[run]]\nname = "both"\nfile = [{names}]\n{compare}',
        "utf-8",
    )
    return fl.fits.load_fit(path)


def test_every_column_keeps_the_times_of_its_file(folder: Path) -> None:
    of = problem(folder, "imu", "film")
    source = recorded(of, of.run[0])
    lengths = {block.name: len(block.y) for block in source.blocks}
    assert lengths == {"gyro [rad/s]": 995, "tip z [m]": 119}
    for block, file in zip(source.blocks, ("imu", "film"), strict=True):
        t, y = np.loadtxt(folder / f"{file}.csv", delimiter=",", skiprows=1).T
        np.testing.assert_array_equal(block.t, t)
        np.testing.assert_array_equal(block.y, y)
    assert source.rate == pytest.approx(500, rel=1e-3)
    assert source.scene.run.sample == pytest.approx(0.002)


def test_both_instruments_narrow_the_interval_and_the_estimate_is_right(folder: Path) -> None:
    both = fl.fit(problem(folder, "imu", "film"), grid="ignore")
    alone = fl.fit(problem(folder, "imu"), grid="ignore")
    for found in (both, alone):
        assert abs(found["tip.mass"].value - 0.43) < 1.5 * found["tip.mass"].half
    assert both["tip.mass"].half < alone["tip.mass"].half
    note = next(note for note in both.check.notes if note.id == "data-read")
    reviewed("data-read", note)


def test_compared_columns_may_be_in_any_of_the_files(folder: Path) -> None:
    of = problem(folder, "imu", "film", compare='compare = ["tip z [m]"]\n')
    assert [block.name for block in recorded(of, of.run[0]).blocks] == ["tip z [m]"]
    with refused(fl.errors.DataFileError, "no-such-column"):
        of = problem(folder, "imu", "film", compare='compare = ["tip y [m]"]\n')
        recorded(of, of.run[0])


def test_a_column_in_two_files_is_refused_by_name(folder: Path) -> None:
    (folder / "again.csv").write_text((folder / "film.csv").read_text("utf-8"), "utf-8")
    of = problem(folder, "film", "imu", "again")
    with refused(fl.errors.DataFileError, "column-twice"):
        recorded(of, of.run[0])


def test_the_page_names_the_files_in_its_problem(folder: Path, tmp_path: Path) -> None:
    found = fl.fit(problem(folder, "imu", "film"), grid="ignore")
    found.report(tmp_path)
    again = fl.fits.load_fit(tmp_path / "problem.toml")
    assert again.run[0].file == found.problem.run[0].file
