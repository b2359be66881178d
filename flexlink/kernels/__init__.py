"""Compiled recursions: plain floats and arrays in, no checks, no strings, no callables."""
