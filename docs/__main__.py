"""Build the site: python -m docs, then open docs/_site/index.html.

python -m docs            all of it; gallery pages whose example has not changed are not run again
python -m docs --quick    without running any code of pages and gallery
python -m docs --check    only find errors: as --quick, but no pages are written
python -m docs --links    also check every link to other sites (needs a network)
python -m docs --readme   write the figures of README and paper, and badges, from the stored study
python -m docs --extras   write the sizes of all extras, which must be installed, on the page "Install flexlink"
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from docs import snippets
from docs.generators import extras, readme

HERE = Path(__file__).parent


def main() -> int:
    """Build, warnings as errors, every reference checked."""
    parser = argparse.ArgumentParser(
        prog="python -m docs", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="do not run code of pages and gallery")
    parser.add_argument("--check", action="store_true", help="only find errors, without running code or writing pages")
    parser.add_argument("--links", action="store_true", help="check links to other sites (needs a network)")
    parser.add_argument("--readme", action="store_true", help="only write figures of README and paper, and badges")
    parser.add_argument("--out", type=Path, default=HERE / "_site", help="folder of the pages; default: docs/_site")
    parser.add_argument("--extras", action="store_true", help="only measure and write the sizes of all extras")
    options = parser.parse_args()
    if options.readme or options.extras:
        (readme if options.readme else extras).write()
        return 0
    try:
        from sphinx.cmd.build import main as sphinx  # noqa: PLC0415  # the other options work without it
    except ImportError:
        parser.error("needs Sphinx: pip install -e '.[docs]'")
    os.environ.setdefault("MPLBACKEND", "agg")
    builder = "linkcheck" if options.links else "dummy" if options.check else "html"
    quick = options.quick or options.check
    words = ["-W", "-n", *([] if sys.stdout.isatty() else ["-q"]), "-b", builder, "-d", str(HERE / "_doctrees")]
    words += ["-D", "plot_gallery=0"] if quick else []
    with tempfile.TemporaryDirectory() as folder:
        if not quick:
            os.environ[snippets.FOLDER] = folder
        code: int = sphinx([*words, str(HERE), str(options.out)])
    if code == 0 and builder == "html":
        print(f"site: {options.out / 'index.html'}")
    return code


if __name__ == "__main__":
    sys.exit(main())
