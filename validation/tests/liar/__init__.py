"""Fault injection for the study: library functions with slightly wrong results, and shortened cases that use them.

For every kind of case, `lies.toml` names one case, how it is shortened, which result is wrong, and by how much.
"""
