"""Compiled recursions: plain floats and arrays in, no checks, no strings, no callables.

Scratch of an algorithm `x` is an `XWork`, a NamedTuple with the chain or its constants in it, made by `x_workspace`.
"""
