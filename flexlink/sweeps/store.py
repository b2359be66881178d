"""Store the rows of one sweep in an SQLite database; each row is on disk as soon as its task is done.

    about(name, value)                             fingerprint of the sweep, as JSON; of a part also its part, "17/200"
    rows(number, status, reason, warnings, …)      one row per member; … are the varied values, by key, and the outputs
    checks(number, sum)                            a checksum per row, since SQLite has none: damage changes no result

With a write-ahead log (WAL), committed rows survive a crash at any moment, and other processes can read concurrently.
The writer keeps SQLite's write lock except during a commit, so a second writer gets an error.
"""

import contextlib
import itertools
import json
import re
import sqlite3
import time
import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from flexlink.common.errors import ArgumentError, OutputError
from flexlink.sweeps.plan import ROW_COLUMNS, Fingerprint, Plan, differences
from flexlink.sweeps.statistics import Summary, decode, empty, encode, ranges, table

APPLICATION_ID = 0x666C7877  # SQLite application id of sweep databases, "flxw"; other databases are not touched

LOCK_TIMEOUT = 1.0  # longest wait for a commit by another process [s]; a commit takes milliseconds


class Store:
    """Database of a sweep or of one of its parts, open for writing, or refused; in memory if `path` is None."""

    def __init__(
        self, path: Path | None, plan: Plan, identity: Fingerprint, *, part: str | None = None, fresh: bool = False
    ) -> None:
        self.path, self.plan, self.part = path, plan, part
        self.identity: Fingerprint = json.loads(json.dumps(identity))  # as it is stored
        self.members = plan.numbers(part)
        if fresh and path is not None and path.exists():
            self._remove(path)
        with errors_of(path):
            self._db = sqlite3.connect(path or ":memory:", timeout=LOCK_TIMEOUT, isolation_level=None)
        try:
            with errors_of(path):
                self._open(self.identity | ({"part": part} if part else {}))
        except BaseException:
            self._db.close()
            raise

    def _open(self, identity: Fingerprint) -> None:
        run = self._db.execute
        run("BEGIN EXCLUSIVE")  # must precede the check, because another sweep may be creating the same file
        if not _is_ours(self._db):
            run(f"PRAGMA application_id = {APPLICATION_ID}")
            run("CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL)")
            self._create()
            run("INSERT INTO about VALUES ('identity', ?)", (json.dumps(identity, ensure_ascii=False),))
        run("COMMIT")  # before WAL, so that the file itself (not the log) identifies its owner
        run("PRAGMA journal_mode = WAL")
        run("PRAGMA synchronous = NORMAL")  # if the machine crashes, the last rows may be computed again
        run("BEGIN IMMEDIATE")
        if run("PRAGMA quick_check(1)").fetchone()[0] != "ok":
            raise sqlite3.DatabaseError("database disk image is malformed")
        changed = differences(_identity(self._db), identity)
        if changed:
            why = f"{self.path}: has rows of another sweep: {changed}; use another file, or start again (--fresh)"
            raise ArgumentError(why, id="rows-of-another-sweep")
        self._check_rows()

    @property
    def _names(self) -> tuple[str, ...]:
        return (*ROW_COLUMNS, *self.plan.sweep.keys, *self.plan.sweep.quantity)

    def _create(self) -> None:
        kinds = ("INTEGER PRIMARY KEY", *["TEXT NOT NULL"] * 3, *[""] * (len(self._names) - 4))
        quoted = [name.replace('"', '""') for name in self._names]
        columns = ", ".join(f'"{name}" {kind}' for name, kind in zip(quoted, kinds, strict=True))
        self._db.execute(f"CREATE TABLE rows ({columns})")

    def _check_rows(self) -> None:
        """Compare every row with its checksum; a new store, and one of an older version, gets a table of them."""
        if not self._db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'checks'").fetchone()[0]:
            self._db.execute("CREATE TABLE checks (number INTEGER PRIMARY KEY, sum INTEGER NOT NULL)")
            self._add_checks(0, self.plan.members)
        found = self._db.execute("SELECT rows.*, checks.sum FROM rows LEFT JOIN checks USING (number)")
        there = tuple(column[0] for column in found.description[:-1])
        changed = [n for n, *row, sum_ in found if n not in self.members or _sum((n, *row)) != sum_]
        if changed or there != self._names:
            raise ValueError(f"row {changed[0]} has changed" if changed else "other columns")

    def _add_checks(self, first: int, last: int) -> None:
        """Add checksums of the rows in a range of numbers, as SQLite returns them."""
        where = "WHERE rows.number BETWEEN ? AND ? AND checks.number IS NULL"
        found = self._db.execute(f"SELECT rows.* FROM rows LEFT JOIN checks USING (number) {where}", (first, last))
        self._db.executemany("INSERT INTO checks VALUES (?, ?)", [(row[0], _sum(row)) for row in found.fetchall()])

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the lock; every added row remains."""
        with contextlib.suppress(sqlite3.Error):
            self._db.rollback()
            self._db.close()

    def add(self, rows: Iterable[Any]) -> None:
        """Add and commit rows of members that do not have a row yet."""
        rows = list(rows)
        lines = [(*row[:4], *map(_kept, self.plan.values(row.number).values()), *row.values) for row in rows]
        if lines:
            marks = ", ".join("?" * len(lines[0]))
            with errors_of(self.path, "; earlier rows remain, and the same command continues from there"):
                self._db.executemany(f"INSERT INTO rows VALUES ({marks})", lines)
                self._add_checks(min(row.number for row in rows), max(row.number for row in rows))
                self._commit()
            self._require_file()

    def _require_file(self) -> None:
        if self.path is not None and not self.path.exists():
            gone = "was removed or renamed while the sweep ran, so its rows are lost; run the sweep again"
            raise OutputError(f"{self.path}: {gone}", id="cannot-write")

    def take(self, part: "Store") -> None:
        """Add and commit the rows of a part, and their checksums, as they are; rows that are there stay."""
        with errors_of(self.path):
            for name in ("rows", "checks"):
                found = part._db.execute(f"SELECT * FROM {name}")
                marks = ", ".join("?" * len(found.description))
                self._db.executemany(f"INSERT OR IGNORE INTO {name} VALUES ({marks})", found)
            self._commit()

    def _commit(self) -> None:
        self._db.execute("COMMIT")
        self._db.execute("BEGIN IMMEDIATE")  # takes the lock again before another process can take it

    def missing(self) -> Iterator[int]:
        """Numbers of the members without a row, in order; rows may be added during the iteration."""
        together = 65_536  # number of members to look up together
        for first in range(self.members.start, self.members.stop, together):
            within = first, min(first + together, self.members.stop)
            found = self._db.execute("SELECT number FROM rows WHERE number >= ? AND number < ?", within)
            have = {number for (number,) in found}
            yield from (number for number in range(*within) if number not in have)

    def count(self, status: str | None = None) -> int:
        """Number of rows with a status; of all rows if it is None."""
        where, values = ("", ()) if status is None else (" WHERE status = ?", (status,))
        return int(self._db.execute(f"SELECT count(*) FROM rows{where}", values).fetchone()[0])

    def failures(self) -> tuple[int, str]:
        """Number of failed members, and the reason of the first."""
        count = self.count("failed")
        first = "SELECT number, reason FROM rows WHERE status = ? ORDER BY number LIMIT 1"
        return count, "member {}: {}".format(*self._db.execute(first, ("failed",)).fetchone()) if count else ""

    def table(self) -> tuple[list[str], Iterator[tuple[Any, ...]]]:
        """Names of the columns, and the rows in the order of their numbers."""
        found = self._db.execute("SELECT * FROM rows ORDER BY number")
        return [column[0] for column in found.description], iter(found)

    def _remove(self, path: Path) -> None:
        """Delete the database; raise an error if another process writes to it or it belongs to another program."""
        with errors_of(path), contextlib.closing(sqlite3.connect(path, timeout=LOCK_TIMEOUT)) as db:
            db.execute("BEGIN IMMEDIATE")
            _is_ours(db)
        with errors_of(path):
            for end in ("", "-wal", "-shm"):
                path.with_name(path.name + end).unlink(missing_ok=True)


class SummaryStore(Store):
    """Database of the statistics of a sweep, whose members have no rows; written once a second.

    summary(content, sum)                          the `Summary` of all members so far, as JSON, and its checksum
    """

    total: Summary
    _written = 0.0

    def _create(self) -> None:
        self._db.execute("CREATE TABLE summary (content TEXT NOT NULL, sum INTEGER NOT NULL)")
        self._db.execute("INSERT INTO summary VALUES (?, ?)", _summed(encode(empty())))

    def _check_rows(self) -> None:
        self.total = _summary_in(self._db)

    def add(self, rows: Iterable[Any]) -> None:
        """Add summaries of members that have none yet."""
        for summary in rows:
            self.total.add(summary)
        if time.monotonic() - self._written > 1.0:
            self._write()

    def _write(self) -> None:
        with errors_of(self.path, "; the same command continues from the last second"):
            self._db.execute("UPDATE summary SET content = ?, sum = ?", _summed(encode(self.total)))
            self._commit()
        self._require_file()
        self._written = time.monotonic()

    def close(self) -> None:
        """Write what was added last, and release the lock."""
        try:
            if hasattr(self, "total"):
                self._write()
        finally:
            super().close()

    def take(self, part: Store) -> None:
        """Add and write the summary of a part, unless it was added before."""
        assert isinstance(part, SummaryStore)
        both = ranges([*self.total.members, *part.total.members])
        new = sum(stop - first for first, stop in both) - self.count()
        if new not in {0, part.count()}:
            raise _refusal(f"{self.path}: has some members of part {part.part} already; merge into another file")
        if new:
            self.total.add(part.total)
            self._write()

    def missing(self) -> Iterator[int]:
        """Numbers of the members that are not in the summary, in order."""
        ends = [(self.members.start,) * 2, *self.total.members, (self.members.stop,) * 2]
        for (_, stop), (first, _) in itertools.pairwise(ends):
            yield from range(stop, first)

    def count(self, status: str | None = None) -> int:
        """Number of members in the summary; of failed ones if `status` is "failed"."""
        done = sum(stop - first for first, stop in self.total.members)
        failed = self.total.sums["failed",]
        return done if status is None else failed if status == "failed" else done - failed

    def failures(self) -> tuple[int, str]:
        """Number of failed members, and the reason of the first."""
        return self.count("failed"), "".join(f"member {number}: {reason}" for number, reason in self.total.failed)

    def table(self) -> tuple[list[str], Iterator[tuple[Any, ...]]]:
        """Names of the columns, and one row for each output."""
        return table(self.plan, self.total)


def store_of(plan: Plan) -> type[Store]:
    """Kind of the database of a sweep: of rows or of statistics."""
    return Store if plan.sweep.statistics is None else SummaryStore


def _summed(content: str) -> tuple[str, int]:
    return content, zlib.crc32(content.encode())


def _summary_in(db: sqlite3.Connection) -> Summary:
    content, sum_ = db.execute("SELECT content, sum FROM summary").fetchone()
    if _summed(content)[1] != sum_:
        raise ValueError("the summary has changed")
    return decode(content)


@contextlib.contextmanager
def errors_of(path: Path | None, then: str = "") -> Iterator[None]:
    """Convert SQLite's errors to an OutputError in one line; `then` is appended if a database cannot be written."""
    try:
        yield
    except ArgumentError:
        raise
    except (sqlite3.Error, OSError, ValueError, TypeError, RecursionError) as error:
        text = str(error)
        if "locked" in text or isinstance(error, sqlite3.IntegrityError):
            why = "another process is writing to it; wait until it ends, or use another file"
        elif not isinstance(error, sqlite3.Error | OSError) or re.search("malformed|no such|decode", text):
            why = f"is damaged ({text}); use another file, or start again (--fresh)"
        elif "another program's" in text or "not a database" in text:
            why = f"is not a database of a sweep ({text}), and stays unchanged; use another file"
        else:
            why = f"cannot be written: {text}{then}"
        raise OutputError(f"{path}: {why}", id="cannot-write") from None


def stored(path: Path) -> tuple[Fingerprint, int]:
    """Fingerprint and number of rows of a database."""
    with errors_of(path), contextlib.closing(sqlite3.connect(path, timeout=LOCK_TIMEOUT)) as db:
        _is_ours(db)
        identity = _identity(db)
        if identity.get("statistics"):
            return identity, sum(stop - first for first, stop in _summary_in(db).members)
        return identity, db.execute("SELECT count(*) FROM rows").fetchone()[0]


def _identity(db: sqlite3.Connection) -> Fingerprint:
    return dict(json.loads(db.execute("SELECT value FROM about WHERE name = 'identity'").fetchone()[0]))


def _is_ours(db: sqlite3.Connection) -> bool:
    """Whether a database is the database of a sweep; False for a new one, an error for that of another program."""
    ours = bool(db.execute("PRAGMA application_id").fetchone()[0] == APPLICATION_ID)
    if not ours and db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        raise sqlite3.DatabaseError("another program's database")
    return ours


def _sum(row: Sequence[Any]) -> int:
    """Checksum of a row."""
    return zlib.crc32(repr(list(row)).encode())


def _kept(value: Any) -> float | int | str | None:
    """Convert a varied value to a number or text; lists and tables become JSON."""
    if isinstance(value, float | str) or value is None:
        return value
    return value if type(value) is int and abs(value) < 2**63 else msgspec.json.encode(value).decode()


# Merge the databases of all parts of a sweep into one, whose rows are bit for bit those of a sweep in one piece.


def take_parts(store: Store, files: Sequence[Path]) -> None:
    """Add the rows of all parts, if files are given; refuse missing, unfinished, double and foreign parts."""
    if not files:
        return
    if store.part:
        raise ArgumentError(f"part = '{store.part}': merge is also given; specify only one", id="both-given")
    for part, path in _complete(store, files).items():
        with type(store)(path, store.plan, store.identity, part=part) as each:
            store.take(each)


def _complete(store: Store, files: Sequence[Path]) -> dict[str, Path]:
    """Databases by part, after checking that each part is there once, with all its rows."""
    found: dict[str, Path] = {}
    done: dict[str, int] = {}
    for path in files:
        if path.is_file() and path.stat().st_size:  # otherwise its part is missing
            part, rows = _part_in(path, store)
            if part in found:
                raise _refusal(f"{path}: has part {part}, as {found[part]} has; leave one out")
            found[part], done[part] = path, rows
    if not found:
        raise _refusal(f"{files[0]}: no such file; run the parts first (--part 1/200)")
    count = next(iter(found)).partition("/")[2]
    parts = [f"{k}/{count}" for k in range(1, int(count) + 1)]
    for part in found.keys() - {*parts}:
        raise _refusal(f"{found[part]}: has part {part}, not one of {count}; leave it out")
    left = [k for k, part in enumerate(parts, 1) if done.get(part, 0) < len(store.plan.numbers(part))]
    if left:
        which = f"part{'s' * (len(left) > 1)} {_ranges(left)} of {count}"
        raise _refusal(f"{which}: missing or unfinished; run again (--part {left[0]}/{count}), then merge")
    return found


def _part_in(path: Path, store: Store) -> tuple[str, int]:
    """Part of the sweep in a database, and its number of rows."""
    identity, rows = stored(path)
    part = identity.pop("part", None)
    if part is None:
        raise _refusal(f"{path}: has a whole sweep, not a part; leave it out")
    store.plan.numbers(part)
    if changed := differences(identity, store.identity):
        raise _refusal(f"{path}: has part {part} of another sweep: {changed}; run it again (--part {part} --fresh)")
    return part, rows


def _refusal(text: str) -> ArgumentError:
    return ArgumentError(text, id="cannot-merge")


def _ranges(numbers: Iterable[int]) -> str:
    """Numbers as ranges, 1-3,7, in the form that job arrays take."""
    first = sorted({*numbers} - {k + 1 for k in numbers})
    last = sorted({*numbers} - {k - 1 for k in numbers})
    return ",".join(f"{a}" if a == b else f"{a}-{b}" for a, b in zip(first, last, strict=True))
