"""Numbers, texts and verdicts on the page of a fit, for known columns and intervals."""

import csv
import dataclasses
import math
import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import Diagnostic
from flexlink.identification import page, remarks, solve
from flexlink.identification.block import Block, noise_in, outliers_in, white_noise
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data_page import amplitudes
from flexlink.identification.fitted import Estimate, Fitted, FittedColumn
from flexlink.identification.identifiability import Check, Direction
from flexlink.identification.likelihood import Likelihood, row_of
from flexlink.pages.tables import Table
from tests.conftest import ROOT
from tests.identification.test_fit_first_look import strip
from tests.identification.test_fit_numbers import FILM, MASS, PROBLEM, SCENE, YOUNG, film
from tests.support.fits import write_csv
from tests.support.words import reviewed

Array = np.ndarray


def column(source: str, use: str, measured: Array, before: Array, after: Array, **more: Any) -> FittedColumn:
    t = more.pop("t", 0.01 * np.arange(len(measured)))
    usual = {
        "linear": None, "gain": 1.0, "bias": 0.0, "noise": 0.1, "stated": True, "times_noise": 1.0, "whiteness": 0.5,
    }  # fmt: skip
    return FittedColumn(source, FILM, use, t, measured, before, after, **(usual | more))  # type: ignore[arg-type]


HELD = Check((MASS, YOUNG), np.array([9.0, 4.0]), (), np.array([0.1, 0.2]))
NUMBERS = (
    Estimate(MASS, MASS, 1.0, 1.1, 1.0, 1.2, 0.051, unit="kg"),
    Estimate(YOUNG, YOUNG, 2e11, 1.9e11, 1.5e11, 2.6e11, 2.5e10, unit="Pa", profile=(1.4e11, math.nan)),
)


def fitted_with(*columns: FittedColumn, check: Check = HELD, numbers: tuple[Estimate, ...] = NUMBERS) -> Fitted:
    return Fitted(PROBLEM, SCENE, numbers, np.eye(2), check, columns, (), 1, (Diagnostic("mind this", "x"),), np.eye(2))


def lines(tables: Sequence[Table], name: str) -> list[dict[str, Any]]:
    (one,) = [one for one in tables if one.name == name]
    return [dict(zip(one.heads, line, strict=True)) for line in one.lines]


class TestPage:
    Y = np.sin(np.arange(200) / 9.0)

    def test_estimates_show_their_interval_in_percent_and_their_profile(self) -> None:
        mass, young = lines(page._numbers(fitted_with(column("a", "fit", self.Y, self.Y, self.Y))).tables, "numbers")
        assert [mass[head] for head in ("unit", "before", "fitted", "from", "to")] == ["kg", 1.0, 1.1, 1.0, 1.2]
        assert mass["± of 95 % [%]"] == pytest.approx(100 * 0.1 / 1.1)
        assert (young["standard deviation"], young["profile from"], young["profile to"]) == (2.5e10, 1.4e11, None)

    @pytest.mark.parametrize(
        ("value", "low", "high", "text"),
        [
            (1.1, 1.0, 1.2, "1.10 ± 0.10 kg"),
            (1.9e11, 1.8e11, 2.0e11, "(1.90 ± 0.10) × 10¹¹ kg"),
            (1.9, 1.5, 2.9, "1.9 (1.5 … 2.9) kg"),
            (1.9, -math.inf, math.inf, "1.9 kg"),
            (1.9, 1.5, math.inf, "1.9 kg"),
            (43.21, 43.18, 43.24, "43.210 ± 0.030 kg"),
        ],
    )
    def test_an_estimate_is_printed_with_two_digits_of_its_interval_or_both_ends(self, value, low, high, text) -> None:
        one = Estimate(MASS, MASS, 1.0, value, low, high, 0.1, unit="kg")
        assert page._with_interval(one).replace("\xa0", " ") == text
        assert page._confidence(one).startswith("95 %") == (math.isfinite(low) and math.isfinite(high))

    def test_differences_are_rms_values_and_fractions_of_the_signal(self) -> None:
        far, near = self.Y + 0.2, self.Y * 0.9
        one = column("a", "fit", self.Y, far, near, linear=self.Y + 0.01)
        (line,) = lines(page._data(fitted_with(one)).tables, "columns")
        spread = math.sqrt(float(((self.Y - self.Y.mean()) ** 2).mean()))
        left = 0.1 * math.sqrt(float((self.Y**2).mean()))
        assert [line[f"RMS {w}"] for w in ("before", "after", "free linear")] == pytest.approx([0.2, left, 0.01])
        assert [line[f"fit {w} [%]"] for w in ("before", "after", "free linear")] == pytest.approx(
            [100 * (1 - off / spread) for off in (0.2, left, 0.01)]
        )

    @pytest.mark.parametrize(("after", "state"), [(0.1, "pass"), (0.3, "fail")])
    def test_the_worst_check_column_decides_the_verdict_of_a_fit(self, after: float, state: str) -> None:
        fitted = column("fitted", "fit", self.Y, self.Y + 9.0, self.Y)
        kept = column("kept", "check", self.Y, self.Y + 0.2, self.Y + after)
        quiet = column("quiet", "check", self.Y, self.Y, self.Y)
        verdict = page._verdicts(fitted_with(fitted, quiet, kept))[1]
        assert (verdict.about, verdict.state) == ("Fit", state)
        text = verdict.text.replace("\xa0", " ")
        assert FILM in text and "kept" in text and re.findall(r"([\d.]+) m ", text) == ["0.2", str(after)]
        reviewed("fit page: verdict of a fit", text)

    def test_a_fit_fails_if_a_direction_is_lost_or_a_parameter_is_at_its_bound(self) -> None:
        one = column("a", "fit", self.Y, self.Y, self.Y)
        lost = HELD._replace(directions=(Direction((MASS,), (1.0,), math.inf, True),))
        bound = (dataclasses.replace(NUMBERS[0], at_bound=True), NUMBERS[1])
        for fitted, state in (
            (fitted_with(one), "pass"),
            (fitted_with(one, check=lost), "fail"),
            (fitted_with(one, numbers=bound), "fail"),
        ):
            assert page._verdicts(fitted)[0].state == state
            assert fitted.passed == (state == "pass")

    @pytest.mark.parametrize(
        ("ours", "theirs", "state"), [(95.0, 95.5, "pass"), (90.0, 95.0, "doubt"), (20.0, 40.0, "info")]
    )
    def test_the_model_is_complete_if_it_explains_as_much_as_a_free_model(self, ours, theirs, state) -> None:
        off = [self.Y.std() * (1 - share / 100) for share in (ours, theirs)]
        one = column("a", "fit", self.Y, self.Y + 9.0, self.Y + off[0], linear=self.Y + off[1])
        verdict = page._verdicts(fitted_with(one))[2]
        assert verdict.state == state
        assert re.findall(r"([\d.]+) %", verdict.text.replace("\xa0", " "))[:2] == [f"{ours:g}", f"{theirs:g}"]
        reviewed("fit page: verdict of a model", verdict.text)

    def test_columns_with_autocorrelated_residuals_are_counted(self) -> None:
        several = [
            column(name, "fit", self.Y, self.Y, self.Y + 0.1, whiteness=p)
            for name, p in zip("abc", (1e-4, 0.02, 0.5), strict=True)
        ]
        part = page._residuals(fitted_with(*several))
        assert "1 of 3 " in part.sentences[0]
        reviewed("fit page: autocorrelated residuals", part.sentences[0])
        assert [line["p of whiteness"] for line in lines(part.tables, "left")] == [1e-4, 0.02, 0.5]
        assert [line["RMS"] for line in lines(part.tables, "left")] == pytest.approx([0.1] * 3)

    def test_the_spectrum_of_white_noise_is_flat_at_two_variances_over_the_rate(self) -> None:
        """The integral of the one-sided spectrum up to half the rate is σ²; means of 2000 lines are accurate to 3 %."""
        t = 0.01 * np.arange(4001)
        e = 0.3 * np.random.default_rng(13).standard_normal(4001)
        f, root = page._spectrum(t, e)
        assert f[0] == pytest.approx(100 / 4001)
        assert np.mean(root**2) == pytest.approx(2 * 0.3**2 / 100, rel=0.1)
        f, root = page._spectrum(t, np.sin(2 * np.pi * 12.5 * t))
        assert f[root.argmax()] == pytest.approx(12.5, abs=0.03)


class TestRemarks:
    def of(
        self, one: Estimate, by: Coordinate | None = None, columns: Sequence[FittedColumn] = (), found: Any = (None,)
    ) -> tuple[str, ...]:
        usual = Coordinate(one.path, "", one.start, True, 1.0, (1e-3, 1e3), None)
        return remarks.warnings([one], [by or usual], HELD, found, columns, [])

    def test_an_estimate_more_than_ten_times_its_initial_guess_has_a_warning(self) -> None:
        for value, warned in ((9.0, False), (11.0, True), (1 / 9, False), (1 / 11, True)):
            found = self.of(dataclasses.replace(NUMBERS[0], value=value))
            moved = [text for text in found if " 1 " in text and f" {value:.4g}" in text]
            assert len(moved) == warned
            for text in moved:
                reviewed("far-from-initial-guess", text)

    def test_other_guesses_are_not_suggested_if_all_agree_or_the_residual_is_noise(self) -> None:
        far, y = dataclasses.replace(NUMBERS[0], value=11.0), np.zeros(50)
        agreeing, other = SimpleNamespace(x=np.array([1.0])), SimpleNamespace(x=np.array([2.0]))
        quiet, loud = (column("a", "fit", y, y, y + 0.1, times_noise=times) for times in (1.0, 3.0))
        for settled, more in (
            (False, {"found": (agreeing, other)}), (True, {"found": (agreeing, agreeing)}),
            (False, {"columns": (quiet, loud)}), (True, {"columns": (quiet,)}),
        ):  # fmt: skip
            (text,) = (text for text in self.of(far, **more) if text.id == "far-from-initial-guess")
            assert ("--starts" in text) != settled
            reviewed("far-from-initial-guess", text)

    def test_an_estimate_three_deviations_from_its_prior_has_a_warning(self) -> None:
        known = Coordinate(MASS, "", 1.0, True, 1.0, (1e-3, 1e3), (1.0, 0.02))
        assert not self.of(dataclasses.replace(NUMBERS[0], value=1.05), known)
        for value in (0.9, 1.1):
            found = self.of(dataclasses.replace(NUMBERS[0], value=value), known)
            (text,) = (text for text in found if "1 ± 0.02" in text)
            assert MASS in text and " 5 " in text
            reviewed("far-from-prior", text)

    def test_columns_with_twice_the_noise_or_twice_the_fitted_residual_have_a_warning(self) -> None:
        y = np.zeros(50)
        for times, warned in ((1.8, False), (2.2, True)):
            loud = column("a", "fit", y, y, y + 0.1, times_noise=times)
            noisy = [text for text in self.of(NUMBERS[0], columns=[loud]) if text.startswith(f"a, {FILM}: ")]
            kept = column("b", "check", y, y, y + 0.1 * times)
            fitted = [column(name, "fit", y, y, y + off) for name, off in (("a", 0.1), ("c", 0.03))]
            found = self.of(NUMBERS[0], columns=[*fitted, kept])
            worse = [text for text in found if text.startswith(f"b, {FILM}: ")]
            assert len(noisy) == len(worse) == warned
            for id, text in (*(("residual-above-noise", text) for text in noisy),
                             *(("worse-than-fitted-runs", text) for text in worse)):  # fmt: skip
                assert f" {times:.2g} " in text
                reviewed(id, text)

    def test_initial_guesses_that_end_elsewhere_are_counted(self) -> None:
        ends = [solve.Found(np.array([x]), 1.0, []) for x in (1.0, 1.00001, 1.5)]
        text = self.of(NUMBERS[0], found=ends)[-1]
        assert text.startswith("2 of 3 ")
        reviewed("several-minima", text)

    def test_notes_list_data_and_assumptions(self) -> None:
        y = np.sin(np.arange(40.0))
        uneven = film(y, 1.0, name="uneven")
        gap = np.append(np.arange(39), 40) * 0.01
        uneven.blocks = (dataclasses.replace(uneven.blocks[0], t=gap),)
        found = remarks.notes([film(y, 1.0), film(y, 1.0, name="kept", use="check", stated=True), uneven])
        read, noise, kept, _, spacing, _ = found
        assert read.startswith(f"film: {FILM}; 40 ") and "100 Hz" in read
        assert noise.startswith("film: ") and FILM in noise and "1 % " in noise
        assert kept.startswith("kept (check): ")
        assert spacing.startswith("uneven: ") and FILM in spacing and "1 % " not in spacing
        for id, text in (
            ("data-read", read), ("assumed-noise", noise), ("data-read", kept), ("uneven-samples", spacing),
        ):  # fmt: skip
            reviewed(id, text)

    def test_measured_and_simulated_ranges_a_hundred_times_apart_have_a_warning(self) -> None:
        y = np.sin(np.arange(40.0))
        for factor, warned in ((50.0, False), (200.0, True), (1 / 200, True)):
            measured = film(factor * y, 1.0)
            at = Likelihood([], np.zeros(0), [measured], [[row_of(measured.blocks[0], y)]])
            assert len(remarks.ranges_apart(at)) == warned


ESTIMATE = Estimate("tip.mass", "tip.mass", 1.0, 1.1, 0.9, 1.3, 0.1, unit="kg", log=True, between=(0.001, 1000.0))


@pytest.mark.parametrize(
    ("change", "id"),
    [
        ({}, ""),
        ({"low": 0.3, "high": 2.9}, ""),
        ({"low": 0.3, "high": 3.1}, "wide-interval"),
        ({"low": -1.0, "high": 30.0, "log": False, "between": (-math.inf, math.inf)}, ""),
        ({"low": 0.9, "high": 1.3, "between": (0.9, 2.0)}, "interval-at-bound"),
        ({"low": 0.9, "high": 1.3, "between": (0.5, 1.2)}, "interval-at-bound"),
        ({"at_bound": True}, "estimate-at-bound"),
        ({"low": -math.inf, "high": math.inf}, "unbounded-interval"),
        ({"low": -math.inf}, "unbounded-interval"),
        ({"high": math.inf}, "unbounded-interval"),
        ({"prior": (1.0, 0.15)}, ""),
        ({"prior": (1.0, 0.14)}, "prior-dominated"),
    ],
)
def test_the_verdict_of_a_parameter_follows_from_its_interval(change: dict[str, Any], id: str) -> None:
    estimate = dataclasses.replace(ESTIMATE, **change)
    assert (estimate.doubt.id if estimate.doubt is not None else "") == id
    assert estimate.verdict.startswith("not identifiable: " if id else "identifiable")
    assert estimate.determined == (id in ("", "prior-dominated"))


def test_the_guide_states_every_rule_of_the_verdict() -> None:
    guide = " ".join((ROOT / "docs" / "howto" / "fit.md").read_text().split())
    for words in (
        "interval is unbounded", "an end of the interval, is at a bound", "spans more than a factor of 10",
        "determines it more than the data do",
    ):  # fmt: skip
        assert words in guide, words


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

    @pytest.mark.parametrize(("edge", "white"), [(0.39, True), (0.62, False), (0.78, False)])
    def test_noise_is_white_if_it_is_above_two_fifths_of_the_nyquist_frequency(
        self, rng: np.random.Generator, edge: float, white: bool
    ) -> None:
        """Below the edge, its power is four times as large."""
        lines = np.fft.rfft(coloured(rng, 0.0))
        lines[: int(edge * len(lines))] *= 2.0
        found = white_noise(np.fft.irfft(lines))
        assert found == pytest.approx(1e-3, rel=0.1) if white else found is None

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
        write_csv(folder / "film.csv", {"t [s]": t[kept], "tip z [mm]": 1e3 * z[kept]})
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

    def test_the_page_contains_every_letter_and_marker_of_its_pictures(self, folder: Path) -> None:
        text = (folder / "page" / "index.html").read_text("utf-8")
        used = set(re.findall(r'<use href="#([^"]+)"', text))
        assert used and not used - set(re.findall(r' id="([^"]+)"', text))

    def test_modes_are_listed_and_the_peak_of_the_prediction_is_the_first(self, folder: Path) -> None:
        first = float(table(folder / "page", "modes")[0]["frequency [Hz]"])
        rows = table(folder / "page", "spectra_1")
        size = [float(row["predicted tip z [m]"]) for row in rows]
        assert float(rows[int(np.argmax(size))]["f of tip z [m] [Hz]"]) == pytest.approx(first, abs=0.26)

    def test_single_measurements_are_listed_with_their_prediction(self, folder: Path) -> None:
        (one,) = table(folder / "page", "single")
        assert float(one["residual in standard deviations"]) == pytest.approx((float(one["predicted"]) - 2.0) / 0.1)

    def test_the_check_takes_the_noise_of_the_data_and_reports_it(self, folder: Path) -> None:
        problem = fl.fits.FitProblem.load(folder / "problem.toml")
        found = fl.fits.check_fit(problem)
        (note,) = [one for one in found.notes if one.id == "estimated-noise"]
        reviewed("estimated-noise", note)
        text = (folder / "problem.toml").read_text("utf-8")
        stated = folder / "stated.toml"
        stated.write_text(text.replace("[[modes]]", "noise = { 'tip z [mm]' = 0.2 }\n[[modes]]"), "utf-8")
        assert found.expected == pytest.approx(fl.fits.check_fit(fl.fits.FitProblem.load(stated)).expected, rel=0.1)
