"""Tools of all kernels: compiler, vectors, eight chains side by side."""
