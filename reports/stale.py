"""Whether the stored full study is of the present code: cases that a change has touched, and cases that it lacks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from flexlink.common.errors import FlexlinkError
from flexlink.common.wording import plural
from reports.stored_full import COMMAND, read, read_sources
from validation import dependencies
from validation.case import ALL, load_cases


class Staleness(NamedTuple):
    """Cases of the present code: those whose stored results are valid, those that were touched and why, the missing."""

    commit: str
    valid: tuple[str, ...]
    touched: dict[str, str]
    missing: tuple[str, ...]
    dropped: tuple[str, ...]  # stored cases that the study no longer has

    @property
    def current(self) -> bool:
        """Whether all results are those of the present code."""
        return not (self.touched or self.missing or self.dropped)

    def lines(self) -> Iterator[str]:
        """A line for every case that is not current."""
        yield from (f"{case}: {why}" for case, why in self.touched.items())
        yield from (f"{case}: not in the stored study" for case in self.missing)
        yield from (f"{case}: stored, but no longer a case" for case in self.dropped)

    def sentence(self) -> str:
        """The result in one or two sentences."""
        commit = f"at commit {self.commit}" if self.commit else "outside a repository"
        cases = plural(len(self.valid) + len(self.touched) + len(self.missing), "case")
        counts = f"{len(self.valid)} current, {len(self.touched)} touched by changes, {len(self.missing)} missing"
        found = f"The stored study was measured {commit}. State of {cases}: {counts}."
        return found if self.current else f"{found} To measure the others: {COMMAND}."


def check(folder: Path) -> Staleness:
    """Compare the hashes in a stored full study with those of the present code.

    Raises
    ------
    FlexlinkError
        The folder contains no full study.
    """
    stored = read(folder)
    if stored is None:
        raise FlexlinkError(f"{folder}: no full study; make one with: {COMMAND}", id="file-content")
    keys, then = stored.study.keys, read_sources(folder)
    files = dependencies.of_cases(load_cases(*ALL))
    touched = {
        case: dependencies.changes(own, {path: then[path] for path in own if path in then}) or "stored without its hash"
        for case, own in files.items()
        if case in keys and keys[case] != dependencies.key(own)
    }
    valid = tuple(case for case in files if case in keys and case not in touched)
    missing, dropped = (tuple(c for c in one if c not in other) for one, other in ((files, keys), (keys, files)))
    return Staleness(stored.study.commit, valid, touched, missing, dropped)
