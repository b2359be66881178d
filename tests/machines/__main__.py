"""python -m tests.machines [name ...] [--quick] [-- pytest's options]: run the tests as on other computers.

Exit codes: 0, they pass on every available machine; 1, they fail; 2, wrong call; 130, interrupted.
"""

import argparse
import sys
from collections.abc import Sequence

import msgspec

from tests.machines.run import is_already, missing, run_as, select


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    own, options = (given[: given.index("--")], given[given.index("--") + 1 :]) if "--" in given else (given, [])
    parser = argparse.ArgumentParser(prog="python -m tests.machines", description=__doc__)
    parser.add_argument("name", nargs="*", help="a machine (default: all)")
    parser.add_argument("--list", action="store_true", help="only list them")
    parser.add_argument("--quick", action="store_true", help="few machines, fast tests, one parameter set per test")
    parser.add_argument("--files", nargs="+", default=[], help="run only these tests")
    parser.add_argument("--python", action="append", default=[], metavar="python3.13=PATH", help="path of a Python")
    choice = parser.parse_args(own)
    try:
        machines = select(choice.name)
    except LookupError as error:
        print(error.args[0], file=sys.stderr)
        return 2
    if choice.quick and not choice.name:
        machines = [machine for machine in machines if machine.quick]
    if choice.list:
        print(*(f"{machine.name:<14}{machine.reason}" for machine in machines), sep="\n")
        return 0
    places = dict(place.split("=", 1) for place in choice.python if "=" in place)
    good = True
    try:
        for known in machines:
            machine = msgspec.structs.replace(known, python=places.get(known.python, known.python))
            already = "this computer is one" if choice.quick and not choice.name and is_already(machine) else ""
            if why := missing(machine) or already:
                print(f"{machine.name:<14}skipped: {why}", flush=True)
                continue
            outcome = run_as(machine, choice.files or machine.files, options, quick=choice.quick)
            good = good and outcome.code == 0
            verdict = "ok" if outcome.code == 0 else "FAILED"
            print(f"{machine.name:<14}{verdict:<8}{outcome.seconds:>6.0f} s  {outcome.counts}", flush=True)
            print(*(f"    {line}" for line in outcome.failed), sep="\n", end="\n" if outcome.failed else "", flush=True)
    except KeyboardInterrupt:
        print("interrupted")
        return 130
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
