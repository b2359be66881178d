"""Numbers in README and paper, taken from the full study; `python -m docs --readme` writes them again."""

from __future__ import annotations

import re
import statistics
from collections.abc import Sequence
from pathlib import Path

from docs.generators import badges, study
from flexlink.common.wording import plural

README = Path(__file__).parents[2] / "README.md"
PAPER = README.parent / "docs" / "paper" / "paper.md"

PROOF = [
    ("Given the exported file, Pinocchio and MuJoCo compute the same motion of the paper's arm: in five seconds the "
     "joint angles differ by {} at most.",
     "in the 5 s of the paper's figure 5"),
    ("A soft link of 1 m, turned by a motor, with 10 hinges against a continuous beam: the tip error is {}.",
     "against the continuous beam"),
    ("At extreme stiffness, mass, load and rate, runs that were wrong without a warning: {}.",
     "wrong without a warning"),
]  # fmt: skip
"""Sentences with {} for each number, and words of the study's headline that begins with this number."""
PREPARED = "{} / flexlink, prepared, error 0.0001"
PEERS = {"MuJoCo": "MuJoCo", "Pinocchio": "Pinocchio, its evaluations in a C++ loop, without the work of an integrator"}
"""Programs in the table of prepared simulations, and what of each is timed."""
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
    passed = f"{counts['passed']:,} of {counts['checks']:,}" if failing else f"all {counts['checks']:,}"
    return f"{_when()}: **{passed} checks pass**{lacking}{failing}.\n\n{_list(PROOF)}"


def ratios(peer: str) -> dict[str, float]:
    """CPU time of another program over flexlink's, by arm, for prepared simulations to a tip error of 10⁻⁴."""
    found = {row["scene"]: row["value"] for row in study.checks() if row["quantity"].startswith(PREPARED.format(peer))}
    return {arm: float(value) for arm, value in found.items()}


def speed() -> str:
    """CPU times of other programs, the typical one and the worst for flexlink, with date and commit."""
    found = {peer: ratios(peer) for peer in PEERS}
    arms = plural(max(map(len, found.values())), "arm")
    lines = [
        f"- {PEERS[peer]}: median {statistics.median(of.values()):.3g}, lowest {min(of.values()):.2g} "
        f"(in the arm “{min(of, key=lambda arm: of[arm])}”)"
        for peer, of in found.items()
    ]
    task = f"simulations of {arms} to a tip error of 10⁻⁴ of the motion, already prepared; CPU time over flexlink's"
    return f"{_when()}{_unsteady()}: {task} (below 1 flexlink is slower).\n\n" + "\n".join(lines)


def _unsteady() -> str:
    """A remark if the machine was busy while these simulations were timed."""
    states = [row["state"] for row in study.checks() if row["quantity"].startswith(tuple(map(PREPARED.format, PEERS)))]
    return ", partly on a busy or unsteady machine" if "not measured" in states else ""


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
    number = value.replace("\xa0", " ") if colon else re.match(r"\d+", headline)[0]  # type: ignore[index]
    return "none" if number == "0" else number
