"""Merge the databases of all parts of a sweep into one, whose rows are bit for bit those of a sweep in one piece."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from flexlink.common.errors import ArgumentError
from flexlink.sweeps.plan import differences
from flexlink.sweeps.store import Store, stored


def take_parts(store: Store, files: Sequence[Path]) -> None:
    """Add the rows of all parts, if files are given; refuse missing, unfinished, double and foreign parts."""
    if not files:
        return
    if store.part:
        raise ArgumentError(f"part = '{store.part}': merge is also given; specify only one", id="both-given")
    for part, path in _complete(store, files).items():
        with Store(path, store.plan, store.identity, part=part) as each:
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
