"""The command `flexlink report`."""

import argparse
import sys

import flexlink as fl
from flexlink.cli.shared import command_line, prefix_errors, print_path, varied_scene
from flexlink.common.notebook import builder
from flexlink.common.output import make_folder


def run_command(options: argparse.Namespace) -> int:
    """Write the report, and print a line to stderr after each chapter; exit with 1 if a verdict is negative."""
    scene = varied_scene(options.scene, options)
    for module in ("page", "picture"):  # before the work starts
        builder(f"flexlink.pages.{module}", "report")
    make_folder(options.out)
    with prefix_errors(options.scene):
        page = fl.report(
            scene, options.out, against=options.against, command=command_line(), uncertain=options.uncertain,
            progress=lambda line: print(line, file=sys.stderr, flush=True),
        )  # fmt: skip
    verdicts = [{"about": each.about, "verdict": each.word, "text": each.text} for each in page.verdicts]
    options.document = {"page": str(page.page), "passed": page.passed, "failures": page.failures, "verdicts": verdicts}
    for verdict in page.verdicts:
        print(f"{verdict.about}: {verdict.word}. {verdict.text}")
    for failure in page.failures:
        print(f"not computed: {failure}")
    print_path("report", page.page)
    return 0 if page.passed else 1
