"""Simulation: the motion in time of a scene's arm."""
