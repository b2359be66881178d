"""Comparison with measurements: what was measured, what the model says of it, and how far either can be trusted."""
