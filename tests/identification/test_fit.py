"""Fits recover known parameters within their intervals, and unidentifiable parameters are refused."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.linalg import toeplitz
from scipy.signal import lfilter

import flexlink as fl
from flexlink.chain.lumping import open_chain
from flexlink.cli import fit
from flexlink.cli.main import main
from flexlink.dynamics.ties import tie_rows
from flexlink.identification.block import Colour, colour_of
from flexlink.identification.coordinates import coordinate_of, coordinates_of
from flexlink.identification.data import recorded, sources_of
from flexlink.identification.fitted import Fitted
from flexlink.identification.identifiability import Check
from flexlink.identification.signals import STEP, Signals
from flexlink.motion.slopes_of_runs import CENTRAL_4
from tests.conftest import ROOT, flexible, make_scene
from tests.identification.test_fit_first_look import strip
from tests.motion.test_ties import arm as tied_arm
from tests.support.fits import problem, write_csv
from tests.support.touching import Touching
from tests.support.words import line, refused, refused_line, reviewed

THREE = {"material.aluminium.young": 63e9, "tip.mass": 8.6, "link.upper.joint.armature": 2.3}


@pytest.fixture(scope="module")
def scene() -> fl.Scene:
    """Three links that fall for a second, sampled at 200 Hz."""
    return fl.load_scene(ROOT / "models" / "three_links.toml").varied({"run.duration": 1.0, "run.sample": 0.005})


def record(scene: fl.Scene, names: tuple[str, ...], noise: float = 0.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Columns of a run with added white noise, as if measured."""
    run, rng = fl.simulate(scene), np.random.default_rng(seed)
    return {"t [s]": run.t} | {name: run.columns[name] + noise * rng.standard_normal(len(run.t)) for name in names}


@pytest.mark.slow
class TestPlanted:
    def test_three_parameters_are_recovered_within_their_intervals_from_any_start(self, scene: fl.Scene) -> None:
        run = fl.fits.FitRun(name="fall", columns=record(scene.varied(THREE), ("tip x [m]", "tip z [m]"), 1e-3))
        start = {"material.aluminium.young": 9e10, "tip.mass": 7.0}
        one, other = (fl.fit(problem(s, tuple(THREE), run)) for s in (scene, scene.varied(start)))
        for path, value in THREE.items():
            assert one[path].low < value < one[path].high
            assert one[path].value == pytest.approx(other[path].value, rel=1e-6)
            assert one[path].half < 0.02 * value
        assert one.runs < 250  # a search beyond the accuracy of Σ e² takes 350 runs
        assert one.passed
        assert all(column.noise == pytest.approx(1e-3, rel=0.1) for column in one.columns)

    def test_noise_free_data_in_degrees_and_mm_give_the_exact_parameters(self, scene: fl.Scene) -> None:
        exact = record(scene.varied({"tip.mass": 9.0}), ("tip x [m]", "q upper [rad]"))
        units = {"t [ms]": 1e3, "tip x [mm]": 1e3, "q upper [deg]": 180 / np.pi}
        columns = {head: size * column for (head, size), column in zip(units.items(), exact.values(), strict=True)}
        found = fl.fit(problem(scene, ("tip.mass",), fl.fits.FitRun(name="fall", columns=columns)))
        assert found["tip.mass"].value == pytest.approx(9.0, rel=1e-7)

    def test_gain_bias_and_initial_angle_are_fitted_together_with_the_mass(self, scene: fl.Scene) -> None:
        columns = record(scene.varied({"tip.mass": 9.0, "initial.joint_deg.fore": -62.0}), ("tip x [m]", "tip z [m]"))
        columns["tip x [m]"] = 1.25 * columns["tip x [m]"] + 0.02
        run = fl.fits.FitRun(
            name="fall", columns=columns, gain=("tip x [m]",), bias=("tip x [m]",),
            parameter=(fl.fits.FitParameter(path="initial.joint_deg.fore", between=(-70.0, -50.0)),),
        )  # fmt: skip
        found = fl.fit(problem(scene, ("tip.mass",), run))
        assert found["tip.mass"].value == pytest.approx(9.0, rel=1e-6)
        known = {"initial.joint_deg.fore of run 'fall'": (-62.0, 1e-7), "gain of tip x [m] of 'fall'": (1.25, 1e-5),
                 "bias of tip x [m] of 'fall'": (0.02, 1e-4)}  # fmt: skip
        for name, (true, rel) in known.items():
            assert found[name].value == pytest.approx(true, rel=rel)
        assert found.scene.initial == scene.initial  # run-specific values are not part of the scene

    def test_sensors_with_noise_delay_and_resolution_can_be_fitted(self, scene: fl.Scene) -> None:
        gauge = fl.Sensor(
            name="root", kind="strain", link="upper", x=0.1, fibre=(0.0225, 0.0), gain=1e6, unit="µm/m", low_pass=20.0,
            delay=0.01, noise=5.0, resolution=1.0, rate=200.0, seed=4,
        )  # fmt: skip
        here = scene.varied({"sensor": (gauge,), "run.duration": 0.5})
        seen = fl.simulate(here.varied({"tip.mass": 8.5, "sensor.root.delay": 0.013})).columns["root [µm/m]"]
        run = fl.fits.FitRun(name="fall", columns={"t [s]": fl.simulate(here).t, "root [µm/m]": seen})
        found = fl.fit(problem(here, ("tip.mass", "sensor.root.delay"), run))
        assert found["tip.mass"].low < 8.5 < found["tip.mass"].high
        delay = found["sensor.root.delay"]
        assert delay.low < 0.013 < delay.high
        assert delay.half < 0.001
        (column,) = found.columns
        assert column.stated
        assert column.times_noise == pytest.approx(1.0, abs=0.15)


class TestSlopes:
    def test_difference_points_computed_ahead_give_equal_derivatives_and_are_reused(self, scene) -> None:
        run = fl.fits.FitRun(name="fall", columns=record(scene.varied({"run.duration": 0.1}), ("tip x [m]",)))
        of = problem(scene.varied({"run.duration": 0.1}), ("tip.mass", "link.upper.joint.armature"), run)
        alone, ahead = (Signals(sources_of(of, "fit"), coordinates_of(of)) for _ in range(2))
        x = np.array([one.x(one.start) for one in alone.coordinates])
        ahead.ahead([*ahead.around(x, CENTRAL_4), *ahead.around(x, CENTRAL_4, STEP / 2)])
        for step in (STEP, STEP / 2):
            assert np.array_equal(ahead.slopes(x, CENTRAL_4, step), alone.slopes(x, CENTRAL_4, step))
        assert np.array_equal(ahead.model(x), alone.model(x))
        assert ahead.runs == 1 + 2 * 6  # ±½, ±1 and ±2 steps of both parameters
        assert alone.runs > 2 * (1 + 2 * 4)


class TestInterval:
    def test_whitening_inverts_the_noise_covariance_including_the_first_samples(self) -> None:
        a, n = np.array([1.0, -1.6, 0.9]), 50
        pulse = lfilter([1.0], a, np.eye(1, 2000).ravel())
        covariance = toeplitz([pulse[k:] @ pulse[: 2000 - k] for k in range(n)])
        one = Colour(a, np.zeros(1))
        W = one.whitened(np.eye(n))
        np.testing.assert_allclose(W.T @ W, np.linalg.inv(covariance), atol=1e-11)
        assert one.share == pytest.approx(covariance[0, 0] ** -0.5, rel=1e-12)

    def test_burg_finds_the_coefficients_of_a_resonance(self) -> None:
        rng, a = np.random.default_rng(5), np.array([1.0, -1.6, 0.9])
        w, e = rng.standard_normal(5000), np.zeros(5000)
        for k in range(2, 5000):
            e[k] = w[k] - a[1] * e[k - 1] - a[2] * e[k - 2]
        np.testing.assert_allclose(colour_of(e).a[:3], a, atol=0.05)


FLEX = "material.aluminium.young", "material.aluminium.density"


class TestIdentifiability:
    def test_a_prior_makes_a_pair_of_parameters_identifiable(self, scene: fl.Scene) -> None:
        bare = scene.varied({"tip.mass": 0.0, "gravity": (0.0, 0.0, 0.0)})
        density = fl.fits.FitParameter(path=FLEX[1], prior=(2700.0, 27.0))
        tapped = fl.fits.FitModes(hertz=(12.0,), deviation=(0.05,))
        plain = problem(bare, FLEX, modes=(tapped,))
        assert not fl.fits.check_fit(plain).passed
        assert fl.fits.check_fit(replace(plain, parameter=(plain.parameter[0], density))).passed


class TestSingleNumbers:
    def test_stiffness_and_payload_are_fitted_from_frequencies_and_a_sag(self, scene: fl.Scene) -> None:
        true = scene.varied({"material.aluminium.young": 66e9, "tip.mass": 8.2})
        chain = fl.lump(true)
        q = fl.initial_state(true, chain)[0]
        found = fl.modes(chain, q, locked=chain.active.tolist())
        hertz = tuple(found.hertz[np.array(found.kinds) == "elastic"][:3].tolist())
        hung = fl.tip_position(chain, q)[2]
        tapped = fl.fits.FitModes(hertz=hertz, deviation=(0.01,))
        sag = fl.fits.FitStatic(axis="z", value=float(hung), deviation=1e-4)
        fitted = fl.fit(problem(scene, (FLEX[0], "tip.mass"), modes=(tapped,), static=(sag,)))
        assert fitted["tip.mass"].value == pytest.approx(8.2, rel=1e-6)
        assert fitted[FLEX[0]].value == pytest.approx(66e9, rel=1e-6)
        assert fitted["tip.mass"].high > 8.2 > fitted["tip.mass"].low


@pytest.mark.slow
class TestLinearReference:
    @pytest.mark.parametrize(
        ("sought", "explains"), [("material.aluminium.young", True), ("material.aluminium.loss_time", False)]
    )
    def test_a_free_linear_model_distinguishes_wrong_parameters_from_a_wrong_scene(
        self, scene: fl.Scene, sought: str, explains: bool
    ) -> None:
        """The elbow moves by 0.3° as prescribed; the measured arm is softer, which damping cannot explain."""
        turn = fl.PrescribedMotion(link="fore", times=(0.0, 0.2), angle_deg=(-60.0, -59.7), rate_deg=(0.0, 0.0),
                                   acceleration_deg=(0.0, 0.0))  # fmt: skip
        led = scene.varied({"motion": (turn,), "link.waist.joint.locked": True, "link.upper.joint.locked": True})
        columns = record(led.varied({"material.aluminium.young": 60e9}), ("tip x [m]", "tip z [m]"), 1e-5)
        runs = tuple(fl.fits.FitRun(name=use, columns=columns, use=use) for use in ("fit", "check"))
        found = fl.fit(problem(led, (sought,), *runs))
        judged = found.verdict_columns
        assert [one.use for one in judged] == ["check", "check"]
        linear = max(one.off(one.linear) for one in judged)
        after = max(one.off(one.after) for one in judged)
        assert (after < 1.1 * linear) == explains
        assert linear < 3e-5 < max(one.off(one.before) for one in judged)


class TestProblem:
    SCENE = f'scene = "{ROOT / "models" / "three_links.toml"}"\n'

    @pytest.mark.parametrize(
        ("text", "id", "part"),
        [
            ('[[parameter]]\npath = "tip.mass"\n', "nothing-to-fit", "modes"),
            ('[[parameter]]\npath = "tip.mass"\nbetween = [2, 1]\n', "range-order", "between = [2.0, 1.0]"),
            ('[[parameter]]\npth = "tip.mass"\n', "unknown-key", "path"),
            ("parameter = []\n[[modes]]\nhertz = [1]\ndeviation = [0.1]\n", "wrong-value", "parameter"),
            ('[[parameter]]\npath = "tip.mas"\n[[modes]]\nhertz = [1]\ndeviation = [0.1]\n', "cannot-set", "'mass'"),
            ('[[parameter]]\npath = "tip.mass"\n[[modes]]\nhertz = [1]\n', "missing-key", "deviation"),
            ('[[parameter]]\npath = "tip.mass"\n[[run]]\nname = "a"\n', "both-given", "file"),
            ('[[parameter]]\npath = "tip.mass"\n[[run]]\nname = "a"\nfile = "none.csv"\n', "cannot-read", "none.csv"),
            (
                '[[parameter]]\npath = "tip.mass"\n[[modes]]\nset.tip.mass = 1.0\nhertz = [1]\ndeviation = [0.1]\n',
                "parameter-set",
                "tip.mass",
            ),
        ],
    )
    def test_mistakes_in_a_problem_file_are_refused_by_key(self, tmp_path, capsys, text, id, part) -> None:
        path = tmp_path / "problem.toml"
        path.write_text(self.SCENE + text, encoding="utf-8")
        assert main(["fit", str(path)]) == 2
        assert part in refused_line(capsys.readouterr().err, id).splitlines()[0]

    @pytest.mark.parametrize(
        ("head", "settings", "id", "part"),
        [
            ("tip x [km]", {}, "no-such-column", "tip x [km]"),
            ("q upper [m]", {}, "no-such-column", "q upper [m]"),
            ("tip x [m]", {"noise": {"tip y [m]": 1.0}}, "no-such-column", "tip y [m]"),
            ("tip x [m]", {"compare": ("tip q [m]",)}, "no-such-column", "'tip q [m]'"),
            ("tip x [m]", {"window": (5.0, 6.0)}, "too-few-samples", "swing"),
        ],
    )
    def test_mistakes_in_a_record_are_refused_and_the_run_is_named(self, scene, head, settings, id, part) -> None:
        run = fl.fits.FitRun(name="swing", columns={"t [s]": (0.0, 0.1, 0.2), head: (1.0, 1.1, 1.2)}, **settings)
        with refused(fl.errors.DataFileError, id) as caught:
            fl.fits.check_fit(problem(scene, ("tip.mass",), run))
        assert part in str(caught.value)
        assert "'swing'" in str(caught.value)


class TestDoubts:
    """A fit reports parameters or data that are not credible."""

    def test_an_interval_end_that_overflows_float64_is_infinite(self, scene: fl.Scene) -> None:
        mass = coordinate_of(scene, fl.fits.FitParameter(path="tip.mass"))
        assert mass.value(1e6) == math.inf
        assert mass.value(math.log(8.0)) == pytest.approx(8.0)

    def test_a_tip_beyond_the_reach_of_the_arm_is_refused_with_the_likely_unit(self, scene: fl.Scene) -> None:
        columns = record(scene, ("tip x [m]",))
        run = fl.fits.FitRun(name="film", columns=columns | {"tip x [m]": 1e3 * columns["tip x [m]"]})
        with refused(fl.errors.DataFileError, "likely-unit"):
            fl.fits.check_fit(problem(scene, ("tip.mass",), run))


class TestCommand:
    def test_the_check_option_prints_accuracies_and_an_unidentifiable_fit_returns_1(self, tmp_path, capsys) -> None:
        model = ROOT / "models" / "fits" / "tapped.toml"
        assert main(["fit", str(model), "--check"]) == 0
        assert re.search(r" ± [\d.]+ % ", line(capsys.readouterr().out, "tip.mass "))
        text = model.read_text(encoding="utf-8").replace("../three", str(ROOT / "models" / "three"))
        lost = tmp_path / "lost.toml"
        path = "material.aluminium.loss_time"
        lost.write_text(f'{text}[[parameter]]\npath = "{path}"\n', encoding="utf-8")
        assert main(["fit", str(lost)]) == 1
        refusal = capsys.readouterr().out.splitlines()[-1]
        reviewed("fit: refused", refusal)
        assert path in refusal

    @pytest.mark.slow
    def test_the_fit_command_turns_a_csv_into_a_scene_a_page_and_json(self, scene: fl.Scene, tmp_path, capsys) -> None:
        columns = record(scene.varied({"tip.mass": 8.5, "run.duration": 0.5}), ("tip x [m]", "tip z [m]"), 1e-3)
        for name in ("one", "two"):
            write_csv(tmp_path / f"{name}.csv", columns)
        scene.save(tmp_path / "arm.toml")
        runs = "".join(
            f'[[run]]\nname = "{name}"\nfile = "{name}.csv"\nuse = "{use}"\n'
            for name, use in (("one", "fit"), ("two", "check"))
        )
        (tmp_path / "fit.toml").write_text(
            'scene = "arm.toml"\n[[parameter]]\npath = "tip.mass"\n' + runs, encoding="utf-8"
        )
        assert main(["fit", str(tmp_path / "fit.toml"), "--out", str(tmp_path / "out"), "--profile"]) == 0
        assert "tip.mass  8.5" in capsys.readouterr().out
        fitted = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
        assert fitted["passed"]
        mass = fitted["numbers"][0]
        assert mass["low"] < 8.5 < mass["high"]
        low, high = mass["profile"]
        assert (low, high) == pytest.approx((mass["low"], mass["high"]), rel=1e-3)
        assert fl.load_scene(tmp_path / "out" / "fitted.toml").arm.tip.mass == mass["value"]
        page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
        assert "Identifiability" in page
        assert "spectrum.csv" in page


TOO_SMALL, TOO_LARGE = r"expected float >= 1e-30", r"expected float <= 1e\+30"


@pytest.mark.parametrize(("value", "allowed"), [(5e-324, TOO_SMALL), (1e-308, TOO_SMALL), (1e308, TOO_LARGE)])
@pytest.mark.parametrize(
    ("key", "build"),
    [
        (r"prior\[1\]", lambda d: fl.fits.FitParameter(path="tip.mass", prior=(1.0, d))),
        (r"deviation\[0\]", lambda d: fl.fits.FitModes(hertz=(5.0,), deviation=(d,))),
        ("ratio_deviation", lambda d: fl.fits.FitModes(hertz=(5.0,), deviation=(0.1,), ratio_deviation=d)),
        ("deviation", lambda d: fl.fits.FitStatic(axis="x", value=0.0, deviation=d)),
        ("noise.*", lambda d: fl.fits.FitRun(name="a", file="a.csv", noise={"tip x [m]": d})),
    ],
)
def test_a_standard_deviation_whose_square_overflows_or_underflows_is_refused(key, build, value, allowed) -> None:
    with refused(fl.errors.SceneError, "wrong-value"):
        build(value)


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [1e-30, 1e30])
def test_extreme_allowed_deviations_give_a_result_or_a_one_line_error(deviation: float) -> None:
    arm = make_scene(
        flexible("a", segments=3, joint=fl.Joint(locked=True)), flexible("b", segments=3), gravity=(0, -9.81, 0)
    )
    of = fl.fits.FitProblem(
        scene=arm, parameter=(fl.fits.FitParameter(path=FLEX[0], prior=(7e10, deviation)),),
        modes=(fl.fits.FitModes(hertz=(5.0,), deviation=(deviation,)),),
        static=(fl.fits.FitStatic(axis="y", value=-0.01, deviation=deviation),),
    )  # fmt: skip
    assert np.isfinite(fl.fits.check_fit(of).singular_values).all()
    try:
        assert fl.fit(of).numbers[0].value > 0
    except fl.errors.IdentifiabilityError as error:
        assert deviation > 1 and "\n" not in str(error)


def swinging() -> fl.Scene:
    axis = (0.0, -1.0, 0.0)
    gyro = fl.Sensor(name="gyro", kind="gyroscope", link="strip", x=0.9, axis=axis)
    return strip().varied({"sensor": (gyro,), "run.duration": 2.0, "run.sample": 0.001})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gyroscope at 500 Hz and a film at 60 Hz that begins later, of a strip with 0.43 kg at its end."""
    folder, rng = tmp_path_factory.mktemp("rates"), np.random.default_rng(0)
    run = fl.simulate(swinging().varied({"tip.mass": 0.43, "run.relative_tolerance": 1e-8}))
    for name, column, spacing, begin, noise in (
        ("imu", "gyro [rad/s]", 1 / 500, 0.0, 0.002), ("film", "tip z [m]", 1 / 60, 0.013, 2e-4),
    ):  # fmt: skip
        t = np.arange(begin, 1.99, spacing)
        y = np.interp(t, run.t, run.columns[column]) + noise * rng.standard_normal(len(t))
        write_csv(folder / f"{name}.csv", {"t [s]": t, column: y})
    swinging().save(folder / "arm.toml")
    return folder


def stored(folder: Path, *files: str, compare: str = "") -> fl.fits.FitProblem:
    path = folder / "problem.toml"
    names = ", ".join(f'"{name}.csv"' for name in files)
    path.write_text(
        f'scene = "arm.toml"\n[[parameter]]\npath = "tip.mass"\n[[run]]\nname = "both"\nfile = [{names}]\n{compare}',
        "utf-8",
    )
    return fl.fits.FitProblem.load(path)


@pytest.fixture(scope="module")
def both(folder: Path) -> Fitted:
    """The fit to both instruments."""
    return fl.fit(stored(folder, "imu", "film"), grid="ignore")


def test_every_column_keeps_the_times_of_its_file(folder: Path) -> None:
    of = stored(folder, "imu", "film")
    source = recorded(of, of.run[0])
    lengths = {block.name: len(block.y) for block in source.blocks}
    assert lengths == {"gyro [rad/s]": 995, "tip z [m]": 119}
    for block, file in zip(source.blocks, ("imu", "film"), strict=True):
        t, y = np.loadtxt(folder / f"{file}.csv", delimiter=",", skiprows=1).T
        np.testing.assert_array_equal(block.t, t)
        np.testing.assert_array_equal(block.y, y)
    assert source.rate == pytest.approx(500, rel=1e-3)
    assert source.scene.run.sample == pytest.approx(0.002)


def test_both_instruments_narrow_the_interval_and_the_estimate_is_right(folder: Path, both: Fitted) -> None:
    alone = fl.fit(stored(folder, "imu"), grid="ignore")
    for found in (both, alone):
        assert abs(found["tip.mass"].value - 0.43) < 1.5 * found["tip.mass"].half
    assert both["tip.mass"].half < alone["tip.mass"].half
    note = next(note for note in both.check.notes if note.id == "data-read")
    reviewed("data-read", note)


def test_compared_columns_may_be_in_any_of_the_files(folder: Path) -> None:
    of = stored(folder, "imu", "film", compare='compare = ["tip z [m]"]\n')
    assert [block.name for block in recorded(of, of.run[0]).blocks] == ["tip z [m]"]
    with refused(fl.errors.DataFileError, "no-such-column"):
        of = stored(folder, "imu", "film", compare='compare = ["tip y [m]"]\n')
        recorded(of, of.run[0])


def test_a_column_in_two_files_is_refused_by_name(folder: Path) -> None:
    (folder / "again.csv").write_text((folder / "film.csv").read_text("utf-8"), "utf-8")
    of = stored(folder, "film", "imu", "again")
    with refused(fl.errors.DataFileError, "column-twice"):
        recorded(of, of.run[0])


def test_the_page_names_the_files_in_its_problem(folder: Path, both: Fitted, tmp_path: Path) -> None:
    both.report(tmp_path)
    of = stored(folder, "imu", "film")
    assert fl.fits.FitProblem.load(tmp_path / "problem.toml").run[0].file == of.run[0].file


def test_a_check_prints_half_widths_of_intervals(capsys: Any) -> None:
    fit._print_check(Check(("mass",), np.ones(1), (), np.array([0.01])))
    row = line(capsys.readouterr().out, "mass", "± 2 %", "95 %")
    reviewed("slips: check of a parameter", row)


def test_the_stiffness_of_a_tie_and_a_payload_are_found_from_a_motion_by_another_engine() -> None:
    spring = {"name": "pin", "kind": "distance", "link": "l3", "length": 0.1, "to": {"point": [1.1, 0.0, 0.1]}}
    spring |= {"stiffness": 2000.0, "damping": 5.0}
    guess = tied_arm(*({"length": length} for length in (0.4, 1.0, 0.8)), ties=[spring], start=[60.0, -33.03, -116.34])
    real = {"tie.pin.stiffness": 3000.0, "tip.mass": 0.3}
    made, guess = guess.varied(real), guess.varied({"tip.mass": 0.2})
    chain, t, noise = fl.lump(open_chain(made)), np.arange(0.0, 0.401, 0.005), np.random.default_rng(0)
    angles, _ = Touching(chain, tie_rows(made, chain)).run(fl.initial_state(made, chain)[0], np.zeros(chain.n), t)
    seen = {f"q l{k} [rad]": angles[:, k - 1] + 1e-4 * noise.standard_normal(len(t)) for k in (1, 3)}
    found = fl.fit(problem(guess, tuple(real), fl.fits.FitRun(name="fall", columns={"t [s]": t, **seen})))
    assert found.passed
    for path, value in real.items():
        assert found[path].low < value < found[path].high
        assert found[path].half < 0.05 * value
