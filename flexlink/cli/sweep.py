"""The command `flexlink sweep`."""

import argparse
import contextlib
import time
from pathlib import Path

from msgspec.structs import replace

from flexlink.chain.arguments import integer
from flexlink.cli.shared import assignments, prefix_errors, print_hints, print_lines, print_path, require_writable
from flexlink.common.errors import ArgumentError, Diagnostic, FlexlinkError
from flexlink.common.progress import Progress, clock
from flexlink.describe.plausibility.hints import hints
from flexlink.sweeps.plan import Plan, Sweep, fingerprint
from flexlink.sweeps.run import fill, preflight
from flexlink.sweeps.store import store_of, take_parts
from flexlink.sweeps.table import export, require_parquet
from flexlink.sweeps.workers import MAX_WORKERS, pool_of


def run_command(options: argparse.Namespace) -> int:
    """Run members without a stored result, print a summary, and export results; exit with 1 if all members failed."""
    plan = _planned(options)
    end = f"-{options.part.partition('/')[0]}.db" if options.part else ".db"
    out = options.out or Path(options.sweep.stem + end)
    if out.suffix in {".csv", ".parquet", ".json", ".xlsx"}:
        raise ArgumentError(f"--out {out}: is a database (.db); tables are written by --export", id="unknown-format")
    require_writable(out)
    integer("--workers", options.workers, 1, MAX_WORKERS)
    if options.export == "parquet":
        require_parquet()
    with store_of(plan)(out, plan, fingerprint(plan.sweep), part=options.part, fresh=options.fresh) as store:
        take_parts(store, options.merge)
        members, done, begun = len(store.members), store.count(), time.perf_counter()
        bar = Progress(plan.sweep.scene.name, done / max(members, 1), parts=members, what="members")
        try:
            fill(store, pool_of(None, options.workers, options.dask), bar)
        finally:
            bar.clear()
        seconds, (failed, first) = time.perf_counter() - begun, store.failures()
        if failed:
            print_lines("warning", [f"{failed} of {members} members failed; {first}"])
        there = f", {done} stored before" if done else ""
        print(f"{plan.sweep.scene.name}: {members - done} members run in {clock(seconds)}{there}")
        for name, *_, mean, deviation in (row[:6] for row in store.table()[1] if plan.sweep.statistics):
            known = "no member has it" if mean is None else f"mean {mean:.6g}, deviation {deviation:.3g}"
            print(f"{name}: {known}")
        print(f"results: {store.path}")
        if options.export:
            place = out.with_suffix(f".{options.export}")
            export(place, *store.table())
            print_path("table", place)
        return int(0 < failed == members)


def _planned(options: argparse.Namespace) -> Plan:
    """Load and check the plan in a file, with the values of `--set` applied to all members."""
    sweep = Sweep.load(options.sweep)
    changes = assignments("--set", options.set, "run.step=1e-4", "PATH=VALUE")
    with prefix_errors(options.sweep):
        plan = Plan(replace(sweep, set={**sweep.set, **changes}))
        preflight(plan)
    found: dict[str, Diagnostic] = {}
    for number in (0, plan.members - 1):  # once for each path
        with contextlib.suppress(FlexlinkError):  # the error is stored later, in this member's row
            found = {hint.partition(" = ")[0]: hint for hint in hints(plan.member(number)[0])} | found
    print_hints(found.values(), options)
    return plan
