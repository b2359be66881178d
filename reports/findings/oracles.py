"""What each independent reference shares with flexlink, from oracles.toml and from the imports of its source files."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from flexlink.data.documents import read_toml
from flexlink.describe.spec import Spec, decode
from flexlink.pages.tables import Table
from reports.findings import finding
from reports.results import Results
from validation.sources import ROOT

FILE = Path(__file__).parent.parent / "oracles.toml"
ORACLES = ROOT / "validation" / "oracles"
TYPES = {"flexlink.common.types", "flexlink.common.errors"}
"""Modules of types and errors, which contain no numbers."""
HEADS = ("independent reference", "shares with flexlink", "does independently", "imports from flexlink")
KINDS = {"judge", "judge_trees", "measured", "manufactured"}  # the table is shown if a case has one of these kinds


class Judge(Spec, frozen=True):
    """An independent reference: a program, an oracle of the study, formulas or experiments."""

    name: str
    shares: str
    own: str
    files: tuple[str, ...] = ()  # of validation/oracles/

    @property
    def imports(self) -> tuple[str, ...]:
        """Modules of flexlink that its files import, directly or through other oracles, except types and errors."""
        return tuple(sorted(set().union(*map(imports_of, self.files)) - TYPES))


class Judges(Spec, frozen=True):
    """All entries of oracles.toml."""

    judge: tuple[Judge, ...]


def judges() -> tuple[Judge, ...]:
    """All independent references, in order."""
    found: Judges = decode(read_toml(FILE), Judges)
    return found.judge


def imports_of(oracle: str) -> set[str]:
    """Modules of flexlink that a file in validation/oracles/ imports, directly or through another such file."""
    tree = ast.parse((ORACLES / f"{oracle}.py").read_text(encoding="utf-8"))
    own = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    modules = {node.module or "" for node in own}
    modules |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    inside = modules | {f"{node.module}.{alias.name}" for node in own for alias in node.names}
    others = {name.split(".")[2] for name in inside if name.startswith("validation.oracles.")}
    found = {name for name in modules if name.partition(".")[0] == "flexlink"}
    return found.union(*map(imports_of, others))


@finding("agreement")
def oracles(results: Results) -> Iterator[Table]:
    """One table, if the study has a case of the kinds `KINDS`."""
    if not KINDS.isdisjoint(planned.kind for planned in results.plan.values()):
        lines = tuple(
            (j.name, j.shares, j.own, ", ".join(name.removeprefix("flexlink.") for name in j.imports) or "–")
            for j in judges()
        )
        title = "Independent references and what they share with flexlink"
        yield Table("judges", title, HEADS, lines, (), to_look_up=True)
