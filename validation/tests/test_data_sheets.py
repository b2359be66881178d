"""Data sheets of benchmarks: which benchmarks have one, and which settings and results it contains."""

import pytest

from flexlink.describe.spec import decode
from validation import kinds
from validation.case import Case, Measured, load_cases
from validation.kinds import data_sheets
from validation.store import Series

SHEETS = [case for case in load_cases() if case.sheet]


def settings_of(case: Case):
    return decode(case.settings, kinds.KINDS[case.kind].settings, "settings")


@pytest.mark.parametrize("case", SHEETS, ids=lambda case: case.name)
def test_a_data_sheet_names_its_error_measure_and_settings_by_hinge_count(case):
    assert case.sheet.error
    assert case.sheet.accepted > 0
    settings = settings_of(case)
    hinges = [at.hinges for at in data_sheets._settings(settings)]
    assert hinges == sorted(set(hinges))
    assert 2 <= len(hinges) <= 3
    assert "native" in kinds.KINDS[case.kind].sheet


def test_every_frequency_static_buckling_and_motion_benchmark_has_a_data_sheet():
    wanted = {"frequencies", "statics", "buckling", "motion_benchmark"}
    assert {case.name for case in SHEETS} == {case.name for case in load_cases() if case.kind in wanted}


def test_a_data_sheet_gives_cpu_times_of_flexlink_and_mujoco_at_equal_errors():
    (case,) = load_cases("data_sheets")
    *numbers, sheet = data_sheets.run(case, benchmarks=("physics_tip_mass",))
    assert isinstance(sheet, Series)
    columns = sheet.columns
    half = len(columns["error"]) // 2
    assert columns["program"].tolist() == ["flexlink"] * half + ["MuJoCo"] * half
    assert columns["error"][:half] == pytest.approx(columns["error"][half:], rel=1e-6)
    assert (columns["CPU time [s]"] > 0).all()
    assert " 0.001 are accepted." in sheet.title
    (best,) = [n.value for n in numbers if isinstance(n, Measured) and n.quantity == "best error / accepted"]
    assert best == pytest.approx(columns["error"][:half].min() / 1e-3)
