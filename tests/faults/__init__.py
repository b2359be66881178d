"""Planted faults: small mistakes that somebody could make, each with the tests that have to notice it.

    python -m tests.faults                     all of them
    python -m tests.faults rne 'batch/*'       those of a file, or by name

A fault is data (`*.toml`, one file per source file): text that stands there exactly once, and what replaces it. The
runner plants one after another in a temporary copy of the tree and runs its tests there. A fault that they let pass is
a survivor: a test is missing, or the two texts mean the same. One in a kernel is looked for with the kernels as Python
first, in seconds; only where that does not tell are they compiled anew.

Why not a mutation tester. mutmut 3.8 skips every decorated function, and all kernels are decorated: it makes 0 mutants
of articulated, planar, rne and mass. Cosmic Ray 8.7 makes 13,048 of kernels, lumping, rules, export, compare and batch;
each kernel mutant is compiled anew, 10 to 60 s, so that a run takes days, and it edits the working tree. A short list,
chosen by hand, asks about the mistakes that matter.
"""
