"""Frequency responses agree with closed forms of a beam and of two inertias, and with known filters."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import freqz, lfilter

import flexlink as fl
from flexlink.identification.frequency_response import measured_response, predicted
from tests.identification.test_fit_first_look import strip
from tests.support.fits import problem, write_csv
from tests.support.words import refused

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
YOUNG, LOSS, TIP = 205e9, 4e-4, 0.42
PATHS = ("material.steel.young", "material.steel.loss_time", "tip.mass")
F: Array = np.linspace(0.5, 40.0, 160)
FORCE, Z = "tip force z [N]", "tip z [m]"


def beam(f: Array, young: float = YOUNG, loss: float = LOSS, mass: float = TIP) -> Complex:
    """Tip deflection per force of a clamped Euler-Bernoulli beam with a mass at its end (closed form).

    λ⁴ = ρ A ω² / (E I), E with loss: E (1 + iω loss); H = (sin cosh − cos sinh)(λL) / (E I λ³ (1 + cos cosh)).
    """
    length, height, width = 0.9, 0.004, 0.04
    ω = 2 * np.pi * f
    bending = young * (1 + 1j * ω * loss) * width * height**3 / 12
    λ = (7850 * width * height * ω**2 / bending) ** 0.25
    x = λ * length
    H = (np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)) / (bending * λ**3 * (1 + np.cos(x) * np.cosh(x)))
    return np.asarray(H / (1 - ω**2 * mass * H))


def arm(**changes: float) -> fl.Scene:
    still = {"gravity": (0.0, 0.0, 0.0), "link.strip.segments": 13, "tip.mass": TIP, PATHS[0]: YOUNG, PATHS[1]: LOSS}
    return strip().varied({**still, **changes})


def test_a_force_on_the_tip_of_a_beam_gives_the_closed_form_up_to_its_second_mode() -> None:
    wanted = beam(F)
    apart = np.abs(predicted(arm(), FORCE, Z, F) - wanted)
    assert apart.max() < 2e-4 * np.abs(wanted).max()
    assert np.abs(wanted).max() > 5 * np.abs(wanted[0])  # the resonance is inside


def two_inertias(**more: Any) -> fl.Scene:
    """A motor inertia of 0.6 kg m² and a mass of 2 kg at 1 m, on an elastic gear."""
    joint = fl.Joint(armature=0.6, gear_stiffness=1.2e4, gear_damping=4.0)
    one = fl.Arm(links=(fl.Link(name="bar", length=1.0, joint=joint),), tip=fl.RigidBody(mass=2.0))
    return fl.Scene(name="two", gravity=(0.0, 0.0, 0.0), arm=one, initial=fl.InitialState(joint_deg=(0.0,)), **more)


def of_two_inertias(f: Array) -> Complex:
    """Angle of the link per torque of the motor: both equations of motion solved by hand."""
    s = 2j * np.pi * f
    gear = 1.2e4 + 4.0 * s
    return np.asarray(gear / ((0.6 * s**2 + gear) * (2.0 * s**2 + gear) - gear**2))


TORQUE = "tau bar [N m]"


def test_a_motor_torque_moves_the_tip_as_that_of_two_inertias_on_a_spring() -> None:
    for output, factor in (("tip y [m]", 1.0 + 0j * F), ("tip rate y [m/s]", 2j * np.pi * F)):
        wanted = factor * of_two_inertias(F)
        np.testing.assert_allclose(predicted(two_inertias(), TORQUE, output, F), wanted, rtol=1e-9)


def test_filters_and_delays_of_a_sensor_multiply_the_response() -> None:
    gyro = fl.Sensor(name="gyro", kind="gyroscope", link="bar", axis=(0.0, 0.0, 1.0), low_pass=20.0, delay=0.003)
    by_sensor = 1 / (1 + 1j * F / 20.0) * np.exp(-2j * np.pi * F * 0.003)
    wanted = 2j * np.pi * F * of_two_inertias(F) * by_sensor
    found = predicted(two_inertias(sensor=(gyro,)), TORQUE, "gyro [rad/s]", F)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_an_undamped_resonance_has_no_finite_response() -> None:
    chain = fl.lump(two_inertias().varied({"link.bar.joint.gear_damping": 0.0}))
    model = fl.linearize(chain, np.zeros(chain.n))
    for hertz in ([-1.0], [np.nan], [[1.0]]):
        with refused(fl.errors.ArgumentError, "wrong-value"):
            model.frequency_response(hertz)
    with refused(fl.errors.ArgumentError, "infinite-response"):
        model.frequency_response([0.0])


class TestEstimate:
    a, b = [1.0, -1.6, 0.9], [0.0, 0.3]

    def records(self, rng: np.random.Generator, n: int) -> tuple[Array, Array, Array]:
        """Input and output of a digital filter, with noise in the output."""
        u = rng.standard_normal(n)
        return np.linspace(0.0, 0.01 * (n - 1), n), u, np.asarray(lfilter(self.b, self.a, u) + rng.standard_normal(n))

    def test_a_filter_with_noise_at_its_output_is_found_without_bias(self, rng: np.random.Generator) -> None:
        found = fl.fits.frequency_response(*self.records(rng, 200_000), segment=4.0)
        _, wanted = freqz(self.b, self.a, worN=2 * np.pi * found.f * 0.01)
        np.testing.assert_allclose(found.H, wanted, atol=0.05 * np.abs(wanted).max())
        exact = np.abs(wanted) ** 2 / (np.abs(wanted) ** 2 + 1)
        assert np.abs(found.coherence - exact)[5:-5].max() < 0.1
        assert found.f[0] == pytest.approx(0.25)

    def test_scatter_of_many_estimates_is_that_of_the_coherence_and_the_averages(self) -> None:
        rng = np.random.default_rng(5)
        found = [fl.fits.frequency_response(*self.records(rng, 4000), segment=2.0) for _ in range(300)]
        γ2 = np.mean([one.coherence for one in found], axis=0)
        clear = (γ2 > 0.3) & (found[0].f > 2.0)  # low coherences are estimated too high, by 1/n
        H, γ2 = np.array([one.H for one in found])[:, clear], γ2[clear]
        expected = np.abs(H.mean(axis=0)) ** 2 * (1 - γ2) / (2 * found[0].averages * γ2)
        assert len(γ2) > 20
        for part in (H.real, H.imag):
            assert float(np.mean(part.var(axis=0) / expected)) == pytest.approx(1.0, abs=0.15)
        assert 30 < found[0].averages < 39  # of 39 overlapping segments

    @pytest.mark.parametrize(
        ("change", "id"),
        [({"segment": 8.0}, "out-of-range"), ({"segment": 0.01}, "out-of-range"), ({"bend": 0.1}, "uneven-times")],
    )
    def test_segments_that_leave_no_average_and_uneven_times_are_refused(self, change, id, rng) -> None:
        t, u, y = self.records(rng, 1000)
        t = t + change.pop("bend", 0.0) * t**2
        with refused(fl.errors.ArgumentError, id):
            fl.fits.frequency_response(t, u, y, **{"segment": 1.0, **change})


def measured(rng: np.random.Generator, averages: float = 20.0, f: Array = F) -> dict[str, Array]:
    """Columns of a response of the beam with the noise of its coherence, in mm/N and degrees."""
    γ2 = np.clip(0.995 - 0.5 * np.exp(-(((f - 26) / 1.5) ** 2)), 0.3, 0.999)
    H = beam(f)
    σ = np.abs(H) * np.sqrt((1 - γ2) / (2 * averages * γ2))
    H = 1e3 * (H + σ * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))))
    angle = np.degrees(np.angle(H))
    return {"f [Hz]": f, "magnitude [mm/N]": np.abs(H), "phase [deg]": angle, "coherence": γ2}


def part(columns: dict[str, Array], **more: Any) -> fl.fits.FitFrf:
    how = {"input": FORCE, "output": "tip z [mm]", "averages": 20.0, **more}
    return fl.fits.FitFrf(columns={head: tuple(column.tolist()) for head, column in columns.items()}, **how)


class TestFit:
    @pytest.mark.parametrize(("young", "loss"), [(150e9, 2e-3), (270e9, 5e-5)])
    @pytest.mark.slow
    def test_a_beam_is_identified_although_the_peaks_do_not_overlap(self, young: float, loss: float) -> None:
        start = arm(**{PATHS[0]: young, PATHS[1]: loss, "tip.mass": 0.35})
        found = fl.fit(problem(start, PATHS, frf=(part(measured(np.random.default_rng(1))),)))
        assert found.passed
        for path, true in zip(PATHS, (YOUNG, LOSS, TIP), strict=True):
            one = found[path]
            assert abs(one.value - true) < 1.5 * one.half  # 95 % is ± 1 half-width
            assert one.half < 0.01 * true
        assert all(0.7 < one.times_noise < 1.3 for one in found.columns)

    @pytest.mark.slow
    def test_the_interval_is_that_of_the_scatter(self) -> None:
        rng, z = np.random.default_rng(2), list[float]()
        for _ in range(12):
            found = fl.fit(problem(arm(), PATHS, frf=(part(measured(rng, f=F[::3])),)), grid="ignore")
            z += [(found[path].value - true) / found[path].deviation
                  for path, true in zip(PATHS, (YOUNG, LOSS, TIP), strict=True)]  # fmt: skip
        assert 0.7 < float(np.sqrt(np.mean(np.square(z)))) < 1.4

    def test_a_file_in_decibels_is_read_and_shown_on_the_pages(self, tmp_path: Path) -> None:
        columns = measured(np.random.default_rng(3))
        columns["magnitude [dB]"] = 20 * np.log10(columns.pop("magnitude [mm/N]"))
        write_csv(tmp_path / "tap.csv", columns)
        arm().save(tmp_path / "arm.toml")
        (tmp_path / "problem.toml").write_text(
            f'scene = "arm.toml"\n[[parameter]]\npath = "tip.mass"\nstart = 0.35\n[[frf]]\ninput = "{FORCE}"\n'
            'output = "tip z [mm]"\nfile = "tap.csv"\naverages = 20\nband = [1.0, 30.0]\n', "utf-8",
        )  # fmt: skip
        read = fl.fits.FitProblem.load(tmp_path / "problem.toml")
        found = fl.fit(read)
        assert abs(found["tip.mass"].value - TIP) < 1.5 * found["tip.mass"].half
        found.report(tmp_path / "page")
        with (tmp_path / "page" / "frf_1.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert (float(rows[0]["f [Hz]"]), float(rows[-1]["f [Hz]"])) == pytest.approx((F[F >= 1][0], F[F <= 30][-1]))
        shown = [float(row["measured tip z / tip force z [m/N]"]) for row in rows]
        inside = (F >= 1) & (F <= 30)
        np.testing.assert_allclose(shown, 1e-3 * 10 ** (columns["magnitude [dB]"][inside] / 20), rtol=1e-9)
        assert "Frequency responses" in (tmp_path / "page" / "index.html").read_text("utf-8")


class TestReading:
    def test_variance_is_that_of_bendat_and_piersol_but_at_least_a_thousandth(self) -> None:
        given = {"f [Hz]": np.array([1.0, 2.0]), "real": np.array([3.0, 0.0]), "imaginary": np.array([4.0, 2.0])}
        found = measured_response(arm(), part({**given, "coherence": np.array([0.8, 1.0])}), "x")
        assert found.σ == pytest.approx([5e-3 * math.sqrt(0.2 / (2 * 20 * 0.8)), 2e-3 * 1e-3])
        assert pytest.approx([3e-3 + 4e-3j, 2e-3j]) == found.H
        bare = part(given, averages=None, deviation=0.02)
        assert measured_response(arm(), bare, "x").σ == pytest.approx([1e-4, 4e-5])

    def test_an_input_in_newton_millimetres_is_converted(self) -> None:
        given = {"f [Hz]": np.array([1.0]), "real [m/N mm]": np.array([2.0]), "imaginary": np.array([-3.0])}
        turned = part(given, input="tau bar [N mm]", output="tip y [m]", averages=None, deviation=0.1)
        found = measured_response(two_inertias(), turned, "x")
        name = "tip y / tau bar [m/(N m)]"
        assert (found.H[0], found.name) == (pytest.approx(2e3 - 3e3j), name)

    @pytest.mark.parametrize(
        ("columns", "more", "id"),
        [
            ({"coherence": [1.2, 0.5]}, {}, "coherence-range"),
            ({"coherence": None}, {}, "coherence-range"),
            ({"f [Hz]": [2.0, 1.0]}, {}, "frequencies-not-increasing"),
            ({"f [Hz]": [-1.0, 1.0]}, {}, "frequencies-not-increasing"),
            ({"real [m/N]": [1.0, 1.0]}, {}, "no-such-column"),
            ({"imaginary": None}, {}, "no-such-column"),
            ({}, {"band": (5.0, 6.0)}, "no-measured-values"),
            ({}, {"input": "tip force [N]"}, "no-such-column"),
            ({}, {"output": "tip z [N]"}, "no-such-column"),
            ({"coherence": [0.5]}, {}, "one-per-row"),
        ],
    )
    def test_wrong_columns_are_refused(self, columns: dict[str, list[float] | None], more: Any, id: str) -> None:
        usual = {"f [Hz]": [1.0, 2.0], "real": [1.0, 1.0], "imaginary": [1.0, 1.0], "coherence": [0.9, 0.9]}
        given = {head: np.array(column) for head, column in {**usual, **columns}.items() if column is not None}
        with refused(fl.errors.DataFileError, id):
            measured_response(arm(), part(given, **more), "frf 1")

    def test_decibels_in_a_column_of_magnitudes_are_refused(self) -> None:
        given = {"f [Hz]": np.array([1.0, 2.0]), "magnitude [mm/N]": np.array([-41.8, 3.0]), "phase [deg]": np.zeros(2)}
        with refused(fl.errors.DataFileError, "negative-magnitude"):
            measured_response(arm(), part(given, averages=None, deviation=0.1), "frf 1")

    def test_a_response_needs_either_averages_or_a_deviation(self) -> None:
        for more in ({"averages": None}, {"deviation": 0.1}, {"file": "a.csv"}, {"band": (2.0, 1.0)}):
            with refused(fl.errors.SceneError, "range-order" if "band" in more else "both-given"):
                part({"f [Hz]": F}, **more)
