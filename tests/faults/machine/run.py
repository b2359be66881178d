"""The command `python -m tests.faults --machine`: sample mutants, test them, print and save the results."""

import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from tests.faults.machine.generator import Mutant, drawn
from tests.faults.plant import KERNELS, KILLED, ROOT

HERE = Path(__file__).parent
KEPT = HERE / "judged.toml"


class Same(msgspec.Struct, forbid_unknown_fields=True):
    """An equivalent mutant: it behaves like the original, or its difference is not observable."""

    mutant: str  # `Mutant.key`
    reason: str


class Plan(msgspec.Struct, forbid_unknown_fields=True):
    """Contents of `machine.toml`."""

    seed: int
    most: int  # maximum number per folder
    quota: float  # minimum fraction of mutants that the tests must detect
    python: tuple[str, ...]  # tests of kernels, run as Python
    slow: tuple[str, ...]  # files whose slow tests are also used
    more: dict[str, int] = {}  # number of mutants for folders that need more than `most`
    same: tuple[Same, ...] = ()


class Room(msgspec.Struct, forbid_unknown_fields=True):
    """Results of one folder."""

    seed: int
    judged: int
    killed: int
    survivors: list[str] = []

    @property
    def share(self) -> float:
        """Fraction of mutants that the tests detect."""
        return self.killed / self.judged if self.judged else 1.0


def plan() -> Plan:
    """Settings that select the mutants, from `machine.toml`."""
    return msgspec.toml.decode((HERE / "machine.toml").read_bytes(), type=Plan)


def kept() -> dict[str, Room]:
    """Latest results of each folder."""
    return msgspec.toml.decode(KEPT.read_bytes(), type=dict[str, Room]) if KEPT.is_file() else {}


def chosen(rooms: Sequence[str], seed: int | None, most: int | None) -> list[Mutant]:
    """Mutants for this seed and number per folder; for None, the seed and numbers of `machine.toml` apply."""
    wanted = plan()
    left_out = frozenset(each.mutant for each in wanted.same)
    number = {} if most else wanted.more
    every = drawn(rooms, wanted.seed if seed is None else seed, max(most or wanted.most, *number.values(), 0), left_out)
    taken: dict[str, int] = defaultdict(int)
    result = []
    for mutant in every:
        taken[mutant.room] += 1
        if taken[mutant.room] <= number.get(mutant.room, most or wanted.most):
            result.append(mutant)
    return result


def main(rooms: Sequence[str], seed: int | None, most: int | None) -> int:
    """Test the mutants and return the exit code: 1 if a folder is below the quota, 2 if no folder or file matches."""
    mutants = chosen(rooms, seed, most)
    if not mutants:
        print(f"{', '.join(rooms)}: no file or folder of the project", file=sys.stderr)
        return 2
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for compiled in (False, True):
        group = [mutant for mutant in mutants if mutant.file.startswith(KERNELS) == compiled]
        for mutant, outcome in _judged(group, compiled):
            found[mutant.room].append((outcome, str(mutant)))
    wanted, previous = plan(), kept()
    result = {
        room: Room(
            wanted.seed if seed is None else seed,
            len(outcomes),
            sum(outcome == KILLED for outcome, _ in outcomes),
            sorted(text for outcome, text in outcomes if outcome != KILLED),
        )
        for room, outcomes in found.items()
    }
    print(table(result))
    whole = seed is None and most is None and not any(room.endswith(".py") for room in rooms)
    if whole:
        write(previous | result)
    return 0 if all(room.share >= wanted.quota for room in result.values()) else 1


def table(rooms: dict[str, Room]) -> str:
    """One line per folder and one for the total."""
    counts = {name: (room.killed, room.judged) for name, room in sorted(rooms.items())}
    counts["all"] = (sum(room.killed for room in rooms.values()), sum(room.judged for room in rooms.values()))
    return "\n".join(f"{name:<34}{k:>5} of {n:<5}{k / n:>5.0%}" for name, (k, n) in counts.items())


def write(rooms: dict[str, Room]) -> None:
    """Save the results."""
    text = "# Written by python -m tests.faults --machine\n\n"
    KEPT.write_bytes(text.encode() + msgspec.toml.encode(dict(sorted(rooms.items()))))


def _judged(mutants: Sequence[Mutant], compiled: bool) -> Iterable[tuple[Mutant, str]]:
    """Outcomes of the mutants from a separate process, which is needed to run kernels as Python."""
    if not mutants:
        return
    with tempfile.NamedTemporaryFile("w", suffix=".json", encoding="utf-8") as file:
        json.dump(mutants, file)
        file.flush()
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.machine.worker", file.name],
            cwd=ROOT,
            env=os.environ | ({"NUMBA_DISABLE_JIT": "1"} if compiled else {}),
            text=True,
            stdout=subprocess.PIPE,
        )
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("["):
                number, outcome, detail, tests_run, seconds = json.loads(line)
                head = f"{number + 1:>4}/{len(mutants)} {seconds:>5.1f} s {outcome:<9}"
                print(f"{head}{mutants[number]}  ({tests_run} tests) {detail}", flush=True)
                yield mutants[number], outcome
            else:
                print(line, end="", flush=True)
        process.wait()
