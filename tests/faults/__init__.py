"""Planted faults: small programming mistakes, each with the tests that must detect it.

    python -m tests.faults                     all faults
    python -m tests.faults rne 'batch/*'       the faults of a file, or by name

A fault is data (`*.toml`, one file per source file): a text that occurs exactly once, and its replacement. The runner
plants one fault after another in a temporary copy of the tree and runs its tests there. A fault that passes them is a
survivor: a test is missing, or both texts are equivalent. A fault in a kernel is first tested with the kernels run
as Python, which takes seconds; the kernels are recompiled only if this test is inconclusive.

Why no mutation testing tool? mutmut 3.8 skips decorated functions, and all kernels are decorated, so it makes no
mutants of articulated, planar, rne and mass. Cosmic Ray 8.7 makes 13,048 mutants of kernels, lumping, rules, export,
compare and batch; recompiling takes 10 to 60 s per kernel mutant, so a run takes days, and the tool edits the working
tree. A short list chosen by hand covers the mistakes that matter.
"""
