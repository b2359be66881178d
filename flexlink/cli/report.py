"""`flexlink report`: one page about a scene, its figures and tables beside it."""

from __future__ import annotations

import argparse
import shlex
import sys

from flexlink.cli.shared import prefix_errors, varied_scene
from flexlink.scene_report.report import building, report


def report_scene(options: argparse.Namespace) -> int:
    """Write the report, a line a chapter on stderr; 1 if something in it is known to be wrong."""
    scene = varied_scene(options.scene, options.set)
    building()  # what is missing is said before the work
    with prefix_errors(options.scene):
        found = report(
            scene, options.out, against=options.against, command=_command(),
            progress=lambda line: print(line, file=sys.stderr, flush=True),
        )  # fmt: skip
    for verdict in found.verdicts:
        print(f"{verdict.about}: {verdict.word}. {verdict.text}")
    for failure in found.failures:
        print(f"not computed: {failure}")
    print(f"report: {found.page}")
    return 0 if found.passed else 1


def _command() -> str:
    return shlex.join(["flexlink", *sys.argv[1:]])
