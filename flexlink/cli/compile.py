"""The command `flexlink compile`."""

import argparse
import concurrent.futures
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from flexlink.cli import rehearsal
from flexlink.cli.rehearsal import KINDS
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.progress import Progress, clock
from flexlink.kernels.tools.code_files import ARCHIVE, FAMILIES, Cpu, cache_folder, pack, state
from flexlink.kernels.tools.machine_code import families_here, here

families = ", ".join(FAMILIES)  # in the help text in `options.toml`


def run_command(options: argparse.Namespace) -> int:
    """Compile for each processor family in turn."""
    cpus, begun = options.cpu or [None], time.perf_counter()
    if options.out is None and not options.cpu and done_before().exists():
        print(f"solver is compiled: {done_before().parent}")
        return 0
    for cpu in cpus:
        if cpu and (options.out is None or cpu not in families_here()):
            allowed = ", ".join(families_here()) or "none"
            text = f"--cpu = {cpu}: expected a family of this processor, {allowed}, and --out"
            raise ArgumentError(text, id="unknown-processor")
        _compile(cpu, options.out, os.cpu_count() or 1 if options.jobs is None else options.jobs)
    if options.out is None:
        done_before().touch()
    print(f"solver compiled in {clock(time.perf_counter() - begun)}")
    return 0


def done_before() -> Path:
    """Return the file in the cache that marks a complete compilation by the current version of the rehearsal."""
    of = [Path(rehearsal.__file__), *sorted((Path(__file__).parent / "data").glob("*.toml"))]
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in of)).hexdigest()[:16]
    return cache_folder() / f"rehearsed-{digest}"


def _compile(cpu: str | None, out: Path | None, jobs: int) -> None:
    """Run the rehearsal in separate processes, which leave the code in the cache, or in a folder for a package."""
    with tempfile.TemporaryDirectory() as cache:
        own = {} if out is None else {"NUMBA_CACHE_DIR": cache}
        target = {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": ""} if cpu else {}
        waiting = 2  # added processes, because some wait for a function that another process compiles
        with concurrent.futures.ThreadPoolExecutor(max(1, jobs) + waiting) as pool:
            progress, calls = Progress(f"compiling for {cpu or 'this CPU'}"), rehearsal.count()
            done = iter(range(1, calls + 1))
            runs = [pool.submit(_rehearse, kind, own | target, lambda: progress(next(done) / calls)) for kind in KINDS]
            for run in concurrent.futures.as_completed(runs):
                run.result()
        if out is not None:
            _put(Path(cache) / "flexlink" / state(), out, (here()[0], cpu, "") if cpu else here())


def _put(code: Path, out: Path, cpu: Cpu) -> None:
    """Pack code into a package's folder, and remove code compiled from other versions of the sources."""
    for old in out.glob("[0-9a-f]" * 16):
        if old.name != code.name:
            shutil.rmtree(old)
    (out / code.name).mkdir(parents=True, exist_ok=True)
    pack(code, out / code.name / ARCHIVE, cpu)


def _rehearse(kind: str, environment: dict[str, str], called: Callable[[], None]) -> None:
    """Run all calls of a kind of scene in a process, which prints one line per call."""
    command, last = [sys.executable, "-m", "flexlink.cli.rehearsal", kind], "no message"
    with subprocess.Popen(command, env=os.environ | environment, stderr=subprocess.PIPE, text=True) as process:
        for line in process.stderr or ():
            last = line.strip() or last
            if line.startswith(f"{kind}: "):
                called()
    if process.returncode:
        raise FlexlinkError(f"compiling {kind} failed: {last}", id="compile-failed")
