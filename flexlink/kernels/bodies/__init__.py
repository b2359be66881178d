"""Rigid-body recursions for a given motion: inverse dynamics, mass matrix, energies, positions."""
