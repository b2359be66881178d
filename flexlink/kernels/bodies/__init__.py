"""Rigid-body recursions for a given state: inverse dynamics, mass matrix, energy and momentum."""
