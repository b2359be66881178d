"""Moves of the tip: the scene driven by computed torques, and its run."""
