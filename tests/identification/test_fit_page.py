"""Numbers, texts and verdicts on the page of a fit, for known columns and intervals."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexlink.identification import page, remarks, solve
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.estimate import Estimate
from flexlink.identification.fitted import Fitted, FittedColumn
from flexlink.identification.identifiability import Check, Direction
from flexlink.identification.likelihood import Likelihood, row_of
from flexlink.pages.tables import Table
from tests.identification.test_fit_numbers import FILM, MASS, PROBLEM, SCENE, YOUNG, film
from tests.support.words import reviewed

Array = np.ndarray


def column(source: str, use: str, measured: Array, before: Array, after: Array, **more: Any) -> FittedColumn:
    t = more.pop("t", 0.01 * np.arange(len(measured)))
    usual = {
        "linear": None,
        "gain": 1.0,
        "bias": 0.0,
        "noise": 0.1,
        "stated": True,
        "times_noise": 1.0,
        "whiteness": 0.5,
    }
    return FittedColumn(source, FILM, use, t, measured, before, after, **(usual | more))  # type: ignore[arg-type]


HELD = Check((MASS, YOUNG), np.array([9.0, 4.0]), (), np.array([0.1, 0.2]))
NUMBERS = (
    Estimate(MASS, MASS, 1.0, 1.1, 1.0, 1.2, 0.051, unit="kg"),
    Estimate(YOUNG, YOUNG, 2e11, 1.9e11, 1.5e11, 2.6e11, 2.5e10, unit="Pa", profile=(1.4e11, math.nan)),
)


def fitted_with(*columns: FittedColumn, check: Check = HELD, numbers: tuple[Estimate, ...] = NUMBERS) -> Fitted:
    return Fitted(PROBLEM, SCENE, numbers, np.eye(2), check, columns, (), 1, ("mind this",), np.eye(2))


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
            (43.21, 43.18, 43.24, "43.210 ± 0.030 kg"),
        ],
    )
    def test_an_estimate_is_printed_with_two_digits_of_its_interval_or_both_ends(
        self, value: float, low: float, high: float, text: str
    ) -> None:
        assert (
            page._with_interval(Estimate(MASS, MASS, 1.0, value, low, high, 0.1, unit="kg")).replace("\xa0", " ")
            == text
        )

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
    def test_the_model_is_complete_if_it_explains_as_much_as_a_free_model(
        self, ours: float, theirs: float, state: str
    ) -> None:
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
        (text,) = (text for text in self.of(NUMBERS[0], known) if "1 ± 0.02" in text)
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
