"""Of a posture: tangent, modes, equilibrium and buckling, the largest stable step."""
