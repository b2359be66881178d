"""What the user describes, as plain data: arms, situations, lumping rules, Runge-Kutta methods."""
