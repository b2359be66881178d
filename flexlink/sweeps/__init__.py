"""Sweeps: run thousands of variants of a scene, and collect the outputs of each run as rows of a table or file."""
