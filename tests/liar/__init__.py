"""Fault injection for the study: library functions with slightly wrong results, and shortened cases that use them.

`lies.toml` lists for every kind the case, how it is shortened, and which result is wrong by how much.
"""
