"""Thousands of variants of a scene: what is varied, what is wanted of each, and where the rows go."""
