"""`python -m reports`: build the report from stored results, without any engine."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from flexlink.common.errors import FlexlinkError

try:
    from reports import full, reference
    from reports.build import build, readme_figure
    from reports.results import Results
except ImportError as missing:
    print(f"reports: {missing}; install with: python -m pip install -e '.[report]'", file=sys.stderr)
    sys.exit(2)

ROOT = Path(__file__).parent.parent
RESULTS, OUT = ROOT / "validation" / "results", ROOT / "reports" / "latest"

EXAMPLES = """examples:
  python -m reports
  python -m reports --results old/results --out old/report
  python -m reports --readme-figure docs/paper_fig5.png
  python -m reports --full                              rebuild reports/full, after python -m validation --full
  python -m reports --reference                         after a complete study on an idle machine
"""


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return its exit code: 0 if the report is written, 2 if it cannot be."""
    parser = argparse.ArgumentParser(
        prog="python -m reports",
        description="Make the validation report (index.html; a CSV per table; a PNG, SVG and CSV per figure) "
        "from stored results. Does not run simulations and needs no engine.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="FOLDER", help="default: validation/results")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help="default: reports/latest")
    parser.add_argument("--readme-figure", type=Path, metavar="PNG", help="write only the README's figure to PNG")
    parser.add_argument("--reference", action="store_true", help="make this study the checked-in reference run")
    parser.add_argument("--full", action="store_true", help="also rebuild reports/full, the checked-in full study")
    wanted = parser.parse_args(arguments)
    try:
        if wanted.readme_figure:
            print(readme_figure(wanted.results, wanted.readme_figure))
        elif wanted.full:
            print(full.save(wanted.results, wanted.out))
        elif wanted.reference:
            print(reference.save(Results.read(wanted.results)))
        else:
            print(build(wanted.results, wanted.out))
    except FlexlinkError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
