"""Comparisons with measurements as the site shows them; every case compares its numbers with the stored ones.

`python -m validation measured`, then `python -m validation.measured.stored validation/results` stores them anew.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.output import write_text
from validation.reference_values import look_up, reference_file
from validation.store import Store

DATA = "measured/comparisons"
TEXTS = ("quantity", "group", "verdict", "held out verdict")
NUMBERS = ("S", "D", "E", "u_val", "held out S", "held out u_val")
Columns = Mapping[str, NDArray[Any]]


def columns(case: str) -> Columns:
    """Stored columns of a case, nan for a quantity that was not held out."""
    found = look_up(DATA, case)
    return {name: np.array(found[name], dtype=float if name in NUMBERS else str) for name in (*TEXTS, *NUMBERS)}


def difference(case: str, measured: Columns) -> float:
    """Largest difference of a number from the stored one, relative to u_val; infinite if a text differs."""
    known = columns(case)
    if any(not np.array_equal(known[name], measured[name]) for name in TEXTS):
        return float("inf")
    off = [np.abs(known[name] - measured[name]) / known["u_val"] for name in NUMBERS]
    return float(np.nanmax(off))


def main(results: str) -> None:
    """Store the comparisons of a folder of results."""
    store = Store(results)
    cases = sorted(case for case, done in store.plan().items() if done.kind == "measured")
    found = {case: _texts_and_numbers(store.series(case)["measured"].columns) for case in cases}
    lines = ",\n".join(f'  "{case}": {json.dumps(found[case], ensure_ascii=False)}' for case in cases)
    about = "Measured quantities of all cases, nothing fitted and held out; written by validation.measured.stored"
    write_text(reference_file(DATA), f'{{\n "about": "{about}",\n "reference": {{\n{lines}\n }}\n}}\n')


def _texts_and_numbers(columns: Columns) -> dict[str, list[Any]]:
    texts = {name: columns[name].tolist() for name in TEXTS}
    numbers = {name: [None if np.isnan(x) else float(f"{x:.5g}") for x in columns[name]] for name in NUMBERS}
    return texts | numbers


if __name__ == "__main__":
    main(sys.argv[1])
