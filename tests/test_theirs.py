"""Another code's CSV files, judged by the references that flexlink is judged by."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from flexlink.common.errors import ArgumentError, DataFileError, FlexlinkError
from tests.words import refused
from validation import theirs
from validation.__main__ import main
from validation.case import Case, load_cases
from validation.store import Series, table

CASES = {case.name: case for case in load_cases()}
SPAR = CASES["measured_wing_spar"]
HEADS = ("quantity", "unit", "S", "D", "E", "u_input", "u_D", "wanted", "verdict")
LINES = [
    ("0.2 kg", "% of the span", 4.4, 4.3, 0.1, 0.03, 0.04, 0.2, ""),
    ("0.4 kg", "% of the span", 8.8, 9.1, -0.3, 0.03, 0.04, 0.4, ""),
]
MEASURED = {"measured": Series("measured", "", table(HEADS, LINES), "quantity", "", "E")}
PUBLISHED = {
    "published": Series(
        "published",
        "",
        table(("what", "published", "ours"), [("mode 1", 3.516, 3.5), ("mode 2", 22.03, 22.0)]),
        "",
        "",
        "",
    )
}
TIMES = np.linspace(0.0, 1.0, 5)
MOTION = {
    "motion": Series("motion", "", {"time [s]": TIMES, "reference": np.sin(TIMES)}, "time [s]", "time [s]", "tip y [m]")
}


def judged(folder: Path, case: Case, stored: dict[str, Series], *lines: str) -> list[theirs.Judged]:
    file = folder / f"{case.name}.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return list(theirs.judge(file, case, stored))


@pytest.mark.parametrize(
    ("value", "verdict", "passed"),
    [(4.38, "validated to u_val", True), (4.45, "not validated", True), (4.6, "not validated", False)],
)
def test_a_value_is_judged_by_e_and_u_val_and_fails_only_beyond_what_is_wanted(tmp_path, value, verdict, passed):
    found, _ = judged(tmp_path, SPAR, MEASURED, "quantity,unit,value,u_num", f"0.2 kg,% of the span,{value},")
    assert found.error == pytest.approx(value - 4.3)
    assert found.verdict.startswith(verdict)
    assert found.passed is passed


def test_their_own_u_num_counts(tmp_path):
    found, _ = judged(tmp_path, SPAR, MEASURED, "quantity,unit,value,u_num", "0.2 kg,% of the span,4.6,0.5")
    assert found.verdict.startswith("cannot be told")
    assert found.passed is None


def test_what_is_not_given_is_said_and_is_no_failure(tmp_path):
    found = judged(tmp_path, SPAR, MEASURED, "quantity,unit,value,u_num", "0.2 kg,% of the span,4.38,")
    assert [j.verdict for j in found][1] == "not given"
    assert theirs.sentence(found) == "1 value given: 1 accepted, 0 not accepted, 0 cannot be told; 1 not given"


def test_a_benchmark_is_judged_by_the_accepted_error_of_its_data_sheet(tmp_path):
    clamped = CASES["physics_clamped"]
    first, second = judged(tmp_path, clamped, PUBLISHED, "quantity,value [rad/s]", "mode 1,3.517", "mode 2,22.4")
    assert (first.passed, second.passed) == (True, False)
    assert second.error == pytest.approx(22.4 / 22.03 - 1)


@pytest.mark.parametrize(("off", "passed"), [(0.0009, True), (0.0011, False)])
def test_a_motion_is_judged_by_its_largest_difference(tmp_path, off, passed):
    rows = [f"{t},{float(np.sin(t)) + off * (t == 0.5)}" for t in TIMES]
    (found,) = judged(tmp_path, CASES["physics_torque_pulse"], MOTION, "time [s],tip y [m]", *rows)
    assert found.error == pytest.approx(off, rel=1e-6)
    assert found.passed is passed


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("quantity,value", "0.2 kg,4"), "expected quantity,unit,value,u_num"),
        (("quantity,unit,value,u_num", "0.3 kg,% of the span,4,"), "'0.3 kg'"),
        (("quantity,unit,value,u_num", "0.2 kg,m,0.02,"), "unit = 'm': expected '% of the span'"),
        (("quantity,unit,value,u_num", "0.2 kg,% of the span,four,"), "value = 'four': expected a finite number"),
        (("quantity,unit,value,u_num", "0.2 kg,% of the span,nan,"), "value = 'nan': expected a finite number"),
        (("quantity,unit,value,u_num", "0.2 kg,% of the span"), "line 2: 2 cells; the header line has 4"),
        (("quantity,unit,value,u_num", *2 * ("0.2 kg,% of the span,4,",)), "line 3: '0.2 kg' is listed twice"),
        (("4",), "no header"),
    ],
)
def test_a_mistake_in_a_file_is_named(tmp_path, lines, message):
    with pytest.raises(FlexlinkError) as raised:
        judged(tmp_path, SPAR, MEASURED, *lines)
    assert message in str(raised.value)
    assert "measured_wing_spar.csv" in str(raised.value)


def test_a_motion_at_other_times_or_in_another_unit_is_refused(tmp_path):
    with refused(DataFileError, "test-theirs"):
        judged(tmp_path, CASES["physics_torque_pulse"], MOTION, "time [s],tip y [m]", "0.0,0.0")
    with refused(DataFileError, "test-theirs"):
        judged(tmp_path, CASES["physics_torque_pulse"], MOTION, "time [s],tip y [mm]", "0.0,0.0")
    with refused(DataFileError, "test-theirs"):
        judged(tmp_path, CASES["physics_clamped"], PUBLISHED, "time [s],tip y [mm]", "0.0,0.0")


def test_a_folder_without_files_or_with_a_file_of_no_case_is_named(tmp_path):
    known = list(CASES.values())
    with refused(ArgumentError, "test-theirs"):
        theirs.cases_of(tmp_path / "none", known)
    with refused(ArgumentError, "test-theirs"):
        theirs.cases_of(tmp_path, known)
    (tmp_path / "pointwise.csv").write_text("quantity,value")
    with refused(ArgumentError, "unknown-name"):  # its truth is an engine's, not a reference
        theirs.cases_of(tmp_path, known)


def test_every_benchmark_and_every_measurement_is_open_to_others():
    names = {case.name for case in theirs.open_to_others(list(CASES.values()))}
    assert {"measured_rotating_beam", "physics_princeton", "physics_torque_pulse", "physics_columns"} <= names
    kinds = {"frequencies", "statics", "buckling", "motion_benchmark", "measured"}
    assert names == {case.name for case in CASES.values() if case.kind in kinds}


@pytest.mark.slow
def test_blank_files_are_written_filled_in_and_judged(tmp_path, capsys):
    folder, store = str(tmp_path / "mine"), ["--results", str(tmp_path / "results")]
    assert main(["--blank", folder, "measured_wing_spar", *store]) == 0
    file = tmp_path / "mine" / "measured_wing_spar.csv"
    heads, *lines = list(csv.reader(file.open(encoding="utf-8")))
    assert len(lines) == 10
    filled = [[name, unit, "8.9" if name == "0.4 kg" else "", ""] for name, unit, *_ in lines]
    with file.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out).writerows([heads, *filled])
    assert main(["--theirs", folder, *store]) == 0
    assert "1 value given: 1 accepted" in " ".join(capsys.readouterr().out.split())
    file.write_text(file.read_text(encoding="utf-8").replace("8.9", "11.9"), encoding="utf-8")
    assert main(["--theirs", folder, *store]) == 1
    assert main(["--theirs", str(tmp_path / "none"), *store]) == 2
    assert main(["--theirs", folder, "--blank", folder, *store]) == 2
