"""The command `flexlink completion`."""

import argparse

from flexlink.common.errors import imported


def run_command(options: argparse.Namespace) -> int:
    """Print the completion script of a shell."""
    from flexlink.cli.main import build_parser  # noqa: PLC0415  which loads this module

    shtab = imported("shtab", "shell completion needs shtab;", "completion")
    print(shtab.complete(build_parser(), shell=options.shell))
    return 0
