"""The whole long study, checked in under reports/full: page, CSV, PNG, and by which command and on what it was made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import write_text
from flexlink.reporting.tables import table_csv
from reports.build import build, environment_rows
from reports.results import Results
from validation.judgement import crowd

FOLDER = Path(__file__).parent / "full"
COMMAND = "python -m validation --full"
MOST = 10_000_000  # bytes: what a repository may hold of generated files
WRITTEN = ("*.html", "*.csv", "*.png")


def save(results: Path, folder: Path = FOLDER) -> Path:
    """Write the report of a study in place of the one that is there; returns its page.

    Raises
    ------
    FlexlinkError
        There are no readable results, the folder cannot be written, or holds more than `MOST` bytes then.
    """
    study = Results.read(results)
    for pattern in WRITTEN:  # figures of cases that are no more
        for file in folder.glob(pattern):
            file.unlink()
    page = build(results, folder, svg=False)
    write_text(folder / "machine.csv", table_csv(("what", "value"), _machine(study)))
    sizes = {file.name: file.stat().st_size for file in folder.iterdir()}
    if sum(sizes.values()) > MOST:
        largest = sorted(sizes, key=lambda name: -sizes[name])[:3]
        told = ", ".join(f"{name} {sizes[name] / 1e6:.1f} MB" for name in largest)
        raise FlexlinkError(
            f"{folder}: {sum(sizes.values()) / 1e6:.1f} MB, more than the {MOST / 1e6:g} MB that are checked in; "
            f"the largest: {told}"
        )
    return page


def _machine(study: Results) -> Iterator[tuple[str, str]]:
    """The command, machine and versions; when each case ended, how long it took, and what the machine did besides."""
    yield "command", COMMAND
    yield from environment_rows(study.environment)
    for case, done in study.finished.items():
        took = f"{sum(row.seconds for row in study.cases.get(case, ())):.1f} s"
        besides = (crowd(done.conditions),) if done.conditions else ()
        yield case, "; ".join((f"{done.date:%Y-%m-%d %H:%M} UTC", took, done.machine, *besides))
    for missing in study.missing:
        yield missing.case, missing.why
