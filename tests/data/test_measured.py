"""Measurements compared with a run: units of instruments are converted, and a wrong value of the scene is found."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import flexlink as fl
from flexlink.data.csv_table import Measured, read_csv, read_measured
from flexlink.scene_report.fitting import Comparison, numbers_of
from tests.conftest import ROOT
from tests.support.words import refused, reviewed

KNOWN = ("t [s]", "tip x [m]", "q upper [rad]", "qd upper [rad/s]")
NOISE = 1e-4  # m


@pytest.fixture(scope="module")
def scene() -> fl.Scene:
    changes = {"run.duration": 0.6, "link.*.flex": "z", "drive.gravity": "none", "drive.reference.shaper": None}
    return fl.load_scene(ROOT / "models" / "ptp_move.toml").varied(changes)


def measured_of(scene: fl.Scene, noise: float = NOISE) -> Measured:
    """Tip of a run as measured by an instrument with noise."""
    run, rng = fl.simulate(scene), np.random.default_rng(1)
    names = [f"tip {axis} [m]" for axis in "xyz"]
    return Measured(run.t, {name: run.columns[name] + noise * rng.standard_normal(len(run.t)) for name in names})


REFUSED = {
    "file-empty": [""],
    "no-such-column": ["t [s],tip x [km]\n0,1\n1,1\n", "tip x [m]\n1\n2\n", "t [s]\n0\n1\n",
                       "t [s],tip x [m],tip x [mm]\n0,1,1\n1,1,1\n"],
    "csv-cell": [f"t [s],tip x [m]\n0,1\n1{cell}\n" for cell in (",one", ",inf", "")],
    "times-not-increasing": ["t [s],tip x [m]\n1,1\n0,1\n-1,1\n", "t [s],tip x [m]\n0,1\n"],
}  # fmt: skip


class TestReading:
    def read(self, folder: Path, text: str) -> Measured:
        path = folder / "measured.csv"
        path.write_text(text, encoding="utf-8")
        return read_measured([path], dict.fromkeys(KNOWN))

    def test_units_of_instruments_are_converted_to_units_of_the_run(self, tmp_path: Path) -> None:
        text = "t [ms],tip x [mm],q upper [deg],qd upper [deg/s]\n0,1500,180,360\n10,,90,-90\n"
        found = self.read(tmp_path, text)
        assert found.t.tolist() == [0.0, 0.01]
        np.testing.assert_array_equal(found.columns["tip x [m]"], [1.5, np.nan])
        np.testing.assert_allclose(found.columns["q upper [rad]"], [np.pi, np.pi / 2], rtol=1e-15)
        np.testing.assert_allclose(found.columns["qd upper [rad/s]"], [2 * np.pi, -np.pi / 2], rtol=1e-15)

    @pytest.mark.parametrize(("head", "size"), [("µm", 1e-6), ("um", 1e-6), ("mm", 1e-3), ("m", 1.0)])
    def test_lengths_are_converted_to_metres(self, tmp_path: Path, head: str, size: float) -> None:
        found = self.read(tmp_path, f"t [s],tip x [{head}]\n0,3\n1,4\n")
        np.testing.assert_allclose(found.columns["tip x [m]"], [3 * size, 4 * size], rtol=1e-15)

    @pytest.mark.parametrize("id", REFUSED)
    def test_a_file_that_cannot_be_read_is_refused(self, tmp_path: Path, id: str) -> None:
        for text in REFUSED[id]:
            with refused(fl.errors.DataFileError, id):
                self.read(tmp_path, text)

    @pytest.mark.parametrize("row", ["1,", "1,x", "1", "0,1"])  # empty, no number, too few cells, not later
    def test_the_line_of_a_mistake_is_counted_with_blank_lines(self, tmp_path: Path, row: str) -> None:
        path = tmp_path / "measured.csv"
        path.write_text(f"t [s],a [m]\n\n0,1\n\n{row}\n2,2\n", encoding="utf-8")
        with pytest.raises(fl.errors.DataFileError, match=r"\bline 5\b"):
            (table := read_csv(path)).column("a", "m"), table.times


@pytest.mark.slow
class TestFitting:
    def test_a_stiffness_error_of_five_percent_is_identified_with_its_size(self, scene: fl.Scene) -> None:
        true = scene.varied({"material.aluminium.young": 0.95 * 70e9})
        best, *others = Comparison(scene, fl.simulate(scene), measured_of(true)).fits
        young = "material.aluminium.young"
        assert best.number.path == young
        assert abs(best.value - 0.95 * 70e9) < 4 * best.spread
        assert best.spread < 0.01 * 70e9
        assert all(other.explained < best.explained for other in others)

    def test_a_wrong_initial_angle_is_found_and_given_in_degrees(self, scene: fl.Scene) -> None:
        free = scene.varied({"drive": fl.Drive(), "run.duration": 0.2})
        true = free.varied({"initial.joint_deg.fore": -60.5})
        best = Comparison(free, fl.simulate(free), measured_of(true)).fits[0]
        path = "initial.joint_deg.3"
        assert best.number.path == path
        reviewed("measured: initial angle", best.number.what)
        assert abs(best.value + 60.5) < 4 * best.spread < 0.1

    def test_the_residual_of_a_perfect_model_is_the_noise(self, scene: fl.Scene) -> None:
        beside = Comparison(scene, run := fl.simulate(scene), measured_of(scene))
        assert beside.off(run)["tip z [m]"] == pytest.approx(NOISE, rel=0.2)
        assert all(fit.explained < 0.1 for fit in beside.fits)

    def test_nothing_is_fitted_if_run_and_measurement_agree(self, scene: fl.Scene) -> None:
        assert Comparison(scene, fl.simulate(scene), measured_of(scene, noise=0.0)).fits == ()

    def test_differences_within_rounding_are_not_fitted(self, scene: fl.Scene) -> None:
        same = measured_of(scene, noise=0.0)
        eps = np.finfo(float).eps
        for part, differs in ((4 * eps, False), (1e4 * eps, True)):
            near = Measured(same.t, {name: column * (1 + part) for name, column in same.columns.items()})
            assert Comparison(scene, fl.simulate(scene), near).differs == differs


def test_every_candidate_parameter_can_be_varied(scene: fl.Scene) -> None:
    for number in numbers_of(scene):
        assert scene.values_at(number.path) == [number.value]
        assert scene.varied({number.path: 1.01 * number.value}) != scene or number.value == 0


def test_fitted_runs_end_at_the_sample_after_the_last_measurement(scene: fl.Scene) -> None:
    """Samples are 10 ms apart, so a run for measurements up to 14 ms takes 20 ms."""
    apart = scene.varied({"run.sample": 0.01})
    run, t = SimpleNamespace(t=np.array([0.0, 0.6])), np.array([0.0, 0.014])
    beside = Comparison(apart, cast("Any", run), Measured(t, {"tip x [m]": t}))
    assert beside.scene.run.duration == pytest.approx(0.02)
