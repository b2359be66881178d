"""Chains, contestants and a stopwatch for races."""
