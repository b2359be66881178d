"""Inputs of a run, as the arrays that kernels read."""
