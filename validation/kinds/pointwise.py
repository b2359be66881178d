"""Every term of the equation of motion against other engines, in random, balanced and stretched-out states."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.diagnosis.comparison import compare
from validation.case import Case, Measured
from validation.facts import Facts


def run(case: Case, engines: tuple[str, ...], samples: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest error of each quantity, engine and scene, with a diagnosis if it is too large."""
    for scene in case.load_scenes():
        comparison = compare(scene, engines=engines, samples=samples, seed=seed)
        why = {diagnosis.engine: str(diagnosis) for diagnosis in comparison.diagnoses}
        for row in comparison.rows:
            note = f"Largest at joint {row.joint!r}." if row.passed else why[row.engine]
            facts: Facts = {"states": samples}
            yield Measured(row.quantity, row.error, scene.name, row.engine, facts, note=note)
