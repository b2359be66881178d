"""Comparison with measurements: measured values, the model's predictions, and the uncertainty of both."""
