"""Sweeps: thousands of variants of a scene, the outputs of each run, and the table or file of their rows."""
