"""CSV files of another program, checked against the references of flexlink."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from flexlink.common.errors import ArgumentError, DataFileError, FlexlinkError
from tests.words import refused, reviewed
from validation import theirs
from validation.__main__ import main
from validation.case import Case, load_cases
from validation.measured.uncertainty import Verdict
from validation.store import Series, table

CASES = {case.name: case for case in load_cases()}
SPAR = CASES["measured_wing_spar"]
OPEN = get_args(Verdict)[-1]
"""Verdict if the uncertainty is too large for any other verdict."""

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
def test_a_value_is_checked_against_u_val_and_fails_only_beyond_its_limit(tmp_path, value, verdict, passed):
    found, _ = judged(tmp_path, SPAR, MEASURED, "quantity,unit,value,u_num", f"0.2 kg,% of the span,{value},")
    assert found.error == pytest.approx(value - 4.3)
    assert found.verdict.startswith(verdict)
    assert found.passed is passed


def test_the_numerical_uncertainty_of_the_other_program_is_included(tmp_path):
    found, _ = judged(tmp_path, SPAR, MEASURED, "quantity,unit,value,u_num", "0.2 kg,% of the span,4.6,0.5")
    assert found.verdict.startswith(OPEN)
    assert found.passed is None


def test_a_missing_value_is_counted_but_is_not_a_failure(tmp_path):
    found = judged(tmp_path, SPAR, MEASURED, "quantity,unit,value,u_num", "0.2 kg,% of the span,4.38,")
    assert [j.verdict for j in found][1] == "not given"
    text = theirs.sentence(found)
    assert re.findall(r"\d+", text) == ["1", "1", "0", "0", "1"]
    reviewed("theirs: count of verdicts", text)


def test_a_benchmark_has_the_accepted_error_of_its_data_sheet(tmp_path):
    clamped = CASES["physics_clamped"]
    first, second = judged(tmp_path, clamped, PUBLISHED, "quantity,value [rad/s]", "mode 1,3.517", "mode 2,22.4")
    assert (first.passed, second.passed) == (True, False)
    assert second.error == pytest.approx(22.4 / 22.03 - 1)


@pytest.mark.parametrize(("off", "passed"), [(0.0009, True), (0.0011, False)])
def test_the_error_of_a_motion_is_the_largest_difference_over_time(tmp_path, off, passed):
    rows = [f"{t},{float(np.sin(t)) + off * (t == 0.5)}" for t in TIMES]
    (found,) = judged(tmp_path, CASES["physics_torque_pulse"], MOTION, "time [s],tip y [m]", *rows)
    assert found.error == pytest.approx(off, rel=1e-6)
    assert found.passed is passed


@pytest.mark.parametrize(
    ("lines", "id", "parts"),
    [
        (("quantity,value", "0.2 kg,4"), "theirs: mistake in a file", ("quantity,unit,value,u_num",)),
        (("quantity,unit,value,u_num", "0.3 kg,% of the span,4,"), "unknown-name", ("line 2", "'0.3 kg'")),
        (("quantity,unit,value,u_num", "0.2 kg,m,0.02,"), "theirs: mistake in a file", ("'m'", "'% of the span'")),
        (("quantity,unit,value,u_num", "0.2 kg,% of the span,four,"), "theirs: mistake in a file", ("value = 'four'",)),
        (("quantity,unit,value,u_num", "0.2 kg,% of the span,nan,"), "theirs: mistake in a file", ("value = 'nan'",)),
        (("quantity,unit,value,u_num", "0.2 kg,% of the span"), "theirs: mistake in a file", ("line 2: 2 ", " 4")),
        (
            ("quantity,unit,value,u_num", *2 * ("0.2 kg,% of the span,4,",)),
            "theirs: mistake in a file",
            ("line 3: '0.2 kg'",),
        ),
        (("4",), "theirs: mistake in a file", ("--blank",)),
    ],
)
def test_a_mistake_in_a_file_is_named(tmp_path, lines, id, parts):
    with refused(FlexlinkError, id) as raised:
        judged(tmp_path, SPAR, MEASURED, *lines)
    text = str(raised.value)
    assert f"{SPAR.name}.csv" in text
    assert [part for part in parts if part not in text] == []


def test_a_motion_at_other_times_or_in_another_unit_is_refused(tmp_path):
    with refused(DataFileError, "test-theirs"):
        judged(tmp_path, CASES["physics_torque_pulse"], MOTION, "time [s],tip y [m]", "0.0,0.0")
    with refused(DataFileError, "test-theirs"):
        judged(tmp_path, CASES["physics_torque_pulse"], MOTION, "time [s],tip y [mm]", "0.0,0.0")
    with refused(DataFileError, "test-theirs"):
        judged(tmp_path, CASES["physics_clamped"], PUBLISHED, "time [s],tip y [mm]", "0.0,0.0")


def test_a_folder_without_files_or_with_an_unknown_file_is_named(tmp_path):
    known = list(CASES.values())
    with refused(ArgumentError, "test-theirs"):
        theirs.cases_of(tmp_path / "none", known)
    with refused(ArgumentError, "test-theirs"):
        theirs.cases_of(tmp_path, known)
    (tmp_path / "pointwise.csv").write_text("quantity,value")
    with refused(ArgumentError, "unknown-name"):  # its reference solution comes from an engine
        theirs.cases_of(tmp_path, known)


def test_every_benchmark_and_every_measurement_accepts_files_of_other_programs():
    names = {case.name for case in theirs.open_to_others(list(CASES.values()))}
    assert {f"measured_{name}" for name in ("rotating_beam", "wing_spar")} <= names
    assert {f"physics_{name}" for name in ("princeton", "torque_pulse", "columns")} <= names
    kinds = {"frequencies", "statics", "buckling", "motion_benchmark", "measured"}
    assert names == {case.name for case in CASES.values() if case.kind in kinds}


@pytest.mark.slow
def test_blank_files_are_written_filled_in_and_checked(tmp_path, capsys):
    folder, store = str(tmp_path / "mine"), ["--results", str(tmp_path / "results")]
    assert main(["--blank", folder, SPAR.name, *store]) == 0
    file = tmp_path / "mine" / f"{SPAR.name}.csv"
    heads, *lines = list(csv.reader(file.open(encoding="utf-8")))
    assert len(lines) == 10
    filled = [[name, unit, "8.9" if name == "0.4 kg" else "", ""] for name, unit, *_ in lines]
    with file.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out).writerows([heads, *filled])
    assert main(["--theirs", folder, *store]) == 0
    count = capsys.readouterr().out.splitlines()[-1]
    assert re.findall(r"\d+", count) == ["1", "1", "0", "0", "9"]
    reviewed("theirs: count of verdicts", count)
    file.write_text(file.read_text(encoding="utf-8").replace("8.9", "11.9"), encoding="utf-8")
    assert main(["--theirs", folder, *store]) == 1
    assert main(["--theirs", str(tmp_path / "none"), *store]) == 2
    assert main(["--theirs", folder, "--blank", folder, *store]) == 2
