"""Positions of bodies and hinges, and the branches of their tree."""
