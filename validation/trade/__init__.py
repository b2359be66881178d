"""What an accuracy costs: scenes with their references, and the time of flexlink, other engines and solvers on them."""
