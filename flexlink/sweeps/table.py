"""Rows of a sweep as Python objects, as a pandas DataFrame, and as files."""

import csv
import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import imported
from flexlink.common.notebook import html_table
from flexlink.common.output import write_whole
from flexlink.common.wording import plural


@dataclasses.dataclass(frozen=True, repr=False)
class SweepRows:
    """Rows of a sweep, in the order of their numbers.

    Attributes
    ----------
    columns
        number, status ("done" or "failed"), reason, warnings, then the varied keys and the outputs.
    rows
        One tuple per member; None if an output could not be computed.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def __repr__(self) -> str:
        return f"<SweepRows: {plural(len(self.rows), 'row')} of {', '.join(self.columns)}>"

    def _repr_html_(self) -> str:
        shown = [tuple("" if value is None else value for value in row) for row in self.rows]
        return html_table(f"{plural(len(self.rows), 'row')}, {len(self.failed)} failed", self.columns, shown)

    def column(self, name: str) -> list[Any]:
        """Return a column by its name; `rows["tip.mass"]` returns it as well."""
        k = require_one_of("name", name, {known: k for k, known in enumerate(self.columns)})
        return [row[k] for row in self.rows]

    __getitem__ = column

    @property
    def failed(self) -> dict[int, str]:
        """Reasons why outputs are missing, by the number of the member."""
        return {row[0]: row[2] for row in self.rows if row[1] == "failed"}

    def to_pandas(self) -> Any:
        """Return all rows as a pandas.DataFrame; the index is the first column.

        Raises
        ------
        MissingDependencyError
            pandas is not installed.
        """
        return frame(self.columns, self.rows)


def frame(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Any:
    """Return rows as a DataFrame."""
    pandas = imported("pandas", "this table needs pandas;", "pandas")
    return pandas.DataFrame(list(rows), columns=list(columns)).set_index(columns[0])


def export(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write rows to a file in the format of the file's extension; if this fails, no partial file remains."""
    if path.suffix == ".csv":
        write_whole(path, lambda file: _write_csv(file, columns, rows))
        return
    require_parquet()
    table = frame(columns, rows)
    write_whole(path, lambda file: table.to_parquet(file, engine="pyarrow"))


def require_parquet() -> None:
    """Check that Parquet files can be written."""
    for name in ("pandas", "pyarrow"):
        imported(name, f"this table needs {name};", "pandas pyarrow")


def _write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write numbers with all their digits, and None as an empty field."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
