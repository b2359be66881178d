"""Numbers of a fit and its page agree with textbooks, random draws of a linear toy model, and direct sums."""

import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import quad
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import t as student

import flexlink as fl
from flexlink.identification import columns as kept_columns
from flexlink.identification import fit as fitting
from flexlink.identification import interval, page, solve
from flexlink.identification.block import SHARE, Block, Colour, colour_of, whiteness
from flexlink.identification.columns import _given, _modes, _poles, _shapes
from flexlink.identification.coordinates import Coordinate, coordinate_of, coordinates_of, prior_rows
from flexlink.identification.data import (
    Source,
    _noise_of_sensors,
    _with_noise,
    as_long,
    at_times,
    doubts_of_times,
    in_periods,
    recorded,
    sagged,
)
from flexlink.identification.fitted import Fitted
from flexlink.identification.identifiability import checked
from flexlink.identification.interval import Spread, estimates, spread_of
from flexlink.identification.likelihood import LOSSES, Likelihood, row_of
from flexlink.identification.page import identifiability
from flexlink.identification.signals import Signals
from flexlink.motion.slopes_of_runs import CENTRAL, CENTRAL_4, FORWARD, Places, mirrored, weights
from tests.conftest import ROOT
from tests.support.fits import problem
from tests.support.words import reviewed

Array = np.ndarray
E, MASS, YOUNG = 2e11, "tip.mass", "material.steel.young"
PATHS = (MASS, YOUNG, "material.steel.density", "section.bar.height")
BAR = fl.Link(name="bar", length=1.0, flex="z", segments=3, material="steel", section="bar")
SCENE = fl.Scene(
    name="toy", initial=fl.InitialState(joint_deg=(0.0,)), run=fl.RunSettings(duration=1.0, sample=0.01, step=1e-3),
    arm=fl.Arm(links=(BAR,), materials={"steel": fl.Material(young=E, density=7800.0)}, tip=fl.RigidBody(mass=1.0),
               sections={"bar": fl.Section(shape="rectangle", height=0.01, width=0.01)}),
)  # fmt: skip
START = dict(zip(PATHS, (1.0, E, 7800.0, 0.01), strict=True))
TRUE = dict(zip(PATHS, (1.1, 1.9e11, 7900.0, 0.011), strict=True))
FILM = "tip x [m]"


def of_logs(by: dict[str, float], Φ: Array) -> Array:
    """Data of the toy model, linear in the logarithms of parameters relative to their start values."""
    return np.asarray(Φ @ [by[path] - math.log(START[path]) for path in PATHS[: Φ.shape[1]]])


def clean(Φ: Array) -> Array:
    """Noise-free data for the true parameters."""
    return of_logs({path: math.log(value) for path, value in TRUE.items()}, Φ)


class Toy:
    """Replacement of `Signals`: every column of a run is linear in the parameters, or follows a given law."""

    Φ, law, runs = np.zeros((0, 2)), staticmethod(of_logs), 0

    def __init__(self, sources: Sequence[Source], coordinates: Sequence[Coordinate], _: Any = None) -> None:
        self.sources, self.coordinates = sources, coordinates

    def model(self, x: Array) -> list[list[Array]]:
        by, found = {c.path: float(at) for c, at in zip(self.coordinates, x, strict=True)}, []
        for one in self.sources:
            others = [path for path in PATHS[: self.Φ.shape[1]] if path not in by]  # check runs use all samples
            every = by | {path: math.log(cast("float", one.scene.values_at(path)[0])) for path in others}
            found.append([np.asarray(type(self).law(every, self.Φ[: len(block.y)])) for block in one.blocks])
        return found

    def slopes(self, x: Array, *_: object) -> list[list[Array]]:
        if type(self).law is of_logs:
            return [[self.Φ[: len(block.y), : len(x)] for block in one.blocks] for one in self.sources]
        beside = [[self.model(x + h), self.model(x - h)] for h in 1e-4 * np.eye(len(x))]
        return [
            [np.column_stack([(up[k][b] - down[k][b]) / 2e-4 for up, down in beside]) for b in range(len(one.blocks))]
            for k, one in enumerate(self.sources)
        ]

    def scene(self, number: int, x: Array) -> fl.Scene:
        return self.sources[number].scene

    def ahead(self, _: object) -> None:
        """Do nothing: the toy model is fast."""

    def around(self, *_: object) -> tuple[()]:
        return ()


class Film(Source):
    def first(self, part: float) -> "Film":
        k = max(10, int(part * len(self.blocks[0].y)))
        cut = tuple(dataclasses.replace(b, y=b.y[:k], σ=b.σ[:k], t=np.asarray(b.t)[:k]) for b in self.blocks)
        return dataclasses.replace(self, blocks=cut)


def film(y: Array, noise: float, *, stated: bool = False, **how: Any) -> "Film":
    block = Block(FILM, y, np.full(len(y), noise), stated, 0.01 * np.arange(len(y)), None, how.pop("gain", False))
    return Film(how.pop("name", "film"), how.pop("use", "fit"), SCENE, (block,), 100.0)


TAPPED = fl.fits.FitModes(hertz=(1.0,), deviation=(1.0,))  # required; the toy model ignores it
PROBLEM = problem(SCENE, (MASS, YOUNG), modes=(TAPPED,))


@pytest.fixture
def fit_of(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Fitted]:
    """Fit films with the toy model, and compare the columns of check runs."""
    for module in (fitting, solve, kept_columns):
        monkeypatch.setattr(module, "Signals", Toy)

    def fitted(
        Φ: Array, *films: Film, law: Callable[..., Array] = of_logs, problem: Any = PROBLEM, **how: Any
    ) -> Fitted:
        monkeypatch.setattr(Toy, "Φ", Φ)
        monkeypatch.setattr(Toy, "law", staticmethod(law))
        monkeypatch.setattr(fitting, "sources_of", lambda _, use: [one for one in films if one.use == use])
        return fl.fit(problem, grid="ignore", **how)

    return fitted


def noise(rng: np.random.Generator, n: int, a: Sequence[float]) -> Array:
    return np.asarray(lfilter([1.0], a, rng.standard_normal(n + 300))[300:])


class TestCoverage:
    @pytest.mark.slow
    @pytest.mark.parametrize("a", [(1.0,), (1.0, -1.6, 0.9)], ids=["white", "resonant"])
    def test_ninety_five_percent_of_the_intervals_contain_the_true_value(self, fit_of, a) -> None:
        """For 400 intervals with p = 0.95 the standard error is √(p (1 − p) / 400) = 1.1 %; the limits are ± 2.8 σ."""
        rng, n, draws, every = np.random.default_rng(6), 60, 100, problem(SCENE, PATHS, modes=(TAPPED,))
        Φ = rng.standard_normal((n, 4))
        found = [fit_of(Φ, film(clean(Φ) + 0.1 * noise(rng, n, a), 0.05), problem=every) for _ in range(draws)]
        inside = [one.low < TRUE[one.path] < one.high for fitted in found for one in fitted.numbers]
        assert len(inside) == 4 * draws
        assert 0.92 <= np.mean(inside) <= 0.98

    def test_intervals_from_few_samples_use_students_t_with_reduced_degrees_of_freedom(self) -> None:
        rng = np.random.default_rng(0)
        for n, sought in ((12, 4), (30, 1), (30, 6)):
            part = ([rng.standard_normal(n)], [rng.standard_normal((n, sought))], True)
            wide = spread_of([part], np.zeros((0, sought))).wide
            assert wide == pytest.approx(student.ppf(0.975, n - sought), rel=1e-12)

    def test_autocorrelated_samples_count_as_fewer_independent_samples(self) -> None:
        """The variance of noise with ρ_k = a^|k| is as uncertain as for n (1 − a²)/(1 + a²) independent samples."""
        e, J = noise(np.random.default_rng(2), 200, (1.0, -0.9)), np.ones((200, 1))
        found = spread_of([([e], [J], True)], np.zeros((0, 1)))
        (a,) = colour_of(e).a[1:]
        assert found.wide == pytest.approx(student.ppf(0.975, 200 * (1 - a**2) / (1 + a**2) - 1), rel=1e-6)

    def test_noise_coefficients_widen_intervals_by_the_final_prediction_error(self) -> None:
        rng = np.random.default_rng(3)
        part = ([rng.standard_normal(30)], [rng.standard_normal((30, 2))], True)
        plain, more = (spread_of([part], np.zeros((0, 2)), k).covariance for k in (0, 5))
        np.testing.assert_allclose(more, plain * (30 + 5) / (30 - 5), rtol=1e-12)

    def test_whitening_coefficients_count_as_fitted_noise_coefficients(self, fit_of: Any, monkeypatch: Any) -> None:
        rng, coefficients = np.random.default_rng(19), []
        monkeypatch.setattr(interval, "spread_of", lambda *args: coefficients.append(args[2]) or spread_of(*args))
        Φ = rng.standard_normal((200, 2))
        fit_of(Φ, film(clean(Φ) + 0.1 * noise(rng, 200, (1.0, -1.6, 0.9)), 0.1))
        assert coefficients[0] >= 2

    def test_single_values_use_the_stated_noise_unless_residuals_are_larger(self) -> None:
        J = np.random.default_rng(4).standard_normal((9, 2))
        for size, factor in ((0.1, 1.0), (3.0, 9 * 9.0 / (9 - 2))):  # Σ e² / (n − 2) if that is more than 1
            found = spread_of([([np.full(9, size)], [J], False)], np.zeros((0, 2)))
            np.testing.assert_allclose(found.covariance, factor * np.linalg.inv(J.T @ J), rtol=1e-9)
            assert found.wide == pytest.approx(1.96, abs=1e-4)

    def test_the_interval_of_a_constant_includes_the_noise_removed_by_the_fit(self) -> None:
        """Variance: Σ e²/n² (1 + (2 n² + 1)/(3 n²)); the second term, Σ 1 − |k|/n over all pairs, is this noise."""
        e, n = np.random.default_rng(14).standard_normal(30), 30
        found = spread_of([([e], [np.ones((n, 1))], True)], np.zeros((0, 1))).covariance[0, 0]
        assert found == pytest.approx(float(e @ e) / n**2 * (1 + (2 * n**2 + 1) / (3 * n**2)), rel=1e-9)

    def test_a_duplicated_column_adds_no_information(self) -> None:
        rng = np.random.default_rng(16)
        e, J = rng.standard_normal(30), rng.standard_normal((30, 1))
        once, twice = (spread_of([([e] * k, [J] * k, True)], np.zeros((0, 1))).covariance for k in (1, 2))
        assert twice == pytest.approx(once, rel=0.1)

    def test_noise_correlation_of_two_columns_follows_their_innovations(self) -> None:
        """With pulse responses H, including earlier innovations, the cross term of two columns is J₁ᵀ H₁ H₂ᵀ J₂."""
        n, past = 30, 400
        colours = [Colour(np.array(a), np.zeros(n)) for a in ([1.0, -0.8], [1.0, -1.2, 0.5])]
        J = np.random.default_rng(18).standard_normal((2, n, 2))
        G = [one.pulled_back(slopes, past) for one, slopes in zip(colours, J, strict=True)]
        pulses = [lfilter([1.0], one.a, np.eye(1, n + past).ravel()) for one in colours]
        H = [np.array([np.pad(h[: past + t + 1][::-1], (0, n - 1 - t)) for t in range(n)]) for h in pulses]
        np.testing.assert_allclose(G[0].T @ G[1], J[0].T @ H[0] @ H[1].T @ J[1], rtol=1e-9)

    def test_white_noise_is_rarely_taken_for_coloured_noise(self) -> None:
        """An AR coefficient must reduce n ln σ² by ln n; by chance one does so in P(χ²₁ > ln 60) = 4.3 % of draws."""
        rng = np.random.default_rng(5)
        orders = [len(colour_of(rng.standard_normal(60)).a) - 1 for _ in range(300)]
        assert np.mean([order > 0 for order in orders]) < 3 * 0.043
        assert max(orders) <= 60 // SHARE == 5

    def test_the_p_value_for_white_noise_is_uniformly_distributed(self) -> None:
        rng = np.random.default_rng(7)
        p = [whiteness(rng.standard_normal(200)) for _ in range(300)]
        assert np.mean(np.array(p) < 0.1) == pytest.approx(0.1, abs=0.06)  # 3.5 σ of 300 draws
        assert whiteness(noise(rng, 200, (1.0, -0.7))) < 1e-6


class TestSearch:
    """Searches and their weights of residuals, in problems with known solutions."""

    @pytest.mark.parametrize("name", ["linear", "huber", "soft_l1"])
    def test_a_loss_is_that_of_scipy_and_its_influence_is_half_its_slope_over_the_mean_slope(self, name: Any) -> None:
        e, h, (ρ, ψ) = np.linspace(-3.0, 3.0, 14), 1e-3, LOSSES[name]
        theirs = least_squares(lambda x: e + 0 * x, [0.0], loss=name).cost
        assert np.sum(ρ(e)) / 2 == pytest.approx(theirs, rel=1e-12)
        curvature = np.mean(ρ(e + h) - 2 * ρ(e) + ρ(e - h)) / h**2
        np.testing.assert_allclose(ψ(e), (ρ(e + h) - ρ(e - h)) / (2 * h) / curvature, rtol=1e-5)

    def test_estimates_match_linear_least_squares_and_profiles_match_intervals(self, fit_of: Any) -> None:
        rng = np.random.default_rng(8)
        Φ = rng.standard_normal((30, 2)) * [0.5, 5.0]  # the first parameter is ten times less certain
        y = clean(Φ) + 0.1 * rng.standard_normal(30)
        fitted = fit_of(Φ, film(y, 0.1, stated=True), profile=True)
        best = np.linalg.lstsq(Φ, y)[0]
        values = [math.exp(x) * START[path] for x, path in zip(best, PATHS, strict=False)]
        assert [one.value for one in fitted.numbers] == pytest.approx(values, rel=1e-8)
        for one in fitted.numbers:
            assert one.profile == pytest.approx((one.low, one.high), rel=1e-5)
            assert not one.widened
        ((at, cost),) = fitted.starts
        assert at == pytest.approx(values, rel=1e-8)
        assert cost == pytest.approx(float(((Φ @ best - y) ** 2).sum()) / 0.1**2 / 2, rel=1e-9)
        C = np.linalg.inv(Φ.T @ Φ)
        assert fitted.correlation[0, 1] == pytest.approx(C[0, 1] / math.sqrt(C[0, 0] * C[1, 1]), abs=0.1)

    def test_model_error_is_not_taken_for_autocorrelated_noise(self, fit_of: Any) -> None:
        """If a drift is as large as the signal, the least-squares fit is kept; whitening would favour another fit."""
        t = np.linspace(0.0, 1.0, 200)
        Φ = np.column_stack([t, np.sin(40 * t)])
        y = Φ @ [0.1, -0.05] + 0.3 * np.sin(3 * t) + 1e-4 * np.random.default_rng(9).standard_normal(200)
        fitted = fit_of(Φ, film(y, 0.01))
        best = np.linalg.lstsq(Φ, y)[0]
        assert math.log(fitted[MASS].value) == pytest.approx(best[0], rel=1e-6)

    def test_columns_are_weighted_by_their_residual_noise(self, fit_of: Any) -> None:
        """One column is a hundred times noisier than the other, and the noise of both is unspecified."""
        rng, n = np.random.default_rng(15), 80
        Φ = rng.standard_normal((n, 2))
        loud, quiet = (clean(Φ) + size * rng.standard_normal(n) for size in (1.0, 0.01))
        both = film(loud, 0.1)
        both.blocks = (both.blocks[0], dataclasses.replace(film(quiet, 0.1).blocks[0], name="tip y [m]"))
        fitted = fit_of(Φ, both, problem=replace(PROBLEM, noise="white"))
        x = [math.log(one.value / START[one.path]) for one in fitted.numbers]
        alike, weighed = (np.linalg.lstsq(np.vstack([Φ / a, Φ]), np.append(loud / a, quiet))[0] for a in (1.0, 100.0))
        assert np.linalg.norm(x - weighed) < 0.01 * np.linalg.norm(alike - weighed)
        assert [one.noise for one in fitted.columns] == pytest.approx([1.0, 0.01], rel=0.3)

    @pytest.mark.parametrize(("places", "order"), [(CENTRAL, 2), (CENTRAL_4, 4), (FORWARD, 2), (mirrored(FORWARD), 2)])
    def test_difference_formulas_are_exact_for_powers_up_to_their_order(self, places: Places, order: int) -> None:
        for power in range(1, order + 1):
            slope = sum(w * at**power for at, w in zip(places, weights(places), strict=True))
            assert slope == pytest.approx(float(power == 1), abs=1e-15)

    def test_difference_points_stay_within_the_bounds(self) -> None:
        mass = Coordinate(MASS, "", 1.0, False, 1.0, (0.5, 2.0), None)
        signals = Signals([film(np.zeros(3), 1.0)], [mass])
        for at, sides in ((0.5, {1}), (1.0, {-1, 1}), (2.0, {-1})):
            for places in (CENTRAL, CENTRAL_4):
                _, *points = signals.around(np.array([at]), places)
                assert {int(np.sign(point[0] - at)) for point in points} == sides

    def test_the_noise_likelihood_penalises_each_coefficient(self) -> None:
        e = noise(np.random.default_rng(10), 300, (1.0, -1.6, 0.9))
        search = solve.Search(cast("Any", Toy([film(e, 1.0)], coordinates_of(PROBLEM))), "linear", coloured=True)
        Toy.Φ = np.zeros((300, 2))
        colour = colour_of(e)
        w = colour.whitened(e[:, None])
        expected = 300 * math.log(np.mean(w**2)) + (len(colour.a) - 1) * math.log(300)
        found = search.unlikelihood(np.zeros(2), [list(one.blocks) for one in search.signals.sources])
        assert found == pytest.approx(expected, rel=1e-12)
        assert len(colour.a) > 2

    def test_the_best_of_several_starts_is_the_result(self) -> None:
        ends = iter([(2.0, 30.0), (5.0, 10.0), (7.0, 20.0)])

        def from_start(_: Array) -> solve.Found:
            x, cost = next(ends)
            return solve.Found(np.array([x]), cost, [[film(np.ones(3), 1.0).blocks[0]]])

        log: list[str] = []
        found = fitting._searched(
            cast("Any", SimpleNamespace(from_start=from_start, watch=lambda part: None)), [np.zeros(1)] * 3, log.append
        )
        assert [end.cost for end in found] == [10.0, 20.0, 30.0]
        assert [float(re.search(r"(\S+) ×", line)[1]) for line in log] == pytest.approx(
            [math.sqrt(2 * c / 3) for c in (30.0, 10.0, 20.0)], rel=2e-2
        )

    def test_start_points_fill_their_bounds_or_prior_range_evenly(self) -> None:
        wide, bounded = (Coordinate(MASS, "", 5.0, True, 1.0, (low, 5e3), None) for low in (5e-3, 4.0))
        known = dataclasses.replace(wide, prior=(6.0, 0.3))
        own, *points = solve.start_points([wide, bounded, known], 9)
        assert own.tolist() == [math.log(5.0)] * 3
        ends = [(2.5, 10.0), (4.0, 10.0), (6.0 / math.exp(0.1), 6.0 * math.exp(0.1))]  # ± two deviations of 5 %
        for values, (low, high) in zip(np.array(points).T, ends, strict=True):
            eighths = (values - math.log(low)) / math.log(high / low) * 8
            assert sorted(eighths.astype(int)) == list(range(8))

    def test_a_parameter_with_zero_derivative_at_the_solution_has_no_interval(self, fit_of: Any) -> None:
        """The data are (ln m − 1)², whose derivative is zero at the solution."""
        Φ, flat = np.ones((40, 1)), film(np.zeros(40), 0.01, stated=True)
        fitted = fit_of(
            Φ, flat, problem=problem(SCENE, (MASS,), modes=(TAPPED,)), law=lambda by, Φ: Φ[:, 0] * (by[MASS] - 1.0) ** 2
        )
        mass = fitted[MASS]
        assert (mass.low, mass.high, mass.deviation) == (-math.inf, math.inf, math.inf)
        assert not fitted.identifiable
        reviewed("fit numbers: no interval", page._confidence(mass))


class TestKept:
    def test_a_check_run_uses_the_gain_and_noise_of_the_fitted_run(self, fit_of: Any) -> None:
        rng, n = np.random.default_rng(11), 120
        Φ = rng.standard_normal((n, 2))
        first, second = (1.5 * (3.0 + clean(Φ)) + 0.02 * rng.standard_normal(n) for _ in range(2))
        kept = film(second, 7.0, name="kept", use="check", gain=True)
        fitted = fit_of(Φ, film(first, 0.1, gain=True), kept, law=lambda by, Φ: 3.0 + of_logs(by, Φ))
        ours, theirs = fitted.columns
        assert (theirs.source, theirs.use) == ("kept", "check")
        assert ours.gain == theirs.gain == pytest.approx(1.5, rel=0.01)
        best = float(np.linalg.lstsq(np.full((n, 1), 3.0), first)[0][0])  # with its start values, the toy model gives 3
        np.testing.assert_allclose(ours.before, 3.0 * best)
        after = ours.gain * (3.0 + of_logs({p: math.log(fitted[p].value) for p in PATHS[:2]}, Φ))
        np.testing.assert_allclose(theirs.after, after, rtol=1e-9)
        assert theirs.off(theirs.after) == pytest.approx(float(np.sqrt(((after - second) ** 2).mean())))
        assert ours.noise == pytest.approx(ours.off(ours.after), rel=0.01)
        assert ours.whiteness == pytest.approx(whiteness(ours.after - first), rel=1e-6)
        assert (theirs.noise, theirs.stated) == (pytest.approx(ours.noise), False)
        assert theirs.times_noise == pytest.approx(theirs.off(theirs.after) / ours.noise)
        row = row_of(film(first, 0.1, gain=True).blocks[0], first)
        rows = [row._replace(gain=gain) for gain in (1.2, 1.4)]
        assert kept_columns._gains(rows) == {FILM: pytest.approx(1.3)}  # the mean of several runs
        stated = kept_columns._known(film(second, 7.0, stated=True, gain=True).blocks[0], {}, {FILM: 0.02})
        assert (stated.σ[0], stated.gain) == (7.0, True)


class TestEstimates:
    def test_deviations_refer_to_the_value_even_if_its_logarithm_is_fitted(self) -> None:
        sought = [
            Coordinate("young", "", 2e11, True, 1.0, (1e9, 1e13), None, "Pa"),
            Coordinate("angle", "", 0.0, False, 5.0, (-20.0, 10.0), None, "deg"),
        ]
        spread = Spread(np.diag([0.01**2, 0.02**2]), 2.0)
        young, angle = estimates(Likelihood(sought, np.array([math.log(1.9e11), 2.0]), [], []), spread)
        assert young.value == pytest.approx(1.9e11)
        assert young.deviation == pytest.approx(1.9e9)
        assert (young.low, young.high) == pytest.approx((1.9e11 / math.exp(0.02), 1.9e11 * math.exp(0.02)))
        assert (angle.value, angle.deviation, angle.low, angle.high) == pytest.approx((10.0, 0.1, 9.8, 10.2))
        assert (young.at_bound, angle.at_bound) == (False, True)

    def test_gains_and_biases_have_estimates_start_values_and_units(self) -> None:
        one = film(np.array([1.0, 3.0, 5.2]), 1.0, gain=True)
        one.blocks = (dataclasses.replace(one.blocks[0], bias=True),)
        row = row_of(one.blocks[0], np.array([0.0, 1.0, 2.0]))
        mass = coordinate_of(SCENE, fl.fits.FitParameter(path=MASS))
        at = Likelihood([mass], np.zeros(1), [one], [[row]])
        _, *found = estimates(at, Spread(np.diag([9.0, 0.04, 0.01]), 2.0))
        slope, zero = np.polyfit([0.0, 1.0, 2.0], one.blocks[0].y, 1)
        expected = [(1.0, slope, slope - 0.4, slope + 0.4, 0.2), (0.0, zero, zero - 0.2, zero + 0.2, 0.1)]
        for each, values in zip(found, expected, strict=True):
            assert (each.start, each.value, each.low, each.high, each.deviation) == pytest.approx(values)
        assert [each.unit for each in found] == ["", "m"]

    def test_residual_derivatives_account_for_the_best_gain_and_bias(self) -> None:
        """For zero residuals the derivatives equal differences of residuals that each have their best gain and bias."""
        t = np.linspace(0.0, 1.0, 20)
        swing = lambda x: np.sin((5 + x) * t)  # noqa: E731
        block = dataclasses.replace(film(1.5 * swing(0.0) + 0.2, 0.1, gain=True).blocks[0], bias=True)
        slope = (swing(1e-5) - swing(-1e-5))[:, None] / 2e-5
        numeric = (row_of(block, swing(1e-5)).residual - row_of(block, swing(-1e-5)).residual) / 2e-5
        np.testing.assert_allclose(row_of(block, swing(0.0), slope).slopes[:, 0], numeric, rtol=1e-5, atol=1e-6)

    def test_unspecified_noise_is_a_hundredth_of_the_range_of_its_unit(self) -> None:
        y = np.linspace(0.0, 1.0, 5)
        blocks = [Block(name, size * y, 0 * y, name == "z [m]") for name, size in
                  (("x [m]", 1.0), ("y [m]", 3.0), ("q [rad]", 0.2), ("z [m]", 9.0))]  # fmt: skip
        assert [block.σ[0] for block in _with_noise(blocks)] == pytest.approx([0.09, 0.09, 0.002, 0.0])

    def test_positive_parameters_are_fitted_by_logarithm_and_angles_are_not(self) -> None:
        mass, angle = (
            coordinate_of(SCENE, fl.fits.FitParameter(path=path, start=5.0)) for path in (MASS, "initial.joint_deg.bar")
        )
        assert (mass.log, angle.log) == (True, False)
        assert mass.bounds == pytest.approx((math.log(5e-3), math.log(5e3)))
        assert (angle.x(10.0), angle.value(2.0), angle.bounds) == (2.0, 10.0, (-math.inf, math.inf))


class TestIdentifiability:
    def test_expected_deviations_are_inverse_sensitivities_and_infinite_for_lost_pairs(self) -> None:
        J = np.zeros((50, 4))
        J[0, 0] = J[1, 0] = 20.0 / math.sqrt(2)  # known to 1/20
        J[2, 1] = J[2, 2] = 30.0  # two parameters with the same effect
        J[3, 3] = 4.0  # weakly identifiable: known to 1/4
        check = checked(J, 0.0, ("a", "b", "c", "d"))
        assert check.expected.tolist() == [pytest.approx(1 / 20), math.inf, math.inf, pytest.approx(1 / 4)]
        assert [(set(one.names), one.lost) for one in check.directions] == [({"b", "c"}, True), ({"d"}, False)]
        assert check.directions[0].text.id == "not-separable"
        assert "49 %" in check.directions[1].text  # 1.96 / 4
        assert check.singular_values == pytest.approx([30 * math.sqrt(2), 20.0, 4.0, 0.0], abs=1e-12)
        assert not check.passed
        tables = {one.name: one for one in identifiability(check).tables}
        assert [line[1] for line in tables["expected"].lines] == [pytest.approx(9.8), None, None, pytest.approx(49.0)]

    @pytest.mark.parametrize(
        ("effect", "error", "lost"), [(0.3, 0.0, True), (3.0, 0.0, False), (3.0, 1.0, True), (30.0, 1.0, False)]
    )
    def test_an_effect_below_the_noise_or_ten_derivative_errors_counts_as_lost(self, effect, error, lost) -> None:
        J = np.diag([100.0, effect])
        assert bool(checked(J, error, ("a", "b")).lost) == lost


class TestSingle:
    def test_a_measured_change_of_sag_is_due_to_the_change_of_load(self) -> None:
        still = SCENE.varied({"gravity": (0.0, -9.81, 0.0), "link.bar.segments": 9})
        hung = fl.fits.FitStatic(axis="y", value=-1e-3, deviation=1e-5, set={"tip.mass": 0.5}, before={"tip.mass": 0.2})
        one = sagged(problem(still, (YOUNG,), static=(hung,)), hung, 1)
        assert one.at_rest is not None
        ((change,),) = one.at_rest(one.scene)
        assert change == pytest.approx(-0.3 * 9.81 * 1.0**3 / (3 * E * 0.01**4 / 12), rel=0.02)

    def test_a_prior_is_weighted_by_its_standard_deviation(self) -> None:
        known = Coordinate(MASS, "", 1.0, True, 1.0, (1e-3, 1e3), (5.0, 0.1))
        residual, slopes = prior_rows([known], np.array([math.log(5.0) + 0.02]))
        assert (residual[0], slopes[0, 0]) == pytest.approx((0.02 * 5.0 / 0.1, 5.0 / 0.1))


class TestTimes:
    def test_the_length_of_a_record_counts_from_its_first_sample(self) -> None:
        text = in_periods(np.linspace(2.0, 5.0, 601), 2.5)
        assert re.findall(r"[\d.]+", text) == ["3", "7.5", "2.5"]
        t = np.linspace(0.2, 1.0, 81)
        run = fl.fits.FitRun(name="film", columns={"t [s]": tuple(t), FILM: tuple(np.sin(t))})
        assert recorded(PROBLEM, run).rate == pytest.approx(100.0)

    @pytest.mark.parametrize(("start", "late"), [("first sample", 0.0), (6.75, 0.25)])
    def test_a_record_with_a_start_begins_with_the_scene(self, start: Any, late: float) -> None:
        t, later = np.linspace(0.0, 1.0, 65), replace(PROBLEM, scene=SCENE.varied({"initial.time": 2.0}))
        run = fl.fits.FitRun(name="film", columns={"t [s]": tuple(7.0 + t), FILM: tuple(np.sin(t))}, start=start)
        assert recorded(later, run).blocks[0].t == pytest.approx(2.0 + late + t, abs=1e-12)

    def test_measurement_times_between_samples_are_interpolated(self) -> None:
        t = np.linspace(0.0, 1.0, 101)
        for late in (0.005, 1e-4, 1e-5):
            np.testing.assert_allclose(
                at_times(t, np.sin(6 * t), t[:50] + late), np.sin(6 * (t[:50] + late)), atol=1e-6
            )

    def test_a_run_lasts_until_the_last_sample_of_its_record(self) -> None:
        later = SCENE.varied({"initial.time": 0.5})
        assert as_long(later, np.linspace(0.7, 1.5, 81)).run.duration == pytest.approx(1.0)
        whole = film(np.zeros(100), 1.0)
        part = Source.first(whole, 0.15)
        assert len(part.blocks[0].y) == 15
        assert part.scene.run.duration == pytest.approx(0.14)  # samples 0 to 14

    @pytest.mark.parametrize(("samples_a_period", "seen"), [(1.6, False), (2.5, True)])
    def test_sampling_below_two_samples_per_period_is_reported(self, samples_a_period, seen, monkeypatch) -> None:
        monkeypatch.setattr("flexlink.identification.data._swings", lambda *_: False)
        t = np.arange(50) / (3.0 * samples_a_period)
        doubts = doubts_of_times(SCENE, film(t, 1.0).blocks, t, 3.0)
        assert (doubts == ()) == seen
        if not seen:
            assert doubts[0].id == "sampling-too-slow" and "0.17 s" in doubts[0]

    def test_sensor_noise_includes_the_quantization_error(self) -> None:
        gauge = fl.Sensor(name="root", kind="strain", link="bar", x=0.1, fibre=(0.005, 0.0), gain=1e6, unit="µm/m",
                          noise=0.3, resolution=2.0, rate=100.0)  # fmt: skip
        (size,) = _noise_of_sensors(SCENE.varied({"sensor": (gauge,)}), {}).values()
        rng = np.random.default_rng(12)
        read = 100 * rng.random(100_000)
        off = 2.0 * np.round((read + 0.3 * rng.standard_normal(len(read))) / 2.0) - read
        assert size == pytest.approx(off.std(), rel=0.01)


class TestLinearReference:
    def test_the_forced_response_is_the_convolution_of_the_input_with_the_modes(self) -> None:
        λ, t = np.array([-1.0 + 8.0j, -0.3 + 21.0j]), np.linspace(0.0, 1.0, 26)
        u = np.sin(5 * t)
        _, forced = _shapes(λ, t, (t, u[:, None]))
        np.testing.assert_allclose(_poles(np.concatenate([np.log(np.abs(λ)), -λ.real / np.abs(λ)])), λ, rtol=1e-12)
        for k, one in enumerate(λ):
            for row in (5, 25):
                pieces = [quad(lambda s, e=one, end=t[row]: np.exp(e * (end - s)) * np.interp(s, t, u), *ends,
                               complex_func=True)[0] for ends in itertools.pairwise(t[: row + 1])]  # fmt: skip
                found = complex(*forced[row, 2 * k : 2 * k + 2])
                assert found == pytest.approx(sum(pieces), rel=1e-9)

    def test_input_weights_are_shared_between_runs_and_free_motion_is_not(self) -> None:
        λ, rng = np.array([-1.0 + 8.0j]), np.random.default_rng(17)
        t = 0.01 * np.arange(100)
        taken = t, np.sin(5 * t)[:, None]
        own, forced = _shapes(λ, t, taken)
        weights = rng.standard_normal(2)
        y = forced @ weights + own @ rng.standard_normal(own.shape[1])
        np.testing.assert_allclose(_given(FILM, λ, film(y, 1.0), taken, {FILM: weights}), y, atol=1e-9)

    def test_the_linear_model_uses_the_modes_below_the_resolvable_frequency(self) -> None:
        scene = fl.load_scene(ROOT / "models" / "three_links.toml")
        chain = fl.lump(scene)
        held = chain.active.tolist()
        rest = fl.solve_static(chain, fl.initial_state(scene, chain)[0], locked=held)
        ω = fl.natural_frequencies(chain, rest.q, locked=held)
        for count in (1, 2, 3):
            rate = math.sqrt(ω[count - 1] * ω[count]) / (2 * np.pi) / 0.35
            assert np.abs(_modes(scene, rate)) == pytest.approx(ω[:count], rel=1e-3)
