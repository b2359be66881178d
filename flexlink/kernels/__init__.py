"""Compiled recursions on plain floats and arrays: no checks, no strings, no callables.

The scratch arrays of an algorithm `x` are the fields of an `XWork`, a NamedTuple that also contains the chain or its
constants. The function `x_workspace` allocates this tuple.
"""
