"""Compiled recursions on plain floats and arrays: no checks, no strings, no callables.

The scratch arrays of an algorithm `x` are an `XWork`, a NamedTuple that also contains the chain or its constants; it is
made by `x_workspace`.
"""
