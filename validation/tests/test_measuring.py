"""Quick cases and parts of others measured again: numbers are within their limits and agree with the full study."""

import csv
import gzip
import re
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from reports.drawing import pictures
from reports.findings import finding
from reports.results import Results
from reports.same import allowed
from tests.conftest import ROOT
from validation.case import ALL, load_cases
from validation.measuring import judged, kind_of
from validation.store import Series, Store
from validation.tests import studies

CASES = {case.name: case for case in load_cases(*ALL)}
WHOLE = """
    paper_springs paper_definite paper_lu paper_freedoms paper_indices paper_frames paper_types paper_mass
    paper_rounding paper_segments convergence_float64 energy_drift physics_lateral_buckling physics_pinned
    physics_damping physics_torsion_taper physics_roll_up physics_exact_motion physics_three_links
    physics_torsion physics_de_luca_siciliano robots physics_clamped physics_tip_mass physics_elastica
    physics_princeton physics_sensors physics_saturation physics_step_response physics_drag physics_satellite
    order_conditions_dop853 judge_50_digits physics_finite_chains
"""
BEAM = {"rules": {"gauss": [4, 8], "midpoint": [4, 8]}, "least": {}, "orders": {}, "needs": [], "named": []}
CALLS = {"turns": 1, "turn": 1e-4, "chain": {
    name: {"change": {"link.*.flex": flex}, "segments": [2, 5], "pinocchio": 5, "mujoco": 5}
    for name, flex in (("T1", "z"), ("T2", "yz"), ("T3", "xyz"))
}}  # fmt: skip
PARTS: dict[str, dict[str, Any]] = {
    "identities": {"samples": 8}, "random_arms": {"arms": 3, "samples": 2}, "planted_fits": {"arms": 1},
    "judge_trees": {"arms": 1}, "pointwise": {"samples": 8},
    "integrators_paper_fig5": {"duration": 0.1, "steps": {"RK4": [1e-4], "RK10": [1e-4]}, "stability": ["RK10"]},
    "rounding_growth_raised": {"engines": ["mujoco"], "duration": 20.0},
    "speed_loop": {"steps": {"RK4": 2.5e-4}}, "data_sheets": {"benchmarks": ["physics_pinned", "physics_elastica"]},
    "physics_spin_up": BEAM | {"rules": {"gauss": [4, 8, 20]}}, "physics_heavy": BEAM,
    "speed_calls": CALLS, "speed_steps": CALLS | {"longest": {"T1": 7}, "longest_steps": 2},
    "speed_trade_short": {"scenes": ["t3pd"], "errors": [1e-2], "methods": ["DOP853"], "budget": 0.01},
    "extremes_beside": {"plan": [{"scenes": ["plane"], "axes": ["payload over link mass"], "steps": ["mujoco"]}]},
    "extremes_short": {"plan": [{"scenes": ["plane"], "axes": ["payload [kg]"], "steps": ["tolerance", "fixed"]}]},
    **{name: {} for name in WHOLE.split()},
}  # fmt: skip
"""Cases, with the changes of their settings that shorten them to seconds."""

CHANGING = ("own error", "fewest hinges", "tip error / tolerance")
"""Quantities that change with rounding, with the rule, or with the comparison of runs, which returns a finer one."""


@cache
def stored() -> list[tuple[tuple[str, str, str, str], float]]:
    """Numbers of the checked-in full study, except times: (case, scene, engine, quantity) and value."""
    with gzip.open(ROOT / "reports" / "full" / "all_checks.csv.gz", "rt", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["value"] and row["timed"] != "True"]
    return [((row["case"], row["scene"], row["engine"], row["quantity"]), float(row["value"])) for row in rows]


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_a_case_is_within_its_limits_and_agrees_with_the_full_study(name: str, tmp_path: Path) -> None:
    """Numbers above 1e-6, which are not rounding, agree within 2 % plus the allowance of `reports.same`."""
    case = replace(CASES[name], settings=CASES[name].settings | PARTS[name])
    kind, settings = kind_of(case)
    found, rows, series = defaultdict(list), [], []
    for each in kind.measurements(case, settings):
        if isinstance(each, Series):
            series.append(each)
        elif each.quantity in case.quantity:
            rows.append(row := judged(case, each, 0.0, ""))
            assert row.passed in {True, None} or row.timed or name.startswith("speed_"), row
            found[row.scene, row.engine, row.quantity].append(row)
    assert found
    for (of, *key), value in stored() if not PARTS[name] else ():
        if of == name and abs(value) > 1e-6 and not key[2].startswith(CHANGING):
            assert any(abs(row.value - value) <= 0.02 * abs(value) + allowed(row, value) for row in found[*key]), key
    check_what_is_made_of(studies.stored(tmp_path, *rows), name, series)


def check_what_is_made_of(folder: Path, name: str, series: list[Series]) -> None:
    """Every figure and finding has file names, complete sentences, and tables with a value in every column."""
    for each in series:
        Store(folder).add_series(name, each)
    results = Results.read(folder)
    made = [picture for _, picture in pictures(results)]
    for picture in made:
        assert re.fullmatch(r"[\w.\-]+", picture.name), picture.name
        assert " " in picture.title + " ." * (picture.name == "overview")
        assert picture.caption.endswith(".")
        assert len({len(line) for line in csv.reader(picture.csv.splitlines())}) == 1
    for _, table in finding.made(results):
        assert re.fullmatch(r"[\w.\-]+", table.name), table.name
        assert all(isinstance(one, str) for one in (table.title, *table.heads, *table.sentences))
        assert {len(line) for line in table.lines} <= {len(table.heads)}, table.name
        assert all(one.strip() and one[-1] in ".:!)" for one in table.sentences), table.sentences
