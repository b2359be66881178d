"""Hints on implausible numbers: which values are plausible, and which unit was probably meant."""
