"""What the check shows of the data: noise, outliers, gaps and spectra, against planted ones."""

from __future__ import annotations

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import flexlink as fl
from flexlink.cli.main import main
from flexlink.identification.block import Block
from flexlink.identification.data_page import amplitudes
from flexlink.identification.noise import noise_in, outliers_in, white_noise
from tests.identification.test_fit_first_look import strip
from tests.support.words import reviewed

Array = NDArray[np.float64]
T: Array = np.linspace(0.0, 14.995, 3000)
MOTION = 0.3 * np.cos(2 * np.pi * 2.3 * T) * np.exp(-T / 2) + 0.01 * np.sin(2 * np.pi * 17 * T) * np.exp(-2 * T)


def coloured(rng: np.random.Generator, memory: float, σ: float = 1e-3) -> Array:
    """Noise of standard deviation σ with the correlation `memory` of neighbouring samples."""
    white = rng.standard_normal(len(T) + 200)
    return np.asarray(σ * math.sqrt(1 - memory**2) * lfilter([1.0], [1.0, -memory], white)[200:])


def block(y: Array, t: Array = T) -> Block:
    return Block("tip x [m]", y, np.full(len(y), 0.006), False, t)


class TestNoise:
    def test_white_noise_in_a_motion_is_found_within_five_percent(self, rng: np.random.Generator) -> None:
        found = [noise_in(block(MOTION + coloured(rng, 0.0))) for _ in range(30)]
        assert sum(one is not None for one in found) >= 28
        assert np.mean([one for one in found if one]) == pytest.approx(1e-3, rel=0.02)
        assert all(abs(one / 1e-3 - 1) < 0.1 for one in found if one)

    def test_coloured_noise_short_records_and_rounding_are_not_determined(self, rng: np.random.Generator) -> None:
        assert [noise_in(block(MOTION + coloured(rng, 0.8))) for _ in range(10)] == 10 * [None]
        assert white_noise((MOTION + coloured(rng, 0.0))[:400]) is None
        assert white_noise(MOTION) is None
        assert white_noise(np.round(MOTION, 7)) is None

    def test_the_steps_of_a_converter_are_noise_of_their_size_over_the_root_of_twelve(self) -> None:
        step = 1e-3
        found = white_noise(step * np.round(np.sin(0.37 * T) / step))
        assert found is not None
        assert found == pytest.approx(step / math.sqrt(12), rel=0.1)

    def test_outliers_and_gaps_do_not_change_the_noise(self, rng: np.random.Generator) -> None:
        y, kept = MOTION + coloured(rng, 0.0), np.ones(len(T), bool)
        y[rng.choice(len(T), 40, replace=False)] += 0.05
        kept[2000:2100] = False
        found = noise_in(block(y[kept], T[kept]))
        assert found is not None
        assert found == pytest.approx(1e-3, rel=0.1)

    def test_stated_noise_is_used_as_stated(self, rng: np.random.Generator) -> None:
        assert noise_in(dataclasses.replace(block(MOTION + coloured(rng, 0.0)), stated=True)) is None


class TestOutliers:
    def test_planted_outliers_are_marked_and_no_others(self, rng: np.random.Generator) -> None:
        for _ in range(10):
            y, at = MOTION + coloured(rng, 0.0), np.sort(rng.choice(np.arange(3, 2997), 20, replace=False))
            y[at] += 0.03 * rng.choice([-1, 1], 20)
            np.testing.assert_array_equal(np.flatnonzero(outliers_in(T, y, MOTION)), at)

    def test_a_jump_of_the_motion_itself_is_none_if_the_model_predicts_it(self, rng: np.random.Generator) -> None:
        hit = MOTION + np.where(T > 7, 0.2 * np.sin(2 * np.pi * 30 * (T - 7)) * np.exp(-30 * abs(T - 7)), 0.0)
        y = hit + coloured(rng, 0.0)
        assert outliers_in(T, y, MOTION).any()
        assert not outliers_in(T, y, hit).any()

    def test_the_ends_of_a_gap_are_no_outliers(self, rng: np.random.Generator) -> None:
        y, kept = MOTION + coloured(rng, 0.0), (T < 1.0) | (T > 1.21)
        assert not outliers_in(T[kept], y[kept], np.zeros(int(kept.sum()))).any()


def test_a_sine_has_its_amplitude_in_the_spectrum_also_at_uneven_times(rng: np.random.Generator) -> None:
    for t in (T, T + 1e-4 * rng.standard_normal(len(T))):
        f, size = amplitudes(t, 5.0 + 0.2 * np.sin(2 * np.pi * 4.0 * t))
        assert f[size.argmax()] == pytest.approx(4.0, abs=0.04)
        assert size.max() == pytest.approx(0.2, rel=0.02)


def table(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


class TestCheckPage:
    @pytest.fixture(scope="class")
    @staticmethod
    def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
        """A checked problem: the film of a strip with noise, twelve outliers, a gap, an uneven interval."""
        folder, rng = tmp_path_factory.mktemp("shown"), np.random.default_rng(3)
        scene = strip().varied({"run.duration": 4.0, "run.sample": 0.002})
        run = fl.simulate(scene.varied({"tip.mass": 0.43}))
        z = run.tip[:, 2] + 2e-4 * rng.standard_normal(len(run.t))
        kept = (run.t < 2.9) | (run.t > 3.101)
        z[100:1300:100] += 0.02
        t = run.t + np.where(np.arange(len(run.t)) == 1300, 5e-4, 0.0)
        data = np.column_stack([t, 1e3 * z])[kept]
        np.savetxt(folder / "film.csv", data, delimiter=",", header="t [s],tip z [mm]", comments="")
        scene.save(folder / "arm.toml")
        (folder / "problem.toml").write_text(
            'scene = "arm.toml"\n[[parameter]]\npath = "tip.mass"\n[[run]]\nname = "film"\nfile = "film.csv"\n'
            "[[modes]]\nhertz = [2.0]\ndeviation = [0.1]\n", "utf-8",
        )  # fmt: skip
        main(["fit", str(folder / "problem.toml"), "--check", "--out", str(folder / "page")])
        return folder

    def test_the_page_counts_gaps_uneven_intervals_and_outliers(self, folder: Path) -> None:
        (one,) = table(folder / "page", "columns")
        assert [one[key] for key in ("gaps", "uneven intervals", "outliers")] == ["1", "2", "12"]
        assert float(one["noise"]) == pytest.approx(2e-4, rel=0.1)
        assert one["noise from"] == "data"
        assert float(one["rate [Hz]"]) == pytest.approx(500)

    def test_data_come_first_with_the_prediction_of_the_scene(self, folder: Path) -> None:
        text = (folder / "page" / "index.html").read_text("utf-8")
        assert text.index('id="data"') < text.index('id="spectra"') < text.index('id="identifiability"')
        rows = table(folder / "page", "data_1")
        run = fl.simulate(fl.load_scene(folder / "arm.toml").varied({"run.relative_tolerance": 1e-8}))
        predicted = np.interp([float(row["t [s] of tip z [m]"]) for row in rows], run.t, run.tip[:, 2])
        np.testing.assert_allclose([float(row["predicted tip z [m]"]) for row in rows], predicted, rtol=0, atol=2e-5)
        off = [float(row["predicted tip z [m]"]) - float(row["measured tip z [m]"]) for row in rows]
        left = [float(row["residual tip z [m]"]) for row in table(folder / "page", "start_1")]
        np.testing.assert_allclose(left, off, rtol=0, atol=1e-12)

    def test_modes_are_listed_and_the_peak_of_the_prediction_is_the_first(self, folder: Path) -> None:
        first = float(table(folder / "page", "modes")[0]["frequency [Hz]"])
        rows = table(folder / "page", "spectra_1")
        size = [float(row["predicted tip z [m]"]) for row in rows]
        assert float(rows[int(np.argmax(size))]["f of tip z [m] [Hz]"]) == pytest.approx(first, abs=0.26)

    def test_single_measurements_are_listed_with_their_prediction(self, folder: Path) -> None:
        (one,) = table(folder / "page", "single")
        assert float(one["residual in standard deviations"]) == pytest.approx((float(one["predicted"]) - 2.0) / 0.1)

    def test_the_check_takes_the_noise_of_the_data_and_reports_it(self, folder: Path) -> None:
        problem = fl.fits.load_fit(folder / "problem.toml")
        found = fl.fits.check_fit(problem)
        (note,) = [one for one in found.notes if one.id == "estimated-noise"]
        reviewed("estimated-noise", note)
        text = (folder / "problem.toml").read_text("utf-8")
        stated = folder / "stated.toml"
        stated.write_text(text.replace("[[modes]]", "noise = { 'tip z [mm]' = 0.2 }\n[[modes]]"), "utf-8")
        assert found.expected == pytest.approx(fl.fits.check_fit(fl.fits.load_fit(stated)).expected, rel=0.1)
