"""Work-precision studies: scenes with references, run in flexlink, other engines and other solvers."""
