"""What acts on a run from outside, evaluated at a time and a state."""
