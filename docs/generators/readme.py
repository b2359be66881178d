"""Numbers in README and paper, taken from the full study; `python -m docs --readme` writes them again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from docs.generators import badges, study
from flexlink.common.wording import plural

README = Path(__file__).parents[2] / "README.md"
PAPER = README.parent / "docs" / "paper" / "paper.md"

PROOF = [
    ("At the extremes of stiffness, mass, load and rate, runs that were wrong without a warning: {}.",
     "wrong without a warning"),
    ("{} hinges bring the first frequency of a clamped beam within 0.1 % of the exact value.",
     "hinges bring the first frequency of a clamped link"),
    ("A soft link of 1 m, swung up by a motor, with 10 hinges against the continuous beam: the tip error is {}.",
     "against the continuous beam"),
    ("Few segments against the exact solution of the same chain: relative difference {} at most.",
     "against exact solutions for such chains"),
    ("Given our exported file, Pinocchio and MuJoCo compute the same mass matrix at random states: the largest "
     "difference is {} (1 or less means equal to within rounding).", "the mass matrix from Pinocchio and MuJoCo"),
    ("Their torque terms differ from ours by at most {}, their accelerations by at most {}.",
     "largest difference of the torque terms", "largest difference of the accelerations"),
    ("Five seconds of the paper's figure 5 in the three programs: joint angles agree to {}.",
     "in the 5 s of the paper's figure 5"),
    ("Drake and Exudyn, with their own springs and integrators: joint angles agree to {}.",
     "complete motions from Drake and Exudyn"),
]  # fmt: skip
SPEED = [
    ("A simulation with a tip error of 10⁻⁴ of the motion takes MuJoCo {} × flexlink's CPU time or more, on "
     "arms where it reaches this error.",
     "lowest ratio of MuJoCo's CPU time to flexlink's"),
    ("The same simulation with Pinocchio's dynamics in a loop takes {} × flexlink's CPU time or more.",
     "lowest ratio of Pinocchio's CPU time to flexlink's"),
    ("One forward dynamics in a compiled loop, 10 to 400 joints: {} × the speed of pin.aba or more.",
     "forward dynamics of planar chains in a compiled loop"),
    ("The same as one call from Python, which checks its arguments: {} × the speed of pin.aba or more (below 1 "
     "is slower).",
     "for the same task as a checked call from Python"),
    ("The paper's figure 5 with RK4 at its own step: {} or more.", "the paper's figure 5 on one core"),
]  # fmt: skip
"""Sentences with {} for each number, and words of the study's headline that begins with this number."""
PICTURES = (
    ("trade_overview",
     "Cost of a tip error of a thousandth of the arm's length in ten scenes, and what `advise` picks "
     "([all errors](docs/explanation/trade.md)):",
     "CPU time of every contestant in ten scenes for an error of a thousandth of the length"),
    ("speed_trade-t3.t3.work",
     "Time against error for one of these arms, where the ratios are larger:",
     "CPU time against tip error of flexlink, Pinocchio, MuJoCo, SciPy and CVODE for a three-link arm"),
)  # fmt: skip
"""Stored figure, sentence before it and its description; the first that is stored is shown."""


def proof() -> str:
    """What the study found, with its date and commit."""
    counts, missing = study.counts(), study.stored().get("missing", ())
    lacking = f"; {plural(len(missing), 'case')} missing: {', '.join(missing)}" if missing else ""
    failing = "".join(f"; fails: {row['case']}, {row['quantity']}" for row in study.failing())
    checks = f"**{counts['passed']:,} of {counts['checks']:,} checks pass**"
    return f"{_when()}: {checks} in {counts['cases']} cases{lacking}{failing}.\n\n{_list(PROOF)}"


def speed() -> str:
    """CPU times of other programs, with date and commit."""
    return f"{_when()}; the lowest ratio of all arms in the study:\n\n{_list(SPEED)}"


def with_tables(text: str) -> str:
    """A text with both lists and the picture of the trade as the stored study has them."""
    for name, found in (("proof", proof()), ("speed", speed())):
        begin, end = f"<!-- {name}: python -m docs --readme writes this list -->\n", f"\n<!-- end of {name} -->"
        before, _, rest = text.partition(begin)
        text = before + begin + found + end + rest.partition(end)[2]
    return with_picture(text)


def with_picture(text: str, folder: Path = study.FULL) -> str:
    """A text in which the picture of the trade, if it has one, is the first of `PICTURES` that is stored."""
    shown = [f"{sentence}\n\n![{about}](reports/full/{name}.png)" for name, sentence, about in PICTURES]
    wanted = next(
        block for block, (name, *_) in zip(shown, PICTURES, strict=True) if (folder / f"{name}.png").is_file()
    )
    for block in shown:
        text = text.replace(block, wanted)
    return text


def write() -> None:
    """Write the lists of README and paper, and the badges."""
    for file in (README, PAPER):
        file.write_text(with_tables(file.read_text(encoding="utf-8")), encoding="utf-8")
    badges.write()


def _when() -> str:
    date, commit = str(study.stored()["measured"])[:10], str(study.stored()["commit"])[:8]
    return f"Measured {date} at commit {commit}"


def _list(sentences: Sequence[tuple[str, ...]]) -> str:
    return "\n".join(f"- {text.format(*map(_number, words))}" for text, *words in sentences)


def _number(words: str) -> str:
    """The number at the beginning of the one headline with these words."""
    headlines: list[str] = [each for chapter in study.stored()["chapters"] for each in chapter["headlines"]]
    (headline,) = (each for each in headlines if words in each)
    value, colon, _ = headline.partition(":")
    return value.replace("\xa0", " ") if colon else re.match(r"\d+", headline)[0]  # type: ignore[index]
