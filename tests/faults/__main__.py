"""python -m tests.faults [name or glob ...]: plant faults one after another and check that the tests detect them.

With --machine: automatic mutants in all folders of the project, or in the folders and files given.

Exit codes: 0, all faults are detected; 1, a fault survived, does not apply any more or has no verdict; 2, wrong call,
or the tests fail without a fault; 130, interrupted after printing the verdicts so far.
"""

import argparse
import collections
import signal
import sys
from collections.abc import Iterator, Sequence

from tests.faults.machine import run
from tests.faults.plant import KILLED, Copy, Fault, Verdict, copied, load, select


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("pattern", nargs="*", help="name or glob of a fault, or of a source (default: all)")
    parser.add_argument("--list", action="store_true", help="only list them")
    parser.add_argument("--machine", action="store_true", help="test automatic mutants of folders or files")
    parser.add_argument("--seed", type=int, help="with --machine: others")
    parser.add_argument("--most", type=int, help="with --machine: maximum number of mutants per folder")
    options = parser.parse_args(arguments)
    if options.machine:
        return run.main([name.rstrip("/") for name in options.pattern], options.seed, options.most)
    try:
        faults = select(load(), options.pattern)
    except LookupError as error:
        print(error.args[0], file=sys.stderr)
        return 2
    if options.list:
        print(*(f"{fault.name:<36}{fault.why}" for fault in faults), sep="\n")
        return 0
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    outcomes: collections.Counter[str] = collections.Counter()
    try:
        with copied() as copy:
            for fault, (outcome, detail, seconds) in judged(copy, faults):
                outcomes[outcome] += 1
                number = f"{outcomes.total():>4}/{len(faults)}"
                print(f"{number} {seconds:>6.1f} s  {outcome:<9} {fault.name:<36} {detail}", flush=True)
    except NotSoundError:
        return 2
    except KeyboardInterrupt:
        print(f"interrupted: {summary(outcomes, len(faults))}")
        return 130
    print(summary(outcomes, len(faults)))
    return 0 if outcomes[KILLED] == len(faults) else 1


class NotSoundError(Exception):
    """The tests fail without any fault."""


def judged(copy: Copy, faults: Sequence[Fault]) -> Iterator[tuple[Fault, Verdict]]:
    """Faults with their verdicts. Kernels are first tested as Python (seconds), and compiled (a minute) if needed."""
    left = []
    for fault in faults:
        verdict = copy.judge_as_python(fault) if fault.compiled else None
        if verdict is None:
            left.append(fault)
        else:
            yield fault, verdict
    if left and not is_sound(copy, left):
        raise NotSoundError
    for fault in left:
        yield fault, copy.judge(fault)


def is_sound(copy: Copy, faults: Sequence[Fault]) -> bool:
    """Check that all tests pass without a fault; otherwise their failure with a fault proves nothing."""
    tests = sorted({test for fault in faults for test in fault.tests})
    files = {test for test in tests if "::" not in test}
    tests = [test for test in tests if test in files or test.partition("::")[0] not in files]
    print(f"{len(faults)} faults; running their tests without a fault first (compiles all kernels)", flush=True)
    code, output = copy.run(tests, copy.sound)
    if code != 0:
        print(output, "The tests fail without a fault: no verdict is possible.", sep="\n", file=sys.stderr)
    return code == 0


def summary(outcomes: collections.Counter[str], faults: int) -> str:
    """Summary line with the counts of the outcomes."""
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
    return f"{outcomes.total()} of {faults} faults tested: {counts or 'none'}"


if __name__ == "__main__":
    sys.exit(main())
