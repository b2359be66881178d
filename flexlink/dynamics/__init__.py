"""The equation of motion at a state, its derivatives, static equilibria and small motion."""
