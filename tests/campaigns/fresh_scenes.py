"""Test the library with random scenes that use every key: `python -m tests.campaigns.fresh_scenes FIRST STOP` prints
failures.

The command prints and saves one line per scene, so a second call can continue. At the end it prints the numbers of
undetected wrong results, of needless errors and doubts for ordinary scenes, of tracebacks, and of used keys.
"""

import json
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import flexlink as fl
from docs.generators.keys import entries, records
from tests.campaigns.fresh_scene_checks import AlarmError, Judged
from tests.campaigns.fresh_scene_maker import FOLDER, Table

KINDS = ("silent", "error", "doubt", "traceback", "weak", "told")


def used(table: Table, path: str = "") -> Iterator[str]:
    """Paths of the keys of a table, without names and indices."""
    for key, value in table.items():
        here = f"{path}.{key}".lstrip(".")
        yield here
        items = list(value.values()) if here in {"material", "section", "rigidity"} else value
        for item in items if isinstance(items, list) else [items]:
            if isinstance(item, dict):
                yield from used(item, here)


def all_keys() -> list[str]:
    """Paths of all possible keys of a scene."""
    known: set[Any] = set()
    found = [f"{place}.{field.encode_name}".replace(".NAME", "").lstrip(".")
             for place, kind in records(fl.Scene, "", known) for field, _ in entries(kind)]  # fmt: skip
    bodies = [f"{where}.{key}" for where in ("link.end", "tip") for key in ("mass", "center", "inertia")]
    return [*found, *bodies]


def judged(seed: int, seconds: int = 60) -> Table:
    """Findings for a seed."""

    def late(*_: object) -> None:
        raise AlarmError

    began, one = time.process_time(), Judged(seed)
    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)  # CPU time
    try:
        one.judge()
    except AlarmError:
        one.report("error", f"more than {seconds} s")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    return {"seed": seed, "extreme": one.made.extreme, "found": one.found, "notes": one.notes,
            "keys": sorted(set(used(one.made.table))), "cpu": round(time.process_time() - began, 2)}  # fmt: skip


def summary(results: list[Table]) -> str:
    """Counts of scenes by finding, and rarely used keys."""
    lines = [
        f"{len(results)} scenes, {sum(bool(r['extreme']) for r in results)} at extremes, "
        f"{sum(r['cpu'] for r in results):.0f} s"
    ]
    for kind in KINDS:
        lines.append(f"{kind}: {sum(any(k == kind for k, _ in r['found']) for r in results)} scenes")
    count = Counter(key for r in results for key in r["keys"])
    rare = {key: count[key] for key in all_keys() if count[key] < 5}
    lines += [] if len(results) < 100 else [f"{len(all_keys())} keys; used by fewer than 5 scenes: {rare or 'none'}"]
    return "\n".join(lines)


def main() -> None:
    """Test the seeds that have no results yet."""
    first, stop = map(int, sys.argv[1:3])
    results = []
    FOLDER.mkdir(parents=True, exist_ok=True)
    for seed in range(first, stop):
        kept = FOLDER / f"result{seed}.json"
        result = json.loads(kept.read_text()) if kept.exists() else judged(seed)
        kept.write_text(json.dumps(result))
        findings = "; ".join(f"{kind.upper()} {text}" for kind, text in result["found"]) or "right"
        print(
            f"{seed} [{result['extreme'] or 'sane'}] {' '.join(result['notes'])} ({result['cpu']} s): {findings}",
            flush=True,
        )
        results.append(result)
    print(summary(results))


if __name__ == "__main__":
    main()
