"""Tables of the README, from the numbers of the full study; `python -m docs --readme` writes them."""

from __future__ import annotations

from pathlib import Path

from docs.generators import study

README = Path(__file__).parents[2] / "README.md"

PROOF = [
    ("mass matrix against Pinocchio and MuJoCo, random states", "the mass matrix from Pinocchio and MuJoCo"),
    ("torque terms, the same", "largest difference of the torque terms"),
    ("accelerations, the same", "largest difference of the accelerations"),
    ("joint angles after 5 s of the paper's figure 5, three engines", "in the 5 s of the paper's figure 5"),
    ("whole motions in Drake and Exudyn, their own springs and steps", "whole motions by Drake and Exudyn"),
    ("chains of few segments against exact solutions", "against exact solutions for such chains"),
    ("a driven link of 10 hinges against the continuous beam", "against the continuous beam"),
    ("at the extremes of stiffness, mass, load and rate", "wrong without a warning"),
]
SPEED = [
    ("a run with a tip error of 10⁻⁴ of the motion, MuJoCo", "MuJoCo, for a tip error"),
    ("the same, Pinocchio's dynamics in a loop", "Pinocchio, for the same error"),
    ("one forward dynamics, n = 10 … 400, compiled loop", "forward dynamics of planar chains in a compiled loop"),
    ("the same, as a checked call from Python", "the same as a checked call from Python"),
    ("the paper's figure 5, RK4 at its own step", "the paper's figure 5 on one core"),
]
"""Rows: the quantity, and words that identify the sentence of the study whose text before the colon is the number."""


def proof() -> str:
    """Return the table of the study's verdicts."""
    counts = study.counts()
    verdict = f"**{counts['passed']:,} of {counts['checks']:,} checks pass**, in {counts['cases']} cases"
    return f"{_table('compared', 'largest difference', PROOF)}\n\n{verdict}."


def speed() -> str:
    """Return the table of CPU times compared with other engines."""
    return _table("job", "time of others", SPEED)


def with_tables(text: str) -> str:
    """Return the README with both tables from the stored study."""
    for name, table in (("proof", proof()), ("speed", speed())):
        begin, end = f"<!-- {name}: python -m docs --readme writes this table -->\n", f"\n<!-- end of {name} -->"
        before, _, rest = text.partition(begin)
        text = before + begin + table + end + rest.partition(end)[2]
    return text


def _table(left: str, right: str, rows: list[tuple[str, str]]) -> str:
    lines = [f"| {label} | {_number(words)} |" for label, words in rows]
    return "\n".join([f"| {left} | {right} |", "|---|---|", *lines])


def _number(words: str) -> str:
    """Return the text before the colon of the only sentence with these words; without a colon, the sentence itself."""
    sentences: list[str] = [each for chapter in study.stored()["chapters"] for each in chapter["headlines"]]
    (sentence,) = (each for each in sentences if words in each)
    value, colon, _ = sentence.partition(":")
    return value.replace("\xa0", " ") if colon else sentence.removesuffix(".")
