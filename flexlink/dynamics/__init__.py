"""The equation of motion at a state, and what follows from it for an arm at rest."""
