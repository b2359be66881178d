"""The command line: one file for each command, and functions that commands share."""
