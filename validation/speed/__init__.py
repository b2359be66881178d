"""Chains, contestants and clocks for races."""
