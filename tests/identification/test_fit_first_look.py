"""Mistakes in data that a fit reports first, reasons for parameters without effect, units, and pages of a fit."""

import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.data.csv_table import measured_from
from flexlink.identification.block import Block, Colour
from flexlink.identification.coordinates import Coordinate, coordinate_of, hints_on_bounds, unit_of
from flexlink.identification.fitted import Estimate
from flexlink.identification.identifiability import Check
from flexlink.identification.interval import HALVINGS, Rise
from flexlink.identification.likelihood import Likelihood, row_of
from flexlink.identification.remarks import ranges_apart
from flexlink.pages.page import sentence_case
from tests.conftest import ROOT, make_scene
from tests.support.fits import problem, write_csv
from tests.support.words import refused, reviewed, sentence

T = np.linspace(0.0, 1.0, 101)


def strip(**root: float) -> fl.Scene:
    """A strip clamped at its side, which bends vertically about y, released from rest."""
    clamp = fl.details.RootStiffness(**root) if root else None
    return fl.Scene(
        name="strip",
        gravity=(0.0, 0.0, -9.81),
        arm=fl.Arm(
            links=(
                fl.Link(
                    name="strip", length=0.9, flex="z", segments=3, material="steel", section="strip",
                    joint=fl.Joint(axis=(0.0, -1.0, 0.0), locked=True), root_stiffness=clamp,
                ),
            ),
            materials={"steel": fl.Material(young=205e9, density=7850.0)},
            sections={"strip": fl.Section(shape="rectangle", height=0.004, width=0.04)},
            tip=fl.RigidBody(mass=0.4),
        ),
        run=fl.RunSettings(duration=1.0, sample=0.01),
    )  # fmt: skip


def film(t: np.ndarray, scene: fl.Scene | None = None, of: str = "tip z [m]", size: float = 1.0) -> fl.fits.FitRun:
    """A record as from a film of the strip, with the times t."""
    run = fl.simulate(scene or strip())
    return fl.fits.FitRun(name="film", columns={"t [s]": t, of: size * run.columns[of]})


def check(run: fl.fits.FitRun, *paths: str, scene: fl.Scene | None = None) -> Check:
    return fl.fits.check_fit(problem(scene or strip(), paths or ("tip.mass",), run))


class TestTimes:
    """A strip with a payload m at its tip vibrates at √(3 EI/L³ / (m + 33/140 ρAL)) / 2π = 3.0 Hz."""

    def test_a_note_gives_the_length_of_a_record_in_periods_of_the_slowest_mode(self) -> None:
        stiffness, beam = 3 * 205e9 * 0.04 * 0.004**3 / 12 / 0.9**3, 7850 * 0.04 * 0.004 * 0.9
        hertz = np.sqrt(stiffness / (0.4 + 33 / 140 * beam)) / (2 * np.pi)
        note = check(film(T)).notes[0]
        reviewed("data-read", note)
        periods = float(note.partition(", 1 s, ")[2].split()[0])
        assert periods == pytest.approx(hertz, rel=0.02)  # in a record of 1 s

    def test_times_in_ms_in_a_column_in_s_are_refused(self) -> None:
        with refused(fl.errors.DataFileError, "likely-unit"):
            check(film(1e3 * T))

    def test_a_record_much_shorter_than_a_period_gets_a_note(self) -> None:
        (note,) = (note for note in check(film(1e-3 * T)).notes if "0.001 s " in note and "'t [s]'" in note)
        reviewed("record-too-short", note)

    def test_too_slow_sampling_of_an_arm_that_does_not_swing_gets_a_note(self) -> None:
        still = strip().varied({"initial.passive": "static"})
        run = fl.fits.FitRun(
            name="film", columns={"t [s]": 10.0 * np.arange(4.0), "tip z [m]": (-0.01, -0.011, -0.01, -0.0101)}
        )
        (note,) = (note for note in check(run, scene=still).notes if " 10 s " in note)
        reviewed("sampling-too-slow", note)

    def test_sampling_of_a_falling_arm_need_not_resolve_its_fast_mode(self) -> None:
        """A stiff pendulum of 0.9 m swings at 0.6 Hz and bends at 18 Hz: 10 frames per second are enough."""
        bob = strip().varied(
            {"section.strip.height": 0.02, "link.strip.joint.locked": False, "link.strip.joint.viscous": 0.1,
             "initial.joint_deg": [-60.0], "run.sample": 0.1, "run.duration": 4.0}
        )  # fmt: skip
        slow = film(np.arange(41) / 10, bob)
        (note,) = (note for note in check(slow, scene=bob).notes if " 0.1 s " in note)
        reviewed("sampling-too-slow", note)

    def test_a_note_reports_metres_in_a_column_in_mm(self) -> None:
        right, wrong = (
            [note for note in check(film(T, size=size)).notes if note.startswith("film: tip z [m] ")]
            for size in (1.0, 1e-3)
        )
        assert not right
        (note,) = wrong
        reviewed("likely-unit", note)

    def test_a_note_reports_frequencies_in_rad_per_s(self) -> None:
        for times, hinted in ((1.0, False), (2 * np.pi, True)):
            tapped = fl.fits.FitModes(hertz=(times * 2.65,), deviation=(0.1,))
            of = problem(strip(), ("tip.mass",), modes=(tapped,))
            found = [note for note in fl.fits.check_fit(of).notes if note.id == "likely-unit"]
            assert len(found) == hinted
            assert [text for text in fl.fit(of).warnings if text.id == "likely-unit"] == found
            for note in found:
                reviewed("likely-unit", note)

    @pytest.mark.parametrize("times", [1.0, 1000.0, -1.0], ids=["right", "in mm", "of the other sign"])
    def test_a_note_reports_a_static_position_in_mm_or_of_the_other_sign(self, times: float) -> None:
        scene = strip()
        sag = fl.solve_static(fl.lump(scene)).q
        change = fl.tip_position(fl.lump(scene), sag)[2] - fl.tip_position(fl.lump(scene.varied({"tip.mass": 0.0})),
            fl.solve_static(fl.lump(scene.varied({"tip.mass": 0.0}))).q)[2]  # fmt: skip
        read = fl.fits.FitStatic(axis="z", value=1.1 * times * float(change), deviation=1e-4, before={"tip.mass": 0.0})
        of = problem(scene, ("material.steel.young",), static=(read,))
        found = [note for note in fl.fits.check_fit(of).notes if note.id == "likely-unit"]
        assert len(found) == (times != 1.0)
        for note in found:
            reviewed("likely-unit", note)

    def test_frequencies_must_increase_with_the_number_of_the_mode(self) -> None:
        with refused(fl.errors.SceneError, "modes-not-increasing"):
            fl.fits.FitModes(hertz=(80.0, 12.0), deviation=(0.1,))
        assert fl.fits.FitModes(hertz=(80.0, 12.0), deviation=(0.1,), numbers=(2, 1))

    def test_bounds_in_another_unit_get_a_hint(self) -> None:
        def hinted(*ends: float) -> tuple[str, ...]:
            young = fl.fits.FitParameter(path="material.steel.young", between=ends)
            tapped = fl.fits.FitModes(hertz=(3.0,), deviation=(0.1,))
            return hints_on_bounds(fl.fits.FitProblem(scene=strip(), parameter=(young,), modes=(tapped,)))

        assert hinted(1e3, 3e11) == hinted(1e11, 3e11) == ()
        (hint,) = hinted(150.0, 250.0)
        reviewed("likely-unit", hint)


class TestReasons:
    def test_the_reason_names_what_a_parameter_without_effect_changes(self) -> None:
        run = fl.fits.FitRun(name="film", columns={"t [s]": T, "tip y [m]": 1e-4 * np.sin(40 * T)})
        (lost,) = check(run).lost
        assert lost.text.startswith("tip.mass ")
        assert -1 < lost.text.find("tip z [m]") < lost.text.find("film") < lost.text.find("tip y [m]")
        reviewed("no-effect", lost.text)

    def test_rounding_errors_of_an_arm_at_rest_do_not_count_as_an_effect(self) -> None:
        """If they counted, rates of 1e-15 rad/s would be taken for motion."""
        scene = strip().varied({"initial.passive": "static"})
        run = fl.fits.FitRun(name="film", columns={"t [s]": T, "tip y [m]": 1e-4 * np.sin(40 * T)})
        (lost,) = check(run, "material.steel.loss_time", scene=scene.varied({"material.steel.loss_time": 1e-3})).lost
        assert "film" in lost.text and "0.1%" in lost.text and "[" not in lost.text  # the text names no column
        reviewed("no-effect", lost.text)

    @pytest.mark.parametrize("still", [0.0, 1e-17, -1e-17])
    def test_a_column_that_changes_only_by_rounding_is_not_reported_for_its_unit(self, still: float) -> None:
        blocks = (Block("tip y [m]", np.sin(T), np.ones(len(T)), True, T),)
        model = [[0.3 + still * np.arange(len(T))], [1e-3 * np.sin(T)]]
        rows = [[row_of(blocks[0], y)] for (y,) in model]
        (note,) = ranges_apart(Likelihood([], np.zeros(0), [SimpleNamespace(name="film")] * 2, rows))
        assert "0.000841 m" in note
        reviewed("likely-unit", note)

    def test_the_reason_names_the_axes_of_a_spring_and_of_the_bending(self) -> None:
        scene = strip(z=900.0)
        (lost,) = check(film(T, scene), "link.strip.root_stiffness.z", scene=scene).lost
        assert "root_stiffness.z" in lost.text and -1 < lost.text.find("flex = 'z'") < lost.text.find(" y")
        reviewed("no-effect", lost.text)


@pytest.mark.parametrize(
    ("name", "units"),
    [("tip z", ("m", "mm")), ("tip z [cm]", ("m", "mm")), ("height [mm]", ("mm",)), ("tp z [mm]", ("mm",))],
)
def test_the_error_of_an_unknown_column_suggests_a_name(name: str, units: tuple[str, ...]) -> None:
    known = dict.fromkeys(("t [s]", "tip z [m]", "q arm [rad]"))
    with refused(fl.errors.DataFileError, "no-such-column") as caught:
        measured_from("film.csv", ("t [s]", name), np.zeros((2, 2)), known)
    column, _, rest = str(caught.value).partition(f"'{name}': ")
    assert column.startswith("film.csv: ")
    unit = "mm" if "[mm]" in name else "m"  # a suggestion keeps the unit of the file
    assert f"tip z [{unit}]" in rest and all(re.search(rf"\b{each}\b", rest) for each in units) and "q arm" not in rest
    assert (f"'tip z [{unit}]'" in rest.rpartition(";")[2]) == (name != "height [mm]")


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("tip.mass", "kg"), ("material.steel.young", "Pa"), ("link.strip.root_stiffness.y", "N m/rad"),
        ("link.strip.joint.viscous", "N m s/rad"), ("initial.joint_deg.strip", "deg"), ("material.steel.poisson", ""),
        ("link.cart.joint.viscous", "N s/m"),
    ],
)  # fmt: skip
def test_a_path_has_the_unit_of_its_field(path: str, unit: str) -> None:
    cart = fl.Link(name="cart", joint=fl.Joint(kind="prismatic", viscous=1.0), hub=fl.RigidBody(mass=1.0))
    assert unit_of(make_scene(cart) if "cart" in path else strip(y=900.0), path) == unit


class TestEndsOfIntervals:
    """Twice the cost is min(x², 2), plus (x − 8)² beyond x = 8; the 95 % interval ends where it is 3.84."""

    def rise(self, start: float, high: float = 100.0, fails_from: float = math.inf) -> tuple[Rise, Estimate]:
        def twice(x: np.ndarray) -> float:
            return float(min(x[0] ** 2, 2.0) + max(x[0] - 8.0, 0.0) ** 2)

        def least(x: np.ndarray, *_: object, **__: object) -> np.ndarray:
            if x[0] > fails_from:
                raise fl.errors.SceneError("no equilibrium", id="wrong-value")
            return x

        search = SimpleNamespace(
            coordinates=[Coordinate("x", "", start, False, 1.0, (-100.0, high), None)], coloured=False,
            cost=lambda x, _: twice(x) / 2, least=least,
        )  # fmt: skip
        best, at = SimpleNamespace(x=np.zeros(1), blocks=[]), SimpleNamespace(covariance=np.eye(1))
        return Rise(search, best, at), Estimate("x", "x", start, 0.0, -1.96, 1.96, 1.0)  # type: ignore[arg-type]

    def test_an_interval_extends_beyond_a_start_value_that_is_not_rejected(self) -> None:
        true = 8.0 + np.sqrt(1.96**2 - 2.0)
        rise, one = self.rise(start=5.0)
        end = rise.beyond_start(0, one)
        assert end is not None
        assert true <= end <= true + (11.25 - 7.5) / 2**HALVINGS

    def test_a_rejected_start_value_does_not_extend_the_interval(self) -> None:
        rise, one = self.rise(start=12.0)
        assert rise.beyond_start(0, one) is None

    @pytest.mark.parametrize("start", [5.0, 6.0])
    def test_an_interval_whose_bound_is_not_rejected_ends_at_the_bound(self, start: float) -> None:
        rise, one = self.rise(start, high=6.0)
        assert rise.beyond_start(0, one) == 6.0

    def test_values_at_which_the_simulation_fails_are_rejected(self) -> None:
        rise, one = self.rise(start=5.0, fails_from=7.0)
        end = rise.beyond_start(0, one)
        assert end is not None
        assert 7.0 <= end <= 7.0 + (7.5 - 5.0) / 2**HALVINGS

    def test_noise_coefficients_are_penalised_as_in_the_information_criterion(self) -> None:
        assert Colour(np.array([1.0, -0.5, 0.1, 0.2]), np.zeros(101)).price == pytest.approx(3 * math.log(101))
        assert Colour(np.ones(1), np.zeros(101)).price == 0.0


class TestFiles:
    def test_file_paths_in_set_tables_are_relative_to_the_problem_file(self, tmp_path: Path) -> None:
        (tmp_path / "fit.toml").write_text(
            f'scene = "{ROOT / "models" / "three_links.toml"}"\n[[parameter]]\npath = "tip.mass"\n'
            '[[run]]\nname = "a"\nfile = "a.csv"\nset.run.method = "mine.toml"\nset.link.upper.lumping = "gauss"\n'
            'set.motion = [{ link = "upper", file = "led.csv", cutoff = 5.0 }]\n'
            '[[modes]]\nhertz = [1.0]\ndeviation = [0.1]\nset.link.upper.lumping = "own.toml"\n',
            encoding="utf-8",
        )
        read, lumping = fl.fits.FitProblem.load(tmp_path / "fit.toml"), "link.upper.lumping"
        run, modes = read.run[0], read.modes[0]
        assert (run.file, run.set["run.method"]) == (str(tmp_path / "a.csv"), str(tmp_path / "mine.toml"))
        assert run.set["motion"][0]["file"] == str(tmp_path / "led.csv")
        assert (run.set[lumping], modes.set[lumping]) == ("gauss", str(tmp_path / "own.toml"))


def test_table_heads_are_capitalized_except_symbols_and_paths() -> None:
    heads = "standard deviation", "p of whiteness", "tip.mass", "link.a.root_stiffness.y", "± of 95 % [%]", "RMS before"
    assert [head for head in heads if sentence_case(head) != head] == ["standard deviation"]


class TestPages:
    def test_a_refused_fit_writes_a_page_with_the_reason_and_the_problem(self, tmp_path, capsys) -> None:
        strip(z=900.0).save(tmp_path / "arm.toml")
        write_csv(tmp_path / "film.csv", film(T).columns)
        (tmp_path / "fit.toml").write_text(
            'scene = "arm.toml"\n[[parameter]]\npath = "link.strip.root_stiffness.z"\nprior = [900.0, 9e5]\n'
            '[[run]]\nname = "film"\nfile = "film.csv"\nset.tip.mass = 0.41\n',
            encoding="utf-8",
        )
        out = tmp_path / "out"
        assert main(["fit", str(tmp_path / "fit.toml"), "--out", str(out)]) == 1
        assert f"page: {out / 'index.html'}" in capsys.readouterr().out
        page = (out / "index.html").read_text(encoding="utf-8")
        assert '"state">refused<' in page
        reviewed("fit first look: difference of a run", sentence(page, "film", "tip.mass = 0.41."))
        assert not json.loads((out / "check.json").read_text(encoding="utf-8"))["passed"]
        assert fl.fits.FitProblem.load(out / "problem.toml") == fl.fits.FitProblem.load(tmp_path / "fit.toml")
        assert main(["fit", str(out / "problem.toml")]) == 1

    def test_the_page_of_a_fit_shows_units_and_a_problem_given_in_python(self, tmp_path: Path) -> None:
        sought = (
            fl.fits.FitParameter(path="tip.mass"),
            fl.fits.FitParameter(path="material.steel.young", prior=(205e9, 1e9)),
        )
        run = film(T, strip().varied({"tip.mass": 0.42}))
        found = fl.fit(fl.fits.FitProblem(scene=strip(), parameter=sought, run=(run,)))
        assert [one.unit for one in found.numbers] == ["kg", "Pa"]
        page = found.report(tmp_path / "out").page.read_text(encoding="utf-8")
        assert "kg</p>" in page
        assert "Pa</p>" in page
        again = fl.fit(fl.fits.FitProblem.load(tmp_path / "out" / "problem.toml"))
        assert [one.value for one in again.numbers] == [one.value for one in found.numbers]


ROD = make_scene(fl.Link(name="rod", length=1.0), tip=fl.RigidBody(mass=1.0, inertia=(1, 1, 1)))


@pytest.mark.parametrize(("given", "tried"), [((0.5, 2.0), (0.5, 2.0)), ((1e-9, 1e9), (1e-3, 1e3))])
def test_by_default_a_parameter_is_fitted_within_a_factor_of_a_thousand(given: Any, tried: Any) -> None:
    assert coordinate_of(ROD, fl.fits.FitParameter(path="tip.mass", between=given)).between == pytest.approx(tried)
