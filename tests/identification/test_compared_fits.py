"""Comparison of models of the same data finds the model that made them, and refuses different data."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import flexlink as fl
from flexlink.cli.main import main
from flexlink.identification.compared_fits import FitComparison
from flexlink.identification.fitted import FittedColumn
from tests.identification.test_fit_first_look import strip
from tests.support.fits import TOGETHER, problem, write_csv
from tests.support.words import refused, reviewed

Array = NDArray[np.float64]
MASS, YOUNG, SOFT = "tip.mass", "material.steel.young", "link.strip.root_stiffness.y"
TIMES = {"run.duration": 0.8, "run.sample": 0.01, **TOGETHER}


def clamped() -> fl.Scene:
    return strip().varied(TIMES)


def soft() -> fl.Scene:
    return strip(y=300.0).varied(TIMES)


def runs(true: fl.Scene, rng: np.random.Generator, masses: tuple[float, ...] = (0.0, 0.4)) -> Any:
    """Films of the strip with a known mass at its end each, with autocorrelated noise of 0.3 mm."""
    found = []
    for k, mass in enumerate(masses):
        run = fl.simulate(true.varied({"link.strip.end.mass": mass, "run.step": None, "run.relative_tolerance": 1e-8}))
        noise = 3e-4 * lfilter([0.8], [1.0, -0.6], rng.standard_normal(len(run.t)))
        columns = {"t [s]": tuple(run.t.tolist()), "tip z [m]": tuple((run.tip[:, 2] + noise).tolist())}
        found.append(fl.fits.FitRun(name=f"film {k}", columns=columns, set={"link.strip.end.mass": mass}))
    return tuple(found)


class TestChoice:
    @pytest.mark.slow
    def test_a_root_spring_is_found_and_runs_left_out_agree(self) -> None:
        data = runs(soft().varied({MASS: 0.43}), np.random.default_rng(5), (0.0, 0.2, 0.4))
        both = [problem(clamped(), (MASS,), *data), problem(soft(), (MASS, SOFT), *data)]
        found = fl.fits.compare_fits(both, ["clamped", "soft"], by_folds=True, grid="ignore")
        assert found.preferred == "soft"
        assert found.bic[0] - found.bic[1] > 10
        reviewed("preferred-model", found.findings[0], values=False)
        assert found.held_out[1] < 1.25  # noise, and the errors of parameters from two short films
        assert found.held_out[0] > 1.5 * found.held_out[1]
        assert found.fitted[1] == pytest.approx(1.0, abs=0.05)
        assert [len(one.fits) for one in found.folds] == [3, 3]
        for name, wanted in ((MASS, 0.43), (SOFT, 300.0)):
            one = found.fits[1][name]
            assert abs(one.value - wanted) < 1.5 * one.half
            assert 0.05 < found.folds[1].deviations[name] / one.deviation < 5


def column(name: str, use: str, e: Array, noise: float = 1.0, t: bool = True) -> FittedColumn:
    zero = np.zeros(len(e))
    times = np.linspace(0.0, 1.0, len(e)) if t else None
    times_noise = float(np.sqrt(np.mean(e**2)) / noise)
    return FittedColumn("run", name, use, times, zero, e, e, None, 1.0, 0.0, noise, True, times_noise, 0.5)


class Fake:
    """A fit with given columns and number of parameters."""

    def __init__(self, count: int, *columns: FittedColumn) -> None:
        self.numbers, self.columns, self.passed = (object(),) * count, columns, True


def of(*fits: Fake) -> FitComparison:
    return FitComparison(tuple("abc"[: len(fits)]), fits)  # type: ignore[arg-type]


class TestNumbers:
    def test_bic_is_that_of_schwarz_for_white_noise_and_single_measurements(self) -> None:
        rng = np.random.default_rng(1)
        e, single = rng.standard_normal(500), rng.standard_normal(4)
        found = of(*(Fake(k, column("x [m]", "fit", s * e), column("f [Hz]", "fit", single, 0.5, t=False))
                     for k, s in ((2, 1.0), (3, 0.9))))  # fmt: skip
        wanted = [500 * math.log(np.mean((s * e) ** 2)) + np.sum((single / 0.5) ** 2) + k * math.log(504)
                  for k, s in ((2, 1.0), (3, 0.9))]  # fmt: skip
        assert found.bic == pytest.approx(wanted)
        assert found.preferred == "b"

    def test_of_two_models_with_the_same_residuals_the_one_with_fewer_unknowns_is_preferred_weakly(self) -> None:
        e = np.random.default_rng(1).standard_normal(500)
        found = of(*(Fake(k, column("x [m]", "fit", e)) for k in (3, 2)))
        assert found.bic[0] - found.bic[1] == pytest.approx(math.log(500))
        reviewed("preferred-model", found.findings[0])

    def test_an_extra_unknown_that_explains_only_noise_is_not_preferred(self) -> None:
        rng, wrong = np.random.default_rng(2), 0
        for _ in range(100):
            e = lfilter([1.0], [1.0, -0.7], rng.standard_normal(600))
            extra = np.sin(np.linspace(0, 40, 600))
            less = e - extra * float(extra @ e) / float(extra @ extra)
            wrong += of(Fake(2, column("x [m]", "fit", e)), Fake(3, column("x [m]", "fit", less))).preferred == "b"
        assert wrong < 10  # with white noise assumed, every second one is

    def test_data_that_were_not_fitted_may_prefer_another_model(self) -> None:
        rng = np.random.default_rng(3)
        e, kept = rng.standard_normal(300), rng.standard_normal(300)
        found = of(Fake(2, column("x [m]", "fit", 1.1 * e), column("x [m]", "check", kept)),
                   Fake(2, column("x [m]", "fit", e), column("x [m]", "check", 1.5 * kept)))  # fmt: skip
        assert found.preferred == "b"
        assert found.held_out[1] / found.held_out[0] == pytest.approx(1.5)
        reviewed("held-out-prefers-another", found.findings[1])


class TestRefusals:
    def test_fits_of_different_data_are_refused_by_name(self) -> None:
        rng = np.random.default_rng(6)
        one, other = (problem(clamped(), (MASS,), *runs(clamped(), rng, (0.0,))) for _ in range(2))
        for id, arguments in (
            ("data-differ", ([one, other],)), ("too-few-fits", ([one],)), ("one-per-fit", ([one, other], ["a"])),
        ):  # fmt: skip
            with refused(fl.errors.ArgumentError, id):
                fl.fits.compare_fits(*arguments, grid="ignore")
        with refused(fl.errors.ArgumentError, "too-few-runs"):
            fl.fits.folds(one)

    def test_a_model_that_is_not_identifiable_is_named(self) -> None:
        data = runs(clamped(), np.random.default_rng(7), (0.0,))
        weak = problem(clamped(), (YOUNG, "section.strip.width", "material.steel.density", MASS), *data)
        with pytest.raises(fl.errors.IdentifiabilityError) as caught:
            fl.fits.compare_fits([problem(clamped(), (MASS,), *data), weak], ["good", "weak"], grid="ignore")
        assert str(caught.value).startswith("weak: ")


class TestCommand:
    @pytest.fixture(scope="class")
    @staticmethod
    def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
        """Two problem files with the same three runs, one without the spring at the root."""
        folder = tmp_path_factory.mktemp("compared")
        data = runs(soft().varied({MASS: 0.43}), np.random.default_rng(8))
        for run in data:
            write_csv(folder / f"{run.name}.csv", run.columns)
        for name, scene, more in (("clamped", clamped(), ()), ("soft", soft(), (SOFT,))):
            scene.save(folder / f"{name}_arm.toml")
            text = f'scene = "{name}_arm.toml"\n' + "".join(f'[[parameter]]\npath = "{p}"\n' for p in (MASS, *more))
            text += "".join(
                f'[[run]]\nname = "{run.name}"\nfile = "{run.name}.csv"\nset.link.strip.end.mass = {mass}\n'
                for run, mass in zip(data, (0.0, 0.4), strict=True)
            )
            (folder / f"{name}.toml").write_text(text, "utf-8")
        return folder

    @pytest.mark.slow
    def test_several_files_print_and_write_one_comparison(self, folder: Path, capsys) -> None:
        files = [str(folder / f"{name}.toml") for name in ("clamped", "soft")]
        assert main(["fit", *files, "--grid", "ignore", "--out", str(folder / "out")]) == 0
        text = capsys.readouterr().out
        assert text.strip().splitlines()[-1].startswith("soft ")
        assert {path.name for path in (folder / "out").iterdir()} == {"models.csv", "numbers.csv", "columns.csv"}
        assert main(["fit", files[1], "--folds", "--grid", "ignore", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["preferred"] == "soft"
        assert found["numbers"][1]["from folds"] > 0

    def test_options_without_effect_are_refused(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        for option in ("--check", "--propose", "--profile"):
            assert main(["fit", str(folder / "soft.toml"), "--folds", option]) != 0
            reviewed("no-effect", capsys.readouterr().err.strip())
