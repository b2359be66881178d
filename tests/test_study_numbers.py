"""Quick cases, and parts of others, measured once more: every number within its limit, and that of the full study."""

from __future__ import annotations

import csv
import gzip
from collections import defaultdict
from functools import cache
from typing import Any

import pytest
from conftest import ROOT
from msgspec.structs import replace

from validation.case import load_cases
from validation.kinds import measurements
from validation.runner import judged, kind_of
from validation.store import Series

CASES = {case.name: case for case in load_cases()}
WHOLE = """
    paper_springs paper_definite paper_lu paper_freedoms paper_indices paper_frames paper_types paper_mass
    paper_rounding paper_segments convergence_float64 energy_drift physics_lateral_buckling physics_pinned
    physics_damping physics_torsion_taper physics_roll_up physics_exact_motion physics_three_links
    physics_torsion physics_de_luca_siciliano robots physics_clamped physics_tip_mass physics_elastica
    physics_princeton physics_sensors physics_saturation physics_step_response physics_drag physics_satellite
    order_conditions_dop853 judge_50_digits physics_finite_chains
"""
BEAM = {"rules": {"gauss": [4, 8], "midpoint": [4, 8]}, "least": {}, "orders": {}, "needs": [], "named": []}
PARTS: dict[str, dict[str, Any]] = {
    "identities": {"samples": 8}, "random_arms": {"arms": 3, "samples": 2}, "planted_fits": {"arms": 1},
    "judge_trees": {"arms": 1}, "pointwise": {"samples": 8},
    "speed_loop": {"steps": {"RK4": 2.5e-4}}, "data_sheets": {"benchmarks": ["physics_pinned", "physics_elastica"]},
    "physics_spin_up": BEAM | {"rules": {"gauss": [4, 8, 20]}}, "physics_heavy": BEAM,
    **{name: {} for name in WHOLE.split()},
}  # fmt: skip
"""Cases, and what of their settings is changed so that they take seconds."""

CHANGING = ("own error", "fewest hinges")
"""Quantities that rounding moves, or another rule."""


@cache
def stored() -> list[tuple[tuple[str, str, str, str], float]]:
    """Numbers of the full study that is checked in that measure no time: case, scene, engine, quantity; value."""
    with gzip.open(ROOT / "reports" / "full" / "all_checks.csv.gz", "rt", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["value"] and row["timed"] != "True"]
    return [((row["case"], row["scene"], row["engine"], row["quantity"]), float(row["value"])) for row in rows]


@pytest.mark.slow
@pytest.mark.parametrize("name", PARTS)
def test_a_case_is_within_its_limits_and_measures_what_the_full_study_did(name: str) -> None:
    """Numbers below 1e-6 apart, which may be of rounding and are not the same on every machine."""
    case = replace(CASES[name], settings=CASES[name].settings | PARTS[name])
    kind, settings = kind_of(case)
    found = defaultdict(list)
    for each in measurements(kind, case, settings):
        if not isinstance(each, Series) and each.quantity in case.quantity:
            row = judged(case, each, 0.0, "")
            assert row.passed in {True, None} or row.timed, row
            found[row.scene, row.engine, row.quantity].append(row.value)
    assert found
    for (of, *key), value in stored() if not PARTS[name] else ():
        if of == name and abs(value) > 1e-6 and not key[2].startswith(CHANGING):
            assert any(each == pytest.approx(value, rel=0.02, abs=1e-6) for each in found[*key]), (key, value)
