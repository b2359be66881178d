"""Derivatives of the equation of motion, small motion about a state, and equilibria."""
