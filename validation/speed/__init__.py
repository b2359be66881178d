"""Timing comparisons of flexlink and other programs: chains, calls to be timed, and clocks."""
