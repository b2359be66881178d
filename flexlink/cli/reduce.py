"""The command `flexlink reduce`."""

from flexlink.cli import advise

run_command = advise.run_command
