"""The command line's page, from its parser."""

from __future__ import annotations

import argparse
from pathlib import Path

from docs.generators.rest import directive, heading, prose
from flexlink.cli.main import build_parser

EXIT_CODES = """\
Exit codes: 0 done; 1 negative result, such as engines that disagree or no model within the tolerance; 2 error; 130
Ctrl-C; 143 SIGTERM. An error is printed as one line on stderr, which ends in its id: :doc:`messages`; standard output
is then empty, also with ``--json``. A run with warnings exits with 0: to fail on them, read ``warnings`` of ``--json``.
"""


def page(_: Path) -> str:
    """Every command with its options and examples."""
    parser = build_parser()
    parts = [heading("Command line"), EXIT_CODES, _command("flexlink", parser, 1)]
    for name, command in commands(parser).items():
        parts.append(_command(f"flexlink {name}", command, 1))
    return "\n".join(parts)


def commands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Subcommands by name."""
    (action,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return dict(action.choices)


def _command(name: str, parser: argparse.ArgumentParser, level: int) -> str:
    parts = [heading(name, level), f".. program:: {name}\n", prose(parser.description or "") + "\n"]
    examples = (parser.epilog or "").removeprefix("examples:\n")
    if examples and name != "flexlink":
        lines = "\n".join(line.strip() for line in examples.splitlines())
        parts.append(directive("code-block", "sh", lines))
    for action in parser._actions:
        if not isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
            parts.append(directive("option", _option(action), prose(_help(action))))
    return "\n".join(parts)


def _option(action: argparse.Action) -> str:
    name = str(action.metavar or (action.dest.upper() if action.option_strings else action.dest))
    if not action.option_strings:
        return f"<{name}>"
    value = "" if action.nargs == 0 else f" <{name}>"
    return ", ".join(f"{option}{value}" for option in action.option_strings)


def _help(action: argparse.Action) -> str:
    """The help text, in which argparse writes a percent sign twice."""
    choices = f" One of {', '.join(f'`{choice}`' for choice in action.choices)}." if action.choices else ""
    text = (action.help or "").replace("%%", "%")
    return f"{text[:1].upper()}{text[1:]}{choices}"
