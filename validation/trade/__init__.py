"""Work-precision studies: scenes with references, and runs of flexlink, other engines and solvers on them."""
