"""Machines as data: check whether this computer can emulate a machine, and run the tests on it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
CPU_FLAGS = Path("/proc/cpuinfo")
QUICK = "tests.machines.quick"


class Machine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A computer to emulate with the environment variables `env`."""

    name: str
    reason: str
    env: dict[str, str] = {}
    needs: frozenset[str] = frozenset()  # CPU flags that the chosen kernels need
    best: bool = False  # OpenBLAS chooses these kernels by default on a CPU with these flags
    python: str = ""  # command; "": the current one
    cores: int = 0  # 0: all
    plugin: str = ""  # pytest plugin for what environment variables cannot emulate
    files: tuple[str, ...] = ()  # tests that run on the machine; if empty, all
    without: tuple[str, ...] = ()  # tests that are left out
    fast: bool = False  # without slow tests
    quick: bool = False


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    everywhere: tuple[str, ...]
    without_arithmetic: tuple[str, ...]
    machine: tuple[Machine, ...]


class Outcome(NamedTuple):
    """Result of the tests on one machine."""

    code: int  # exit code of pytest
    counts: str  # "3 failed, 12 passed"
    seconds: float
    failed: tuple[str, ...]  # lines that pytest prints for failed tests


FILE = msgspec.toml.decode((HERE / "machines.toml").read_bytes(), type=_File)


def select(names: Sequence[str]) -> list[Machine]:
    """Machines with these names, in the order of the file; all if there are no names.

    Raises
    ------
    LookupError
        A name is unknown.
    """
    known = [machine.name for machine in FILE.machine]
    for name in names:
        if name not in known:
            raise LookupError(f"{name!r}: no such machine; allowed are {', '.join(known)}")
    return [machine for machine in FILE.machine if not names or machine.name in names]


def missing(machine: Machine) -> str:
    """Reason why this computer cannot emulate the machine; empty if it can."""
    if machine.needs and not CPU_FLAGS.is_file():
        return "needs Linux to read the CPU flags"
    if lacking := machine.needs - flags():
        return f"this CPU has no {', '.join(sorted(lacking))}, and OpenBLAS's kernels would crash"
    if machine.cores and not hasattr(os, "sched_setaffinity"):
        return "needs Linux to limit the cores"
    if machine.python and not works(machine.python):
        return f"{machine.python} is not installed; specify its path with --python"
    return ""


def is_already(machine: Machine) -> bool:
    """Return whether this computer already is the machine, so that its normal tests cover it."""
    return machine.best and machine.needs <= flags()


def flags() -> frozenset[str]:
    """CPU flags as named by Linux; empty on other systems."""
    text = CPU_FLAGS.read_text(encoding="utf-8") if CPU_FLAGS.is_file() else ""
    found = re.search(r"^flags\s*:(.*)$", text, re.MULTILINE)
    return frozenset(found[1].split() if found else ())


def works(python: str) -> bool:
    """Return whether a command is a working Python: pyenv has commands for versions that are not installed."""
    found = shutil.which(python)
    return found is not None and subprocess.run([found, "-V"], capture_output=True, check=False).returncode == 0


def environment(machine: Machine, own: Mapping[str, str] = os.environ) -> dict[str, str]:
    """The environment variables of the machine."""
    return {**own, **machine.env, "PYTHONPATH": str(ROOT)}


@contextmanager
def python_of(machine: Machine) -> Iterator[str]:
    """Python of the machine with all test requirements, in a virtual environment if it is not the current one."""
    if not machine.python:
        yield sys.executable
        return
    with tempfile.TemporaryDirectory(prefix="flexlink-") as folder:
        found = shutil.which(machine.python) or machine.python
        subprocess.run([found, "-m", "venv", folder], check=True)
        python = str(Path(folder) / ("Scripts" if os.name == "nt" else "bin") / "python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", "-e", f"{ROOT}[test]"], check=True)
        yield python


def run_as(machine: Machine, files: Sequence[str], options: Sequence[str], *, quick: bool = False) -> Outcome:
    """Run the tests on a machine; `quick` selects fast tests with few parameter sets."""

    def fewer_cores() -> None:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: machine.cores])

    began = time.perf_counter()
    with python_of(machine) as python:
        unaffected = FILE.without_arithmetic if quick else ()
        left_out = [f"--deselect={test}" for test in (*FILE.everywhere, *machine.without, *unaffected)]
        plugins = [word for name in (machine.plugin, QUICK if quick else "") if name for word in ("-p", name)]
        fast = ["-m", "not slow"] if machine.fast or quick else []
        command = [python, "-m", "pytest", "-q", "--no-header", "-p", "no:cacheprovider"]
        command += [*plugins, *fast, *left_out, *files, *options]
        done = subprocess.run(
            command, cwd=ROOT, env=environment(machine), preexec_fn=fewer_cores if machine.cores else None,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", errors="replace", check=False,
        )  # fmt: skip
    lines = done.stdout.splitlines() or [""]
    failed = tuple(line for line in lines if line.startswith(("FAILED ", "ERROR ")))
    counts = ", ".join(re.findall(r"\d+ (?:failed|passed|skipped|errors?)", lines[-1])) or lines[-1]
    return Outcome(done.returncode, counts, time.perf_counter() - began, failed)
