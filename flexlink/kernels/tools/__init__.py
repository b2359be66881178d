"""What all kernels are made with: compiler, vectors, eight chains side by side."""
