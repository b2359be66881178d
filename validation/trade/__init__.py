"""Work-precision studies of scenes with references, run in flexlink, other engines and other solvers."""
