"""Chains, contestants and a stopwatch for the kinds that measure speed."""
