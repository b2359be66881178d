"""Solvers that come with the package. Each imports its program when it is asked for."""
