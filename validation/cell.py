"""python -m validation.cell CASE NUMBER: repeat one cell of a map; the map's CSV file lists the cell numbers."""

from __future__ import annotations

import argparse
import sys

from flexlink.common.errors import ArgumentError, FlexlinkError
from validation.case import CASES, load_case
from validation.measuring import kind_of


def main() -> int:
    """Print the cell and its result; return the exit code, 2 if there is no such cell and 0 otherwise."""
    parser = argparse.ArgumentParser(prog="python -m validation.cell", description=__doc__)
    parser.add_argument("case", help="a case that maps extremes, e.g. extremes_digits")
    parser.add_argument("number", type=int, help="number of the cell, from 0")
    options = parser.parse_args()
    try:
        case = load_case(CASES / f"{options.case}.toml")
        kind, settings = kind_of(case)
        if kind.cell_in_words is None:
            raise ArgumentError(f"case = {options.case!r}: kind {case.kind!r} has no cells")
        print(*kind.cell_in_words(case, settings, options.number), sep="\n")
    except FlexlinkError as error:
        print(f"validation: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
