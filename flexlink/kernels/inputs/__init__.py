"""Inputs of a run (drives, prescribed motions, tip wrench), evaluated at a time and a state."""
