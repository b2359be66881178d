"""What a scene gives a run from outside, as the arrays that kernels read."""
