"""What the page of a fit says, in numbers, texts and verdicts, of columns and intervals that are known."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from test_fit_numbers import FILM, MASS, PROBLEM, SCENE, YOUNG, film

from flexlink.identification import page, remarks, solve
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.fitted import Estimate, Fitted, FittedColumn
from flexlink.identification.identifiability import Check, Direction
from flexlink.pages.tables import Table

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
    return Fitted(PROBLEM, SCENE, numbers, np.eye(2), check, columns, (), 1, ("mind this",))


def lines(tables: Sequence[Table], name: str) -> list[dict[str, Any]]:
    (one,) = [one for one in tables if one.name == name]
    return [dict(zip(one.heads, line, strict=True)) for line in one.lines]


class TestPage:
    Y = np.sin(np.arange(200) / 9.0)

    def test_numbers_have_their_ends_in_percent_and_their_profile(self) -> None:
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
    def test_a_number_is_told_to_two_digits_of_its_interval_or_with_both_ends(
        self, value: float, low: float, high: float, text: str
    ) -> None:
        assert page._told(Estimate(MASS, MASS, 1.0, value, low, high, 0.1, unit="kg")).replace("\xa0", " ") == text

    def test_differences_are_root_mean_squares_and_shares_of_the_signal(self) -> None:
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
    def test_a_fit_is_judged_by_the_worst_column_that_was_kept(self, after: float, state: str) -> None:
        fitted = column("fitted", "fit", self.Y, self.Y + 9.0, self.Y)
        kept = column("kept", "check", self.Y, self.Y + 0.2, self.Y + after)
        quiet = column("quiet", "check", self.Y, self.Y, self.Y)
        verdict = page._verdicts(fitted_with(fitted, quiet, kept))[1]
        assert (verdict.about, verdict.state) == ("Fit", state)
        assert (
            verdict.text.replace("\xa0", " ")
            == f"{FILM} of kept: RMS difference 0.2 m before, {after} m after (kept to check)."
        )

    def test_numbers_are_held_unless_a_direction_is_lost_or_one_is_at_its_bound(self) -> None:
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
    def test_the_scene_is_complete_where_it_explains_as_much_as_a_free_model(
        self, ours: float, theirs: float, state: str
    ) -> None:
        off = [self.Y.std() * (1 - share / 100) for share in (ours, theirs)]
        one = column("a", "fit", self.Y, self.Y + 9.0, self.Y + off[0], linear=self.Y + off[1])
        verdict = page._verdicts(fitted_with(one))[2]
        assert verdict.state == state
        assert f"explains {ours:g} % of the signal" in verdict.text
        assert f"{theirs:g} %:" in verdict.text

    def test_columns_that_leave_more_than_white_noise_are_counted(self) -> None:
        several = [
            column(name, "fit", self.Y, self.Y, self.Y + 0.1, whiteness=p)
            for name, p in zip("abc", (1e-4, 0.02, 0.5), strict=True)
        ]
        part = page._left(fitted_with(*several))
        assert part.sentences[0].startswith("1 of 3 columns leave more")
        assert [line["p of whiteness"] for line in lines(part.tables, "left")] == [1e-4, 0.02, 0.5]
        assert [line["RMS"] for line in lines(part.tables, "left")] == pytest.approx([0.1] * 3)

    def test_the_spectrum_of_white_noise_is_flat_at_two_variances_over_the_rate(self) -> None:
        """One-sided: σ² is the integral from 0 to half the rate; 2000 lines are known to 3 % together."""
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

    def test_a_number_that_moved_by_more_than_ten_is_told(self) -> None:
        for value, is_told in ((9.0, False), (11.0, True), (1 / 9, False), (1 / 11, True)):
            said = self.of(dataclasses.replace(NUMBERS[0], value=value))
            assert any("went from 1 to" in s for s in said) == is_told

    def test_a_number_three_deviations_from_its_prior_is_told_with_how_many(self) -> None:
        known = Coordinate(MASS, "", 1.0, True, 1.0, (1e-3, 1e3), (1.0, 0.02))
        assert not self.of(dataclasses.replace(NUMBERS[0], value=1.05), known)
        assert "5 standard deviations from its prior, 1 ± 0.02" in self.of(NUMBERS[0], known)[0]

    def test_columns_that_leave_twice_the_noise_or_twice_what_the_fitted_ones_do_are_told(self) -> None:
        y = np.zeros(50)
        for times, is_told in ((1.8, False), (2.2, True)):
            loud = column("a", "fit", y, y, y + 0.1, times_noise=times)
            assert any(f"{times:.2g} times the noise" in s for s in self.of(NUMBERS[0], columns=[loud])) == is_told
            kept = column("b", "check", y, y, y + 0.1 * times)
            fitted = [column(name, "fit", y, y, y + off) for name, off in (("a", 0.1), ("c", 0.03))]
            said = self.of(NUMBERS[0], columns=[*fitted, kept])
            assert any(f"{times:.2g} times that of the fitted runs" in s for s in said) == is_told

    def test_starts_that_end_elsewhere_are_counted(self) -> None:
        ends = [solve.Found(np.array([x]), 1.0, []) for x in (1.0, 1.00001, 1.5)]
        assert "2 of 3 starts led to the best answer" in self.of(NUMBERS[0], found=ends)[-1]

    def test_what_is_read_and_assumed_is_noted(self) -> None:
        y = np.sin(np.arange(40.0))
        uneven = film(y, 1.0, name="uneven")
        gap = np.append(np.arange(39), 40) * 0.01
        uneven.blocks = (dataclasses.replace(uneven.blocks[0], t=gap),)
        said = remarks.notes([film(y, 1.0), film(y, 1.0, name="kept", use="check", stated=True), uneven])
        assert said[0].startswith(f"film: {FILM}; 40 samples at 100 Hz")
        assert "noise of tip x [m] is not stated; 1 % of the range" in said[1]
        assert said[2].startswith("kept (check): ")
        assert "not evenly spaced" in said[4]
        assert len(said) == 6

    def test_ranges_a_hundred_times_apart_are_told(self) -> None:
        y = np.sin(np.arange(40.0))
        for factor, is_told in ((50.0, False), (200.0, True), (1 / 200, True)):
            said = remarks.ranges_apart([film(factor * y, 1.0)], [[y]])
            assert bool(said) == is_told
