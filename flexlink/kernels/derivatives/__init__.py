"""Derivatives of the equation of motion, and of runs."""
