"""An error is split into parts: the part due to a coarse setting is the largest, and the page names it."""

import numpy as np
import pytest

from flexlink.describe.scene_file import load_scene
from reports.figures import checks as figure
from reports.findings import errors as finding
from reports.results import Results
from tests.support.words import reviewed
from validation.case import MODELS
from validation.store import Series, Store, table
from validation.tests.studies import row, stored
from validation.trade.error_parts import Fine, Setup, Splitter

COARSE = {
    "model": Setup(flex="rigid", method="DOP853", tolerance=1e-10),
    "space": Setup(flex="z", hinges=1, method="DOP853", tolerance=1e-10),
    "time": Setup(flex="z", rule="gauss", hinges=8, method="Radau5", tolerance=1e-2),
}


@pytest.fixture(scope="module")
def scene():
    """A short fall of the paper's arm."""
    return load_scene(MODELS / "paper_fig5.toml").varied({"run.duration": 0.1, "run.sample": 0.01})


@pytest.fixture(scope="module")
def splits(scene):
    """Error parts of the same fall with soft links, for runs that are each coarse in one setting only."""
    exact = Fine(method="DOP853", tolerances=(1e-11, 1e-10), hinges=(10, 8))
    splitter = Splitter(scene.varied({"material.aluminium.young": 7e8}), "z", exact, exact)
    return {coarse: splitter.split(setup) for coarse, setup in COARSE.items()}


@pytest.mark.parametrize("coarse", COARSE)
def test_the_largest_error_part_belongs_to_the_coarse_setting(splits, coarse):
    parts = splits[coarse].parts
    assert max(parts, key=lambda name: parts[name].size) == coarse
    assert parts[coarse].own < 0.1 * parts[coarse].size


def test_a_rigid_arm_has_no_hinge_error_and_an_exact_model_no_model_error(splits):
    assert splits["model"].parts["space"].size == 0.0
    assert splits["space"].parts["model"].size == splits["time"].parts["model"].size == 0.0


LINES = (("coarse", 0.0, 2e-3, 1e-6, 1e-14, 2e-3), ("slack", 0.0, 1e-5, 1e-3, 1e-14, 1e-3))


@pytest.fixture
def results(tmp_path):
    where = stored(tmp_path / "results", row("split", kind="errors_split"))
    columns = table(("run", *finding.PARTS, "total"), LINES)
    Store(where).add_series("split", Series("errors", "title", columns, "run", "run", "error [m]", scene="arm"))
    return Results.read(where)


def test_the_error_table_names_the_largest_part_and_leaves_zeros_empty(results):
    (found,) = finding.errors_split(results)
    assert [(line[0], line[1], line[-1]) for line in found.lines] == [
        ("arm: coarse", None, "space"), ("arm: slack", None, "time"),
    ]  # fmt: skip
    text = " ".join(found.sentences)
    assert "2 runs" in text and " 1 of " in text and " 1 %" in text
    reviewed("errors split: finding", text)


def test_an_error_part_of_zero_is_not_drawn(results):
    (picture,) = figure.errors_split(results)
    (axes,) = picture.figure.axes
    drawn = {
        line.get_label(): len(np.asarray(line.get_xdata())) for line in axes.lines if line.get_linestyle() == "None"
    }
    assert drawn == {"model": 0, "space": 2, "time": 2, "rounding": 2, "total": 2}
